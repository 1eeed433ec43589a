"""Uncertainties that are wider than slopes at an estimate say, and what is then known.

Slopes at an estimate u of all observations say how well these hold it there, not whether it settled
beside a better one. Let a share h of them have the estimate a of the standard deviation σ_a. Were
all slopes right, u would be the mean of a and of what the others say, which share no observation
with those, each as informative as it has observations; and a - u would have the variance
(1 - h) σ_a². By how much

    r² = (a - u)² / ((1 - h) σ_a²)

is more than one, uncertainties are widened (`agreed_deviations`). Nor can all be more informative
than parts like this one together, if it has that share of the observations of each parameter: then
σ² is at least h σ_a². Where the curvature at u alone is higher, u is a peculiar place.

Where knowledge rests on one observation whose linearisation may be wrong, the uncertainty is the
one without it (`jackknife_variances`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import LARGEST_DEVIATION, UNIFORM_PRECISION
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood
from intuitive_physics_learner.search.search_space import ActiveSpace

FAMILY_WEIGHT = 3.0
"""Number of parameters as which the typical disagreement of the half counts against that of a
parameter's own family; set by hand."""

LARGEST_CHANCE_RATIO = 2.0
"""Ratio of the half's distance from the estimate to its expectation beyond which that distance is
itself the uncertainty; set by hand."""

PLACES = 101
"""Places along an axis of the unit cube at which a distribution is evaluated."""

NORMAL_MEDIAN = 0.6745
"""Median of |x| for x of the standard normal distribution."""


def agreed_deviations(
    unit: NDArray[np.float64],
    deviations: NDArray[np.float64],
    part: Gaussian,
    families: Sequence[NDArray[np.int64]],
    free: NDArray[np.float64] | None = None,
    *,
    share: float = 0.5,
    balanced: bool = True,
) -> NDArray[np.float64]:
    """Standard deviations (n,), in widths, with which part of the observations agrees.

    Parameters
    ----------
    unit : (n,) the estimate from all observations, on the unit cube
    deviations : (n,) widths, standard deviation of each parameter
    part : what part of the observations says
    families : (n_members,) each, indices of parameters that are likely to err alike, each parameter
        in one
    free : (n, 2) widths, how far parameters that are bound to one side only can be moved down and
        up, 0 for others; None: all are bound to both
    share : of all observations that the part has
    balanced : whether it has as large a share of those that depend on each parameter
    """
    free = np.zeros((unit.size, 2)) if free is None else free
    apart = np.abs(part.mean - np.clip(part.mean, unit - free[:, 0], unit + free[:, 1]))
    # Part of the observations cannot know more than all do: slopes that say so are peculiar.
    widest = np.maximum(part.deviations, deviations)
    expected = np.sqrt(1.0 - share) * widest
    ratios = np.where(part.deviations < LARGEST_DEVIATION, apart / expected, np.nan)
    agreed = deviations * _family_factors(ratios, families)
    if balanced:
        # Slopes of a part that lies where the loss is flat say nothing of the end.
        least = np.where(free.any(axis=1), 0.0, np.sqrt(share) * widest)
        agreed = np.maximum(agreed, least)
    beyond_chance = ratios > LARGEST_CHANCE_RATIO
    return np.where(beyond_chance, np.maximum(agreed, apart), agreed)


def _family_factors(
    ratios: NDArray[np.float64], families: Sequence[NDArray[np.int64]]
) -> NDArray[np.float64]:
    """Factors (n,) of at least one from ratios (n,), NaN where the part is not informative."""
    finite = np.isfinite(ratios)
    factors = np.ones(ratios.size)
    if not finite.any():
        return factors
    typical = max(float(np.median(ratios[finite])) / NORMAL_MEDIAN, 1.0)
    for family in families:
        family_ratios = ratios[family][finite[family]]
        total = np.sum(family_ratios**2) + FAMILY_WEIGHT * typical**2
        factors[family] = max(np.sqrt(total / (family_ratios.size + FAMILY_WEIGHT)), 1.0)
    return factors


def jackknife_variances(
    information: Gaussian,
    centre: NDArray[np.float64],
    likelihoods: Sequence[LocalLikelihood],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Variances (n,), widths², of the mean by how it moves without each of some observations.

    With N observations of a parameter, (N - 1) / N Σ (m_without - m)²; 0 where N < 2. `centre` (n,)
    mean where nothing is known; `weights` (n_observations,) with which `information` has them.
    """
    prior = information.bounded(centre)
    squares, counts = np.zeros(centre.size), np.zeros(centre.size)
    for likelihood, weight in zip(likelihoods, weights, strict=True):
        parameters = likelihood.parameters
        precision = np.linalg.inv(prior.covariance[np.ix_(parameters, parameters)])
        pulls = precision @ prior.mean[parameters]
        pulls -= weight * (likelihood.information @ likelihood.estimate - likelihood.scores)
        rest = precision - weight * likelihood.information
        values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
        # The bounds are always known.
        mean = (vectors / np.maximum(values, UNIFORM_PRECISION)) @ (vectors.T @ pulls)
        squares[parameters] += (mean - prior.mean[parameters]) ** 2
        counts[parameters] += 1.0
    return squares * np.maximum(counts - 1.0, 0.0) / np.maximum(counts, 1.0)


def off_the_middle(
    covariance: NDArray[np.float64], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far (n,) in widths the start has pulled an estimate from where the middle would.

    Bounds count as a normal distribution about the start, with the variance of a uniform one. Only
    about the middle it would also have the mean of that.

    `covariance` (n, n) widths², of the posterior; `start` (n,) on the unit cube.
    """
    return np.asarray(UNIFORM_PRECISION * covariance @ (0.5 - start))


def deviations_by_value(
    space: ActiveSpace, unit: NDArray[np.float64], deviations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return standard deviations (n,), in widths, of what is normal in SI units within bounds.

    Motion depends on a parameter by its value, and where that is known to the half of it, hardly
    anything says that it is not a tenth: on a logarithmic axis the distribution has a long tail.

    `unit` (n,) the estimate; `deviations` (n,) widths, by slopes there, than which none is smaller.
    """
    along, wider = np.linspace(0.0, 1.0, PLACES), deviations.copy()
    for axis in np.flatnonzero(deviations > along[1]):
        points = np.tile(unit, (PLACES, 1))
        points[:, axis] = along
        values = np.array([space.values(point)[axis] for point in points])
        here = np.interp(unit[axis], along, values)
        slope = np.interp(unit[axis], along, np.gradient(values, along))
        apart = np.maximum(slope, np.finfo(float).tiny) * deviations[axis]
        likelihoods = np.exp(-0.5 * ((values - here) / apart) ** 2)
        mean_square = np.average((along - unit[axis]) ** 2, weights=likelihoods)
        wider[axis] = max(deviations[axis], np.sqrt(mean_square))
    return wider


def widened_information(
    information: NDArray[np.float64], factors: NDArray[np.float64], least: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return information that is less certain, along the same combinations of parameters.

    Each eigenvector's deviation is multiplied by the root mean square of the factors of its
    parameters, weighted as it consists of them: so combinations that are not known at all stay
    unknown, and well known ones, such as a ratio, are not mixed with them. Then what the marginals
    of identified parameters lack to their deviations is added, as an independent error of each.

    `information` (n, n) per width², without that of the bounds; `factors` (n,) on the standard
    deviation of each parameter; `least` (n,) widths, smallest standard deviation of each parameter.
    Returns (n, n) per width².
    """
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    squares = (vectors**2).T @ factors**2
    wider = (vectors * (np.maximum(values, 0.0) / squares)) @ vectors.T
    bounds = UNIFORM_PRECISION * np.eye(least.size)
    covariance = np.linalg.inv(wider + bounds)
    # Of the marginals without bounds: what is not known at all does not get less known by an error.
    asked = np.where(least < LARGEST_DEVIATION, least, 0.0)
    lacking = _without_bounds(asked**2) - _without_bounds(np.diag(covariance))
    errors = np.sqrt(np.maximum(lacking, 0.0))
    return Gaussian.about(np.zeros(least.size), wider).widened(errors).precision


def _without_bounds(variances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return variances (n,) in width² without what bounds say; infinite where these say all."""
    left = np.maximum(1.0 - UNIFORM_PRECISION * variances, 0.0)
    return np.divide(variances, left, out=np.full_like(variances, np.inf), where=left > 0.0)


def information_about(
    information: NDArray[np.float64], apart: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return information (n, n) per width² about a point by the mean square distance from it.

    `information` (n, n) per width², without that of the bounds; `apart` (n,) d, widths, the point
    less the mean. With the covariance C it is that of C + d dᵀ, by the formula of Sherman and
    Morrison.
    """
    pull = (information + UNIFORM_PRECISION * np.eye(apart.size)) @ apart
    return np.asarray(information - np.outer(pull, pull) / (1.0 + apart @ pull))
