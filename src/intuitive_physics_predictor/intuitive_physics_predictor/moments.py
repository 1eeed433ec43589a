"""Mean and covariance of weighted samples of points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation.kernels import entry

BLOCK = 64
"""Points that are taken together: those of 500 samples stay in the cache for the second sweep."""


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
    flat = np.require(points, np.float64, ["C", "W"]).reshape(weights.size, -1, 3)
    mean = np.zeros((flat.shape[1], 3))
    covariance = np.zeros((flat.shape[1], 3, 3))
    _moments(flat, np.require(weights, np.float64, ["C", "W"]), mean, covariance)
    return mean.reshape(*shape, 3), covariance.reshape(*shape, 3, 3)


@entry
def _moments(points: Any, weights: Any, mean: Any, covariance: Any) -> None:
    """Add up mean (n, 3), then covariance (n, 3, 3), which are zero before."""
    samples, count = points.shape[0], points.shape[1]
    for first in range(0, count, BLOCK):
        last = min(first + BLOCK, count)
        for s in range(samples):
            w = weights[s]
            for k in range(first, last):
                mean[k, 0] += w * points[s, k, 0]
                mean[k, 1] += w * points[s, k, 1]
                mean[k, 2] += w * points[s, k, 2]
        for s in range(samples):
            w = weights[s]
            for k in range(first, last):
                x = points[s, k, 0] - mean[k, 0]
                y = points[s, k, 1] - mean[k, 1]
                z = points[s, k, 2] - mean[k, 2]
                covariance[k, 0, 0] += w * x * x
                covariance[k, 0, 1] += w * x * y
                covariance[k, 0, 2] += w * x * z
                covariance[k, 1, 1] += w * y * y
                covariance[k, 1, 2] += w * y * z
                covariance[k, 2, 2] += w * z * z
        for k in range(first, last):
            covariance[k, 1, 0] = covariance[k, 0, 1]
            covariance[k, 2, 0] = covariance[k, 0, 2]
            covariance[k, 2, 1] = covariance[k, 1, 2]
