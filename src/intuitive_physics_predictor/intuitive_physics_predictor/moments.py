"""Mean and covariance of weighted samples of points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation.kernels import entry


def weighted_moments(
    points: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean and the covariance over samples.

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
    mean, apart, products = np.zeros(size), np.zeros(size + 2), np.zeros((3, size))
    covariance = np.empty((size // 3, 3, 3))
    weights = np.require(weights, np.float64, ["C", "W"])
    _moments(flat, weights, mean, apart, *products, covariance)
    return mean.reshape(*shape, 3), covariance.reshape(*shape, 3, 3)


@entry
def _moments(
    points: Any,
    weights: Any,
    mean: Any,
    apart: Any,
    own: Any,
    next_one: Any,
    after_next: Any,
    covariance: Any,
) -> None:
    """Add up the mean (3 n,) of points (n_samples, 3 n), then write their covariance (n, 3, 3).

    Number j is coordinate j % 3 of point j // 3. Each times itself, the next and the one after make
    all products of a point's coordinates, and some of two points' that nobody asks for: so every
    loop runs over numbers that lie side by side, which the compiler takes several at a time.

    Parameters
    ----------
    mean, own, next_one, after_next : (3 n,), zero before, as is apart (3 n + 2,)
    """
    samples, size = points.shape
    for s in range(samples):
        w = weights[s]
        for j in range(size):
            mean[j] += w * points[s, j]
    for s in range(samples):
        w = weights[s]
        for j in range(size):
            apart[j] = points[s, j] - mean[j]
        for j in range(size):
            weighted = w * apart[j]
            own[j] += weighted * apart[j]
            next_one[j] += weighted * apart[j + 1]
            after_next[j] += weighted * apart[j + 2]
    for k in range(size // 3):
        matrix, j = covariance[k], 3 * k
        matrix[0, 0], matrix[1, 1], matrix[2, 2] = own[j], own[j + 1], own[j + 2]
        matrix[0, 1] = matrix[1, 0] = next_one[j]
        matrix[1, 2] = matrix[2, 1] = next_one[j + 1]
        matrix[0, 2] = matrix[2, 0] = after_next[j]
