"""Quantiles of normal distributions that are cut off at two ends, exact far out in their tails."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp

FAR = -30.0
"""Standard deviations from the mean: probabilities of tails that begin farther out are computed as
logarithms. (A double underflows at -38.)"""

FLAT = 1e-6
"""Width times the root of the precision from which on a density counts as flat: over such a width
it changes by less than rounding of the quantiles."""


def truncated_normal_quantiles(
    shares: ArrayLike,
    mean: ArrayLike,
    deviation: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
) -> NDArray[np.float64]:
    """Return quantiles of normal distributions cut off at two ends; all arrays are broadcast.

    Parameters
    ----------
    shares : (…) probabilities below the quantiles
    mean : (…) of any unit, as all below, before and not after the ends are cut off
    deviation : (…) above zero; where it is infinite, the distribution is uniform between the ends
    lower, upper : (…) ends, lower ≤ upper; the mean may lie outside

    Returns
    -------
    (…), in the unit of the mean, never outside the ends
    """
    shares, mean, deviation, lower, upper = np.broadcast_arrays(
        *(np.asarray(each, dtype=np.float64) for each in (shares, mean, deviation, lower, upper))
    )
    flat = (upper - lower) <= FLAT * deviation
    flat &= np.abs(0.5 * (upper + lower) - mean) * (upper - lower) <= FLAT * deviation**2
    scale = np.where(flat, 1.0, deviation)
    low, high = (lower - mean) / scale, (upper - mean) / scale
    # Mirrored, the greater part lies below the mean, where probabilities are exact.
    mirrored = low + high > 0.0
    below, above = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    part = np.where(mirrored, 1.0 - shares, shares)
    first = ndtr(below)
    places = np.asarray(ndtri(first + part * (ndtr(above) - first)))
    far = (above < FAR) & ~flat
    if far.any():
        with np.errstate(divide="ignore"):
            logarithms = np.logaddexp(
                log_ndtr(below[far]) + np.log1p(-part[far]),
                log_ndtr(above[far]) + np.log(part[far]),
            )
        places[far] = ndtri_exp(logarithms)
    quantiles = mean + scale * np.where(mirrored, -places, places)
    quantiles = np.where(flat, lower + shares * (upper - lower), quantiles)
    return np.asarray(np.minimum(np.maximum(quantiles, lower), upper))


def log_normal_mass(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the logarithm of what a standard normal distribution has between two ends.

    Parameters
    ----------
    low, high : (…) ends in standard deviations from the mean

    Returns
    -------
    (…), minus infinity where low is not below high
    """
    mirrored = low + high > 0.0
    below = log_ndtr(np.where(mirrored, -high, low))
    above = log_ndtr(np.where(mirrored, -low, high))
    with np.errstate(divide="ignore", invalid="ignore"):
        mass = above + np.log(-np.expm1(below - above))
    return np.where(high > low, mass, -np.inf)


def flat_interval_quantiles(
    shares: ArrayLike,
    slope: ArrayLike,
    precision: ArrayLike,
    interval: tuple[ArrayLike, ArrayLike],
    ends: tuple[ArrayLike, ArrayLike],
) -> NDArray[np.float64]:
    """Return quantiles of distributions that are flat within an interval and fall outside.

    With the distance d from the interval (below it negative, within it zero) the logarithm of the
    density is - precision d² / 2 - slope d: in three pieces, one flat and two of normal
    distributions. All arrays are broadcast.

    Parameters
    ----------
    shares : (…) probabilities below the quantiles
    slope : (…) per unit
    precision : (…) per unit²; zero: the density is flat everywhere
    interval : its two ends, (…) each
    ends : two ends (…) at which the distribution is cut off

    Returns
    -------
    (…), never outside `ends`
    """
    shares, slope, precision, first, last, lower, upper = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.float64) for v in (shares, slope, precision, *interval, *ends))
    )
    flat = precision * (upper - lower) ** 2 <= FLAT**2
    deviation = 1.0 / np.sqrt(np.where(flat, 1.0, precision))
    offset = np.where(flat, 0.0, slope) * deviation**2
    cuts = [lower, np.clip(first, lower, upper), np.clip(last, lower, upper), upper]
    means = (first - offset, last - offset)
    peak = 0.5 * (offset / deviation) ** 2 + np.log(deviation * np.sqrt(2.0 * np.pi))
    with np.errstate(divide="ignore"):
        masses = np.array(
            [
                peak
                + log_normal_mass(
                    (cuts[0] - means[0]) / deviation, (cuts[1] - means[0]) / deviation
                ),
                np.log(cuts[2] - cuts[1]),
                peak
                + log_normal_mass(
                    (cuts[2] - means[1]) / deviation, (cuts[3] - means[1]) / deviation
                ),
            ]
        )
    masses = np.where(np.isfinite(masses).any(axis=0), masses, 0.0)
    weights = np.exp(masses - masses.max(axis=0))
    weights /= weights.sum(axis=0)
    before = np.array([np.zeros_like(shares), weights[0], weights[0] + weights[1]])
    piece = (shares >= before[1]).astype(int) + (shares >= before[2])
    piece = np.where(np.take_along_axis(weights, piece[None], axis=0)[0] > 0.0, piece, 1)
    begin, weight = (np.take_along_axis(v, piece[None], axis=0)[0] for v in (before, weights))
    within = np.clip((shares - begin) / np.maximum(weight, np.finfo(float).tiny), 0.0, 1.0)
    quantiles = truncated_normal_quantiles(
        within,
        np.where(piece == 0, *means),
        np.where(piece == 1, np.inf, deviation),
        np.choose(piece, cuts[:3]),
        np.choose(piece, cuts[1:]),
    )
    return np.where(flat, lower + shares * (upper - lower), quantiles)
