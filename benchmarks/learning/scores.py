"""How far a learned θ_s is from the true one: excess of J, and errors in stated deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace, parameter_vector, shrink

WITHIN = 2.0  # standard deviations within which the true value of an identified parameter is to lie
# Shares of identified parameters within two standard deviations between which deviations are
# honest: a normal distribution has 0.954
LEAST_WITHIN, MOST_WITHIN = 0.90, 0.99


def excess(learned: float, oracle: float, default: float) -> float:
    """Return (J_learned - J_oracle) / (J_default - J_oracle).

    0 is as good as the true θ_s, 1 as bad as the untouched defaults. Where the defaults are no
    worse than the true θ_s there is nothing to gain: then it is 0 for what is no worse than the
    true θ_s, and infinite for what is worse.
    """
    if default <= oracle:
        return 0.0 if learned <= oracle else float("inf")
    return (learned - oracle) / (default - oracle)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Errors of the identified parameters of one set, on the scale of the search.

    That scale is logarithmic for densities and rolling friction. Active parameters are those that
    the observations could depend on.
    """

    # (n_identified,) error over the stated standard deviation; 0 where the true value lies within a
    # stated one-sided interval
    scores: NDArray[np.float64]
    errors: NDArray[np.float64]  # (n_identified,) in widths of the bounds, at least 0
    active: int

    @property
    def within(self) -> int:
        """Number of identified parameters within two standard deviations of the true value."""
        return int(np.sum(np.abs(self.scores) <= WITHIN))

    @property
    def identified(self) -> int:
        """Number of identified parameters."""
        return int(self.scores.size)

    @property
    def mean_error(self) -> float | None:
        """Mean error of the identified parameters in widths; None where none is identified."""
        return float(self.errors.mean()) if self.identified else None


def coverage(
    learned: LearnedParameters, true: StaticParameters, active: NDArray[np.bool_]
) -> Coverage:
    """Compare each identified active parameter with the truth; active is (|θ_s|,) bool."""
    space = ParameterSpace(learned.materials)
    stated = parameter_vector(learned.parameters)
    values = parameter_vector(true.extended(learned.materials))
    counted = learned.identified & active
    errors = (_places(space, stated) - _places(space, values))[counted]
    deviations = (learned.standard_deviations / space.own_slopes(stated))[counted]
    low, high = learned.intervals.T
    # An interval is NaN, and no value lies within it, where none is stated.
    within_interval = (low <= values) & (values <= high)
    scores = np.where(within_interval[counted], 0.0, errors / deviations)
    return Coverage(scores, np.abs(errors), int(active.sum()))


def _places(space: ParameterSpace, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where each parameter (|θ_s|,) lies within its own bounds, from 0 to 1."""
    of_kinds = zip(space.kinds, values, strict=True)
    return np.array([shrink(value, space.bounds[kind]) for kind, value in of_kinds])


def share_within(coverages: Sequence[Coverage]) -> float | None:
    """Return the share of all identified parameters within two deviations; None without any."""
    identified = sum(each.identified for each in coverages)
    return sum(each.within for each in coverages) / identified if identified else None


def rounded_share(share: float | None) -> float | None:
    """Return a share as the last line has it; None where there is none."""
    return None if share is None else round(share, 3)


def identified_of_active(coverages: Sequence[Coverage]) -> str:
    """Return "n of m": identified parameters of the active ones."""
    return f"{sum(e.identified for e in coverages)} of {sum(e.active for e in coverages)}"


def dishonest(coverages: Sequence[Coverage]) -> list[str]:
    """Return the complaint where the share within two deviations is not that of honest ones."""
    share = share_within(coverages)
    if share is not None and LEAST_WITHIN <= share <= MOST_WITHIN:
        return []
    shown = "nothing is identified" if share is None else f"{share:.3f}"
    return [f"within_2_sigma: {shown}, bar {LEAST_WITHIN:g} to {MOST_WITHIN:g}"]
