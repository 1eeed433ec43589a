"""Parting observations into halves, each with a cost of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.cost.trials import Trials


class PartialCost(Cost):
    """J over some of the observations of another cost.

    Parameters
    ----------
    cost : over all of them
    members : indices of the observations that are left, at least one
    """

    def __init__(self, cost: Cost, members: NDArray[np.int64]) -> None:
        super().__init__([cost.observations[i] for i in members], cost.materials)
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
            padded = np.zeros((len(states), objects, 13))
            padded[..., 6] = 1.0
            padded[:, : states.shape[1]] = states
            states = padded
        members = self._members[trials.observation_index]
        return Trials(trials.parameters, trials.parameter_index, members, states, trials.until)


def halves(influence: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Part observations so that each half has about as many that tell of each parameter.

    Parameters
    ----------
    influence : (n_observations, n) bool
    """
    weights = 1.0 / np.maximum(influence.sum(axis=0), 1)
    surplus = np.zeros(influence.shape[1])
    parts: list[list[int]] = [[], []]
    for observation, row in enumerate(influence):
        side = 0 if (surplus * weights)[row].sum() <= 0.0 else 1
        surplus[row] += 1.0 if side == 0 else -1.0
        parts[side].append(observation)
    return [np.array(part, dtype=np.int64) for part in parts]
