"""The task of one search: learn θ_s from observations, beginning at a known θ_s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.search.search_space import ActiveSpace


@dataclass(frozen=True, eq=False)
class LearningTask:
    """One θ_s to learn.

    Parameters
    ----------
    cost : J over the observations
    space : bounds of all parameters
    influence : (n_observations, |θ_s|) bool, as `parameter_influence`
    start : θ_s to begin from
    """

    cost: Cost
    space: ParameterSpace
    influence: NDArray[np.bool_]
    start: StaticParameters

    @property
    def active(self) -> NDArray[np.bool_]:
        """Parameters that any observation can depend on, (|θ_s|,) bool."""
        return np.asarray(self.influence.any(axis=0))

    @property
    def searched(self) -> ActiveSpace:
        """The space of the n active parameters."""
        return ActiveSpace(self.space, self.active, self.start)

    @property
    def begin(self) -> NDArray[np.float64]:
        """The point of that space's unit cube, (n,), to begin from."""
        return self.searched.to_unit(self.start)
