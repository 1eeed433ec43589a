"""Mean and covariance of the distribution that weighted samples of points were drawn from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import entry, inlined

BLOCK = 384
"""Numbers, whole points, whose sums are taken together."""

SMALLEST_PART = 1e-12
"""1 - 1/n below which there is but one sample: rounding alone leaves 1e-16 per sample."""


def weighted_moments(
    points: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean and the covariance, both without bias.

    The sum of squared deviations from the samples' own mean is too small by the part 1/n, n being
    the effective number of samples, 1 / Σ w²; the covariance is divided by 1 - 1/n. One sample
    says nothing of a spread: its covariance is 0.

    Parameters
    ----------
    points : (n_samples, …, 3) m
    weights : (n_samples,), summing to one

    Returns
    -------
    mean : (…, 3) m
    covariance : (…, 3, 3) m²
    """
    shape = points.shape[1:-1]
    flat = np.require(points, np.float64, ["C", "W"]).reshape(weights.size, -1)
    size = flat.shape[1]
    mean, covariance = np.empty(size), np.empty((size // 3, 3, 3))
    weights = np.require(weights, np.float64, ["C", "W"])
    left = 1.0 - float(weights @ weights)
    scale = 1.0 / left if left > SMALLEST_PART else 0.0
    _moments(flat, weights, scale, np.empty((5, BLOCK + 2)), mean, covariance)
    return mean.reshape(*shape, 3), covariance.reshape(*shape, 3, 3)


@entry
def _moments(points: Any, weights: Any, scale: Any, room: Any, mean: Any, covariance: Any) -> None:
    """Write the mean (3 n,) of points (n_samples, 3 n) and their covariance (n, 3, 3).

    Both are added up from where the points are apart from the first sample, so that numbers which
    are large beside their spread lose no digits, in one way through the memory. What is added up
    for a block of points stays in the processor's nearest cache.

    Parameters
    ----------
    scale : factor on the covariance of the samples themselves
    room : (5, BLOCK + 2) scratch
    """
    samples, size = points.shape
    for first in range(0, size, BLOCK):
        count = min(BLOCK, size - first)
        room[:] = 0.0
        for s in range(samples):
            part = points[s, first : first + count]
            _add_up(part, points[0, first : first + count], weights[s], room)
        _write(points[0], room, scale, first, count, mean, covariance)


@inlined
def _add_up(points: Any, origin: Any, weight: Any, room: Any) -> None:
    """Add one sample's block of numbers to the sums of them and of their products.

    Number j is coordinate j % 3 of point j // 3. Each times itself, the next and the one after make
    all products of a point's coordinates, and some of two points' that are not needed: so every
    loop runs over numbers that lie side by side, which the compiler takes several at a time.
    """
    apart, total, own, next_one, after_next = room[0], room[1], room[2], room[3], room[4]
    for j in range(points.size):
        apart[j] = points[j] - origin[j]
    for j in range(points.size):
        weighted = weight * apart[j]
        total[j] += weighted
        own[j] += weighted * apart[j]
        next_one[j] += weighted * apart[j + 1]
        after_next[j] += weighted * apart[j + 2]


@inlined
def _write(
    origin: Any, room: Any, scale: Any, first: Any, count: Any, mean: Any, covariance: Any
) -> None:
    """Write the moments of a block of numbers from its sums: scale (E[a b] - E[a] E[b])."""
    total, own, next_one, after_next = room[1], room[2], room[3], room[4]
    for j in range(count):
        mean[first + j] = origin[first + j] + total[j]
    for j in range(0, count, 3):
        matrix = covariance[(first + j) // 3]
        x, y, z = total[j], total[j + 1], total[j + 2]
        matrix[0, 0] = scale * (own[j] - x * x)
        matrix[1, 1] = scale * (own[j + 1] - y * y)
        matrix[2, 2] = scale * (own[j + 2] - z * z)
        matrix[0, 1] = matrix[1, 0] = scale * (next_one[j] - x * y)
        matrix[1, 2] = matrix[2, 1] = scale * (next_one[j + 1] - y * z)
        matrix[0, 2] = matrix[2, 0] = scale * (after_next[j] - x * z)
