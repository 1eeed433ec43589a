"""Angular velocity of a ball: known where it rolls, else unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def unknown_angular_velocity(
    deviation: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,) rad/s and covariance (3, 3) of an unknown angular velocity."""
    return np.zeros(3), deviation**2 * np.eye(3)


def rolling_angular_velocity(
    velocity: NDArray[np.float64],
    covariance: NDArray[np.float64],
    radius: float,
    normal: NDArray[np.float64],
    deviation: float,
    rolling_slip: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,) rad/s and covariance (3, 3) of the angular velocity of a rolling ball.

    The point of contact stands still, v - r ω × n = 0, so ω = n × v / r; the component
    along the normal stays unknown.

    Parameters
    ----------
    velocity : (3,) m/s
    covariance : (3, 3) m²/s², of the velocity
    radius : m
    normal : (3,) unit vector of the plane
    deviation : rad/s, standard deviation of an unknown angular velocity
    rolling_slip : standard deviation of the slip, as a part of the speed
    """
    turn = np.cross(normal, np.eye(3)).T / radius
    slip = rolling_slip * float(np.linalg.norm(velocity)) / radius
    along = np.outer(normal, normal)
    spread = turn @ covariance @ turn.T + slip**2 * (np.eye(3) - along) + deviation**2 * along
    return turn @ velocity, spread


def loses_no_speed(
    times: NDArray[np.float64], velocities: NDArray[np.float64], deceleration: float
) -> bool:
    """Whether an object rolls and does not slide.

    Parameters
    ----------
    times : (n,) s
    velocities : (n, 3) m/s
    deceleration : m/s², less than what sliding friction takes
    """
    since = times - times.mean()
    slope = since @ velocities / (since @ since)
    return bool(np.linalg.norm(slope) < deceleration)
