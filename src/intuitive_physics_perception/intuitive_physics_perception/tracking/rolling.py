"""Angular velocity of a ball: known where it rolls, else unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.tracking.motion_fits import fitted_acceleration

ROLLING_TIME = 0.2
"""Time on a surface without losing speed to friction after which a ball rolls, s: one that slides
at μ = 0.1 is 5 mm behind by then, and rolls itself 2 v / 7 μ g after it began."""

ROLLING_DECELERATION = 0.6
"""Difference from the acceleration of rolling, m/s²: more than rolling resistance and another κ
make, less than sliding friction makes; half of it must be visible."""

ROLLING_SIGMAS = 2.0
"""Standard deviations of that difference by which noise may exceed it."""

ROLLING_SLIP = 0.1
"""Standard deviation of the slip of a rolling ball, as a part of its speed."""

ENOUGH = 0.7
"""Part of a time that points of it must span, as frames do not begin and end with it."""


LONGER = 1.3
"""Factor from one time that is tried to the next longer one: noise falls by half."""


def unknown_angular_velocity(deviation: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,) rad/s and covariance (3, 3) of an unknown angular velocity."""
    return np.zeros(3), deviation**2 * np.eye(3)


def rolling_angular_velocity(
    velocity: NDArray[np.float64],
    covariance: NDArray[np.float64],
    radius: float,
    normal: NDArray[np.float64],
    deviation: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,) rad/s and covariance (3, 3) of the angular velocity of a rolling ball.

    The point of contact stands still, v - r ω × n = 0, so ω = n × v / r; the component along the
    normal stays unknown.

    `velocity` (3,) m/s; `radius` in m; `normal` (3,) unit vector of the plane; `deviation` in
    rad/s, standard deviation of an unknown angular velocity.
    """
    turn = np.cross(normal, np.eye(3)).T / radius
    slip = ROLLING_SLIP * float(np.linalg.norm(velocity)) / radius
    along = np.outer(normal, normal)
    spread = turn @ covariance @ turn.T + slip**2 * (np.eye(3) - along) + deviation**2 * along
    return turn @ velocity, spread


def rolls(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    expected: NDArray[np.float64],
) -> bool:
    """Return whether an object on a surface rolls and does not slide.

    The shortest time up to the last point is taken in which friction would be visible.

    `times` (n,) s, on the surface; `places` (n, 3) m; `noise` (n, 3, 3) m², covariances of the
    points; `expected` (3,) m/s² of rolling there.
    """
    limit, duration = ROLLING_DECELERATION, ENOUGH * ROLLING_TIME
    if len(times) < 3 or times[-1] - times[0] < duration:
        return False
    while True:
        before = int(np.searchsorted(times, times[-1] - duration, side="right")) - 1
        first = max(0, min(before, len(times) - 3))
        fitted, spread, _ = fitted_acceleration(times[first:], places[first:], noise[first:])
        deviation = float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))
        if deviation < 0.5 * limit or first == 0:
            off = float(np.linalg.norm(fitted - expected))
            return off < limit + ROLLING_SIGMAS * deviation
        duration *= LONGER
