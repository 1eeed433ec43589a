"""Whether stated uncertainties are true: fits to two halves of the observations are looked at.

Slopes at an estimate tell how well the data hold it there, not whether it settled beside a better
one, as fits to chaotic motion may. Two halves share no observation, so such errors of theirs have
nothing in common: they lie about the estimate by as much as it is wrong. Were all slopes right, the
estimate u would be the mean of the halves' estimates a and b, weighted by 1/σ_a² and 1/σ_b², so

    s² = ((a - u)² + (b - u)²) / 2,    E s² = (σ_a⁴ + σ_b⁴) / (2 (σ_a² + σ_b²)),

the variance of u where the halves are as good as each other. By how much s is more than expected,
uncertainties are widened. Nor can all the data tell more than both halves together: where slopes
at u alone are sharp, it is the place that is peculiar.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.identifiability import LARGEST_DEVIATION

PRIOR_DISAGREEMENTS = 3.0
"""A parameter's own family of disagreements counts against this many of all parameters."""

NORMAL_MEDIAN = 0.6745
"""Median of |x| for x of the standard normal distribution."""

BEYOND_CHANCE = 2.0
"""Of its expectation, from which on s itself is the uncertainty."""


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
    first, second = halves
    scatter = np.sqrt(0.5 * ((first.unit - unit) ** 2 + (second.unit - unit) ** 2))
    variances = np.array([first.deviations, second.deviations]) ** 2
    expected = np.sqrt((variances**2).sum(axis=0) / (2.0 * variances.sum(axis=0)))
    told = (first.deviations < LARGEST_DEVIATION) & (second.deviations < LARGEST_DEVIATION)
    ratios = np.where(told, scatter / expected, np.nan)
    pooled = (1.0 / variances).sum(axis=0) ** -0.5
    agreed = np.maximum(deviations * _family_factors(ratios, families), pooled)
    return np.where(ratios > BEYOND_CHANCE, np.maximum(agreed, scatter), agreed)


def _family_factors(
    ratios: NDArray[np.float64], families: Sequence[NDArray[np.int64]]
) -> NDArray[np.float64]:
    """Factors (n,) of at least one from ratios (n,), NaN where a half tells nothing."""
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
