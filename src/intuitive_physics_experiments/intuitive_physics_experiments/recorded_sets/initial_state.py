"""Initial state θ_d of a recorded ball by least squares over points in free flight."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    POSITION,
    ObjectState,
)
from intuitive_physics.validation import finite_array, increasing_times

UNKNOWN_SPIN = 30.0
"""rad/s, standard deviation of a spin that nobody measured."""

SMALLEST_NOISE = 5e-4
"""m; points that fit better than this fit by chance."""


def fit_initial_state(times: ArrayLike, positions: ArrayLike, gravity: ArrayLike) -> ObjectState:
    """Fit x(t) = x₀ + v₀ t + g t² / 2 to points (n, 3) m in free flight at times (n,) s, n ≥ 2.

    Three points are the paper's choice; more points average more noise but feel more of what the
    model lacks, such as air drag. The covariance counts both: it comes from the residuals, and
    neighbours whose residuals go together count as fewer points. The state is that of the first
    time; the spin is zero with the standard deviation `UNKNOWN_SPIN`.
    """
    t = increasing_times(times, "times of free flight")
    x = finite_array(positions, "positions of free flight", (t.size, 3))
    if t.size < 2:
        raise InvalidInputError(f"free flight has {t.size} points; expected at least 2")
    since = t - t[0]
    falling = 0.5 * since[:, None] ** 2 * finite_array(gravity, "gravity", (3,))
    design = np.column_stack([np.ones_like(since), since])
    solution, *_ = np.linalg.lstsq(design, x - falling, rcond=None)
    residuals = x - falling - design @ solution
    variance = noise_variance(residuals, parameters=2)
    inverse = np.linalg.inv(design.T @ design)
    covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
    covariance[POSITION, POSITION] = np.diag(variance * inverse[0, 0])
    covariance[LINEAR_VELOCITY, LINEAR_VELOCITY] = np.diag(variance * inverse[1, 1])
    covariance[POSITION, LINEAR_VELOCITY] = np.diag(variance * inverse[0, 1])
    covariance[LINEAR_VELOCITY, POSITION] = np.diag(variance * inverse[0, 1])
    covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = UNKNOWN_SPIN**2 * np.eye(3)
    return ObjectState(solution[0], linear_velocity=solution[1], covariance=covariance)


def noise_variance(residuals: NDArray[np.float64], parameters: int) -> NDArray[np.float64]:
    """Variance (3,) m² of a point on each axis, as if neighbours were independent.

    Residuals (n, 3) m are of points along one track; `parameters` were fitted on each axis.
    """
    n = len(residuals)
    freedom = max(n - parameters, 1)
    variance = np.maximum((residuals**2).sum(axis=0) / freedom, SMALLEST_NOISE**2)
    if n <= 4:
        return variance
    lagged = (residuals[1:] * residuals[:-1]).sum(axis=0)
    correlation = np.clip(lagged / np.maximum((residuals**2).sum(axis=0), 1e-300), 0.0, 0.95)
    # A first-order autoregressive series of n points is worth n (1 - ρ) / (1 + ρ).
    return variance * (1.0 + correlation) / (1.0 - correlation)
