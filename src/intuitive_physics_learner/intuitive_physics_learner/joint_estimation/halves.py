"""Whether stated uncertainties are true: two fits to halves of the observations are compared.

Slopes at an estimate tell how well the data hold it there, not whether it settled beside a better
one, as fits to chaotic motion may. Two halves share no observation, so such errors of theirs have
nothing in common, and they disagree by as much as both are wrong. By how much that is more than
they say, the uncertainties are widened.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.cost import Cost
from intuitive_physics_learner.trials import Trials

PRIOR_DISAGREEMENTS = 3.0
"""A parameter's own family of disagreements counts against this many of all parameters."""

NORMAL_MEDIAN = 0.6745
"""Median of |x| for x of the standard normal distribution."""


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


def widening(
    difference: NDArray[np.float64],
    variance: NDArray[np.float64],
    families: Sequence[NDArray[np.int64]],
) -> NDArray[np.float64]:
    """Factors (n,) ≥ 1 for standard deviations.

    Parameters
    ----------
    difference : (n,) of the estimates of both halves; NaN where one of them tells nothing
    variance : (n,) of that difference, by what both halves say
    families : indices of parameters that are likely to err alike, each parameter in one
    """
    ratios = np.abs(difference) / np.sqrt(variance)
    known = np.isfinite(ratios)
    factors = np.ones(difference.size)
    if not known.any():
        return factors
    typical = max(float(np.median(ratios[known])) / NORMAL_MEDIAN, 1.0)
    for family in families:
        own = ratios[family][known[family]]
        square = (np.sum(own**2) + PRIOR_DISAGREEMENTS * typical**2) / (
            own.size + PRIOR_DISAGREEMENTS
        )
        factors[family] = max(np.sqrt(square), 1.0)
    return factors
