"""The task of one search: learn θ_s from observations, with what is known of it before."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.cost.wrapped_costs import PartialCost
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.search_space import ActiveSpace

NEGLIGIBLE_WEIGHT = 1e-9
"""Factor on the weight of an observation that is known beforehand, and so must not count again."""


@dataclass(frozen=True, eq=False)
class FitTask:
    """The problem of a fit to trajectories.

    Parameters
    ----------
    cost : simulates the observations
    space : maps the unit cube of the n parameters to θ_s
    influence : (n_observations, n) bool, which observation can depend on which parameter
    prior : of the n parameters; a fit begins at its mean
    given_weights : (n_observations,) above 0, with which each counts, as by its age; None: 1
    """

    cost: Cost
    space: ActiveSpace
    influence: NDArray[np.bool_]
    prior: Gaussian
    given_weights: NDArray[np.float64] | None = None

    @property
    def weights(self) -> NDArray[np.float64]:
        """The weight with which each observation counts, (n_observations,)."""
        if self.given_weights is None:
            return np.ones(len(self.influence))
        return self.given_weights

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Which observations count, and are not known beforehand, (n_observations,)."""
        return self.weights > NEGLIGIBLE_WEIGHT

    def of(self, members: NDArray[np.int64]) -> FitTask:
        """Return the task of some observations, `members` (k,) by their indices."""
        return replace(
            self,
            cost=PartialCost(self.cost, members),
            influence=self.influence[members],
            given_weights=self.weights[members],
        )

    def part(self, members: NDArray[np.int64], chosen: NDArray[np.int64]) -> FitTask:
        """Return the task of some observations over some parameters; the others are held.

        `members` (k,) indices of the observations; `chosen` (l,) of the parameters.
        """
        return FitTask(
            PartialCost(self.cost, members),
            self.space.part(chosen, self.prior.mean),
            self.influence[np.ix_(members, chosen)],
            self.prior.marginal(chosen),
            self.weights[members],
        )


@dataclass(frozen=True, eq=False)
class Motions:
    """Independent motions in observations, as they were detected, before any smoothing.

    Parameters
    ----------
    cost : simulates them
    influence : (n_motions, |θ_s|) bool, as `parameter_influence`
    origins : (n_motions,) index of the observation that each is a part of
    """

    cost: Cost
    influence: NDArray[np.bool_]
    origins: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LearningTask:
    """One θ_s to learn.

    Parameters
    ----------
    cost : J over the observations
    space : bounds of all parameters
    influence : (n_observations, |θ_s|) bool, as `parameter_influence`
    start : θ_s to begin from
    knowledge : of the active parameters, before these observations; None: only their bounds
    motions : in the same observations, for fits; None: they are those of `cost`
    simulator : of fits in segments; None: nothing is fitted in segments
    start_was_learned : whether the start was learned before, so that it must not be replaced by
        what is worse
    """

    cost: Cost
    space: ParameterSpace
    influence: NDArray[np.bool_]
    start: StaticParameters
    knowledge: Gaussian | None = None
    motions: Motions | None = None
    simulator: Simulator | None = None
    start_was_learned: bool = False

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

    @property
    def prior(self) -> Gaussian:
        """Knowledge of the active parameters before these observations."""
        return self.knowledge or Gaussian.within_bounds(self.begin)

    @property
    def fit_task(self) -> FitTask:
        """The fit over the active parameters, to the points detected where these are known."""
        cost, influence = self.cost, self.influence
        if self.motions is not None:
            cost, influence = self.motions.cost, self.motions.influence
        return FitTask(cost, self.searched, influence[:, self.active], self.prior)
