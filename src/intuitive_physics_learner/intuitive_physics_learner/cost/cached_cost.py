"""Simulating an observation again only when a parameter that it can depend on has changed."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.cost.trials import Trials

REMEMBERED = 64
"""Sets of parameters remembered for each observation: more than the candidates of one batch."""


class CachedCost(Cost):
    """Another cost, the same to the bit, that remembers distances.

    J is a sum over observations, and each depends on few parameters, so a candidate that differs
    from an earlier one in some parameters costs only the observations which these can change.

    Attributes
    ----------
    simulated : trials that were simulated so far
    """

    def __init__(self, cost: Cost) -> None:
        super().__init__(cost.observations, cost.materials)
        self._cost = cost
        influence = parameter_influence(cost.observations, cost.materials)
        self._parameters = [np.flatnonzero(row) for row in influence]
        self._cached: list[OrderedDict[bytes, NDArray[np.float64]]] = [
            OrderedDict() for _ in cost.observations
        ]
        self.simulated = 0

    def trial_distances(self, trials: Trials) -> NDArray[np.float64]:
        if trials.states is not None or trials.until is not None:
            return self._cost.trial_distances(trials)
        vectors = [parameter_vector(parameters) for parameters in trials.parameters]
        places = list(
            zip(trials.parameter_index.tolist(), trials.observation_index.tolist(), strict=True)
        )
        keys = [vectors[c][self._parameters[i]].tobytes() for c, i in places]
        answers: dict[tuple[int, bytes], NDArray[np.float64]] = {}
        missing: dict[tuple[int, bytes], int] = {}
        for trial, ((_, i), key) in enumerate(zip(places, keys, strict=True)):
            cached = self._cached[i].get(key)
            if cached is None:
                missing.setdefault((i, key), trial)
            else:
                self._cached[i].move_to_end(key)
                answers[i, key] = cached
        if missing:
            chosen = np.array(list(missing.values()))
            rows = self._cost.trial_distances(trials.taken(chosen))
            self.simulated += chosen.size
            for (i, key), row in zip(missing, rows, strict=True):
                answers[i, key] = row
                self._remember(i, key, row)
        return np.array([answers[i, key] for (_, i), key in zip(places, keys, strict=True)])

    def trial_residuals(self, trials: Trials) -> NDArray[np.float64]:
        return self._cost.trial_residuals(trials)

    def _remember(self, observation: int, key: bytes, distances: NDArray[np.float64]) -> None:
        cached = self._cached[observation]
        cached[key] = distances
        if len(cached) > REMEMBERED:
            cached.popitem(last=False)
