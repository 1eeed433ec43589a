"""J over some of the observations of another cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.cost.trials import Trials, resting


class PartialCost(Cost):
    """J over some of the observations of another cost.

    `members` (n_members,) indices of the observations that are left, at least one.
    """

    def __init__(self, cost: Cost, members: NDArray[np.int64]) -> None:
        super().__init__([cost.observations[i] for i in members], cost.materials)
        self.threads = cost.threads
        self._cost = cost
        self._members = members

    def trial_distances(self, trials: Trials) -> NDArray[np.float64]:
        objects = int(self.trajectory_object.max()) + 1
        return self._cost.trial_distances(self._of_all(trials))[:, :objects]

    def trial_residuals(self, trials: Trials) -> NDArray[np.float64]:
        return self._cost.trial_residuals(self._of_all(trials))

    def _of_all(self, trials: Trials) -> Trials:
        states = trials.states
        objects = int(self._cost.trajectory_object.max()) + 1
        if states is not None and states.shape[1] < objects:
            padded = resting(len(states), objects)
            padded[:, : states.shape[1]] = states
            states = padded
        members = self._members[trials.observation_index]
        return replace(trials, observation_index=members, states=states)
