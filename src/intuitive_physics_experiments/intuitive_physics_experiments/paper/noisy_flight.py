"""Initial states θ_d from points of known noise: a few, or all before the first bounce."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.state import ERROR_SIZE, LINEAR_VELOCITY, POSITION
from intuitive_physics.validation import finite_array, increasing_times, positive_float

FEWEST_POINTS = 3
"""That a flight is fitted to."""

SURPRISE = 16.3
"""χ² of three degrees of freedom that free flight exceeds once in a thousand points."""


def flight_length(times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, noise: float) -> int:
    """Count the points from the first one that free flight explains, at least three.

    A point is a surprise when it lies further from where the points before it send the object than
    noise does. The one before the surprise is left out too: the bounce may have begun there.

    Parameters
    ----------
    times : (n,) s, n ≥ 3, strictly increasing
    positions : (n, 3) m
    gravity : (3,) m/s²
    noise : m, standard deviation of a point on each axis
    """
    t, level = _levelled(times, positions, gravity)
    sigma = positive_float(noise, "noise")
    for count in range(FEWEST_POINTS, t.size):
        start, inverse = _fit(t[:count], level[:count])
        row = np.array([1.0, t[count]])
        variance = sigma**2 * (1.0 + row @ inverse @ row)
        if np.sum((level[count] - row @ start) ** 2) > SURPRISE * variance:
            return max(count - 1, FEWEST_POINTS)
    return int(t.size)


def fit_noisy_flight(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, noise: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Fit x(t) = x₀ + v₀ t + g t² / 2 by least squares to points with known noise.

    Parameters
    ----------
    times : (n,) s, n ≥ 3, strictly increasing
    positions : (n, 3) m
    gravity : (3,) m/s²
    noise : m, standard deviation of a point on each axis

    Returns
    -------
    position, velocity : (3,) m and m/s, at `times[0]`
    covariance : (12, 12) as that of an `ObjectState`; rotation and spin are left zero
    """
    t, level = _levelled(times, positions, gravity)
    start, inverse = _fit(t, level)
    inverse *= positive_float(noise, "noise") ** 2
    covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
    parts = (POSITION, LINEAR_VELOCITY)
    for i, row in enumerate(parts):
        for k, column in enumerate(parts):
            covariance[row, column] = inverse[i, k] * np.eye(3)
    return start[0], start[1], covariance


def _levelled(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times from the first on, and positions as they would be without gravity."""
    t = increasing_times(times, "times of flight")
    x = finite_array(positions, "positions of flight", (t.size, 3))
    if t.size < FEWEST_POINTS:
        raise InvalidInputError(f"flight has {t.size} points; expected at least {FEWEST_POINTS}")
    since = t - t[0]
    return since, x - 0.5 * since[:, None] ** 2 * finite_array(gravity, "gravity", (3,))


def _fit(
    t: NDArray[np.float64], level: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    design = np.column_stack([np.ones_like(t), t])
    inverse = np.linalg.inv(design.T @ design)
    return inverse @ design.T @ level, inverse
