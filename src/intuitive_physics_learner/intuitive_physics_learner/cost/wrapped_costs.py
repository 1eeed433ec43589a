"""Costs that evaluate another one: from memory, or over some of its observations."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.cost.trials import Trials, resting

REMEMBERED = 64
"""Sets of parameters remembered for an observation on average, more than a batch has candidates."""


class CachedCost(Cost):
    """Another cost, the same to the bit, that remembers distances.

    J is a sum over observations, and each depends on few parameters, so a candidate that differs
    from an earlier one in some parameters costs only the observations which these can change.
    """

    def __init__(self, cost: Cost) -> None:
        super().__init__(cost.observations, cost.materials)
        self._cost = cost
        influence = parameter_influence(cost.observations, cost.materials)
        self._parameters = [np.flatnonzero(row) for row in influence]
        self._cached: OrderedDict[tuple[int, bytes], NDArray[np.float64]] = OrderedDict()

    def trial_distances(self, trials: Trials) -> NDArray[np.float64]:
        if trials.states is not None or trials.until is not None:
            return self._cost.trial_distances(trials)
        vectors = [parameter_vector(parameters) for parameters in trials.parameters]
        places = zip(
            trials.parameter_index.tolist(), trials.observation_index.tolist(), strict=True
        )
        keys = [(i, vectors[c][self._parameters[i]].tobytes()) for c, i in places]
        missing: dict[tuple[int, bytes], int] = {}
        for trial, key in enumerate(keys):
            if key not in self._cached:
                missing.setdefault(key, trial)
        if missing:
            chosen = np.array(list(missing.values()))
            rows = self._cost.trial_distances(trials.taken(chosen))
            self._cached.update(zip(missing, rows, strict=True))
        for key in keys:
            self._cached.move_to_end(key)
        distances = np.array([self._cached[key] for key in keys])
        while len(self._cached) > REMEMBERED * len(self.observations):
            self._cached.popitem(last=False)
        return distances

    def trial_residuals(self, trials: Trials) -> NDArray[np.float64]:
        return self._cost.trial_residuals(trials)


class PartialCost(Cost):
    """J over some observations of another cost, at least one: `members` (n_members,) by index."""

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
