"""Information on θ_s with larger standard deviations, along the same combinations of parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import LARGEST_DEVIATION, UNIFORM_PRECISION


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
    lacking = np.where(least < LARGEST_DEVIATION, least**2 - np.diag(covariance), 0.0)
    # Information that is lost by an additional error, without inverting what is almost exact.
    lacking = np.maximum(lacking, 0.0)
    if not lacking.any():
        return wider
    return np.asarray(np.linalg.inv(covariance + np.diag(lacking)) - bounds)


def information_about(
    information: NDArray[np.float64], apart: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the information about a point beside the mean, by the mean square distance from it.

    With the covariance C that is C + d dᵀ, whose inverse follows from that of C by the formula of
    Sherman and Morrison.

    `information` (n, n) per width², without that of the bounds; `apart` (n,) d, widths, the point
    less the mean. Returns (n, n) per width².
    """
    pull = (information + UNIFORM_PRECISION * np.eye(apart.size)) @ apart
    return np.asarray(information - np.outer(pull, pull) / (1.0 + apart @ pull))
