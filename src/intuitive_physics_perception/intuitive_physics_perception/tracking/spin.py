"""How a ball turns: told by its rolling, else unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ROLLING_TIME = 0.2
"""s on a plane without losing speed to friction, after which a ball rolls: one that slides at
μ = 0.1 is 5 mm behind by then, and rolls itself 2 v / 7 μ g after it began."""

ROLLING_DECELERATION = 0.6
"""m/s², more than rolling resistance takes; less than what sliding takes."""

SLIP = 0.1
"""Standard deviation of what a rolling ball may still slip, as a part of its speed."""


def unknown_spin(deviation: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,) and covariance (3, 3) of a spin in rad/s of which nothing is known."""
    return np.zeros(3), deviation**2 * np.eye(3)


def rolling_spin(
    velocity: NDArray[np.float64],
    covariance: NDArray[np.float64],
    radius: float,
    normal: NDArray[np.float64],
    deviation: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,) and covariance (3, 3) of the spin, rad/s, of a ball that rolls on a plane.

    The point of contact stands still, v - r ω × n = 0, so ω = n × v / r; how it turns about the
    normal is not told.

    Parameters
    ----------
    velocity, covariance : (3,) m/s and (3, 3)
    normal : (3,) of the plane
    deviation : rad/s, of a spin of which nothing is known
    """
    turn = np.cross(normal, np.eye(3)).T / radius
    slip = SLIP * float(np.linalg.norm(velocity)) / radius
    along = np.outer(normal, normal)
    spread = turn @ covariance @ turn.T + slip**2 * (np.eye(3) - along) + deviation**2 * along
    return turn @ velocity, spread


def loses_no_speed(times: NDArray[np.float64], velocities: NDArray[np.float64]) -> bool:
    """Whether velocities (n, 3) at times (n,) are of something that rolls and not slides."""
    since = times - times.mean()
    slope = since @ velocities / (since @ since)
    return bool(np.linalg.norm(slope) < ROLLING_DECELERATION)
