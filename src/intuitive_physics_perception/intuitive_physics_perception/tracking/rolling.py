"""Angular velocity of a ball: known where it rolls, else unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.tracking.motion_fits import fitted_acceleration
from intuitive_physics_perception.tracking.settings import MotionSettings

ENOUGH = 0.7
"""Part of a time that points of it must span, as frames do not begin and end with it."""


LONGER = 1.3
"""Factor from one time that is tried to the next longer one: noise falls by half."""


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


def rolls(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    expected: NDArray[np.float64],
    motion: MotionSettings,
) -> bool:
    """Return whether an object on a surface rolls and does not slide.

    The shortest time up to the last point is taken in which friction would be visible.

    Parameters
    ----------
    times : (n,) s, on the surface
    places : (n, 3) m
    noise : (n, 3, 3) m², covariances of the points
    expected : (3,) m/s² of rolling there
    motion : tuned numbers
    """
    limit, duration = motion.rolling_deceleration, ENOUGH * motion.rolling_time
    if len(times) < 3 or times[-1] - times[0] < duration:
        return False
    while True:
        before = int(np.searchsorted(times, times[-1] - duration, side="right")) - 1
        first = max(0, min(before, len(times) - 3))
        found, spread = fitted_acceleration(times[first:], places[first:], noise[first:])
        deviation = float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))
        if deviation < 0.5 * limit or first == 0:
            off = float(np.linalg.norm(found - expected))
            return off < limit + motion.rolling_sigmas * deviation
        duration *= LONGER
