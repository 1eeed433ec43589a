"""Whether stated uncertainties are true: fits to two halves of the observations are looked at.

Slopes at an estimate tell how well the data hold it there, not whether it settled beside a better
one, as fits to chaotic motion may. Two halves share no observation, so such errors of theirs have
nothing in common: they lie about the estimate by as much as it is wrong. Were all slopes right and
the halves as good as each other, the estimate u would be the mean of the halves' estimates a and b,
and a - u have the variance σ_a² - σ_u² = σ_a² / 2, that of u. By how much

    r² = mean over the halves that tell anything of (a - u)² / (σ_a² / 2)

is more than one, uncertainties are widened. Nor can all the data tell more than both halves
together: where slopes at u alone are sharp, it is the place that is peculiar.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.noise import NORMAL_MEDIAN
from intuitive_physics_learner.search.identifiability import LARGEST_DEVIATION

PRIOR_DISAGREEMENTS = 3.0
"""A parameter's own family of disagreements counts against this many of all parameters."""

BEYOND_CHANCE = 2.0
"""From this r on, how far the halves lie from the estimate is itself the uncertainty."""


@dataclass(frozen=True, eq=False)
class Half:
    """What a fit to half of the observations found.

    Parameters
    ----------
    unit : (n,) its estimate on the unit cube
    deviations : (n,) standard deviation of each parameter by its slopes
    """

    unit: NDArray[np.float64]
    deviations: NDArray[np.float64]


def agreed_deviations(
    unit: NDArray[np.float64],
    deviations: NDArray[np.float64],
    halves: tuple[Half, Half],
    families: Sequence[NDArray[np.int64]],
) -> NDArray[np.float64]:
    """Standard deviations (n,) on the unit cube with which both halves agree.

    Parameters
    ----------
    unit : (n,) the estimate from all observations
    deviations : (n,) standard deviation of each parameter by slopes
    families : indices of parameters that are likely to err alike, each parameter in one
    """
    apart = np.array([(half.unit - unit) ** 2 for half in halves])
    variances = np.array([half.deviations for half in halves]) ** 2
    told = variances < LARGEST_DEVIATION**2
    ratios = np.sqrt(_mean(apart / (0.5 * variances), told))
    pooled = (1.0 / variances).sum(axis=0) ** -0.5
    agreed = np.maximum(deviations * _family_factors(ratios, families), pooled)
    scatter = np.sqrt(_mean(apart, told))
    return np.where(ratios > BEYOND_CHANCE, np.maximum(agreed, scatter), agreed)


def _mean(values: NDArray[np.float64], counted: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Mean (n,) over the halves of values (2, n) that count; NaN where none does."""
    total = np.where(counted, values, 0.0).sum(axis=0)
    count = counted.sum(axis=0)
    return np.divide(total, count, out=np.full(total.size, np.nan), where=count > 0)


def _family_factors(
    ratios: NDArray[np.float64], families: Sequence[NDArray[np.int64]]
) -> NDArray[np.float64]:
    """Factors (n,) of at least one from ratios (n,), NaN where no half tells anything."""
    known = np.isfinite(ratios)
    factors = np.ones(ratios.size)
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
