"""How far a learned θ_s is from the true one: excess of J, and errors in stated deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace, parameter_vector
from intuitive_physics_learner.search.parameter_axes import ParameterAxes

WITHIN = 2.0
"""Standard deviations within which the true value of an identified parameter is to lie."""

LEAST_WITHIN, MOST_WITHIN = 0.90, 0.99
"""Shares of identified parameters within two standard deviations between which deviations are
honest: a normal distribution has 0.954."""


def excess(learned: float, oracle: float, default: float) -> float:
    """Return (J_learned - J_oracle) / (J_default - J_oracle).

    0 is as good as the true θ_s, 1 as bad as the untouched defaults. Where the defaults are no
    worse than the true θ_s there is nothing to gain: then it is 0 for what is no worse than the
    true θ_s, and infinite for what is worse.

    Parameters
    ----------
    learned, oracle, default : J in m of what was learned, of the true θ_s, of the defaults
    """
    if default <= oracle:
        return 0.0 if learned <= oracle else float("inf")
    return (learned - oracle) / (default - oracle)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Errors of the identified parameters of one set, in their stated standard deviations.

    Parameters
    ----------
    scores : (n_identified,) error over standard deviation, both on the parameter's scale of the
        search, logarithmic for densities and rolling friction; 0 where the true value lies within a
        stated one-sided interval
    errors : (n_identified,) those errors in widths of the bounds, at least 0
    active : number of parameters that the observations could depend on
    """

    scores: NDArray[np.float64]
    errors: NDArray[np.float64]
    active: int

    @property
    def within(self) -> int:
        """Number of identified parameters within two standard deviations of the true value."""
        return int(np.sum(np.abs(self.scores) <= WITHIN))

    @property
    def identified(self) -> int:
        """Number of identified parameters."""
        return int(self.scores.size)


def coverage(
    learned: LearnedParameters, true: StaticParameters, active: NDArray[np.bool_]
) -> Coverage:
    """Hold what is stated of each identified active parameter against the truth.

    Parameters
    ----------
    learned : θ_s with standard deviations and one-sided intervals
    true : θ_s of the same materials, in any order
    active : (|θ_s|,) bool, in the order of the learned θ_s
    """
    space = ParameterSpace(learned.materials)
    stated = ParameterAxes(space, learned.parameters)
    truth = ParameterAxes(space, true.extended(learned.materials)).origin
    counted = learned.identified & active
    errors = (stated.origin - truth)[counted]
    deviations = (learned.standard_deviations / stated.slopes)[counted]
    scores = errors / deviations
    scores[_within_interval(learned, true)[counted]] = 0.0
    return Coverage(scores, np.abs(errors), int(active.sum()))


def _within_interval(learned: LearnedParameters, true: StaticParameters) -> NDArray[np.bool_]:
    """Whether the true value lies within a one-sided interval, (|θ_s|,) bool; False without."""
    values = parameter_vector(true.extended(learned.materials))
    low, high = learned.intervals.T
    return np.asarray((low <= values) & (values <= high))


def share_within(found: Sequence[Coverage]) -> float | None:
    """Return the share of all identified parameters within two deviations; None without any."""
    identified = sum(each.identified for each in found)
    return sum(each.within for each in found) / identified if identified else None


def identified_of_active(found: Sequence[Coverage]) -> str:
    """Return "n of m": identified parameters of those that the observations could depend on."""
    return f"{sum(each.identified for each in found)} of {sum(each.active for each in found)}"


def is_honest(share: float | None) -> bool:
    """Whether a share within two deviations is one that honest deviations give."""
    return share is not None and LEAST_WITHIN <= share <= MOST_WITHIN
