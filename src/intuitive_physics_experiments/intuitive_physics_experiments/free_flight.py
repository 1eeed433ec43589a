"""The baseline of knowing no material: objects fly freely and stop where they first touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.scene import Environment
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import finite_array

SMALLEST_APPROACH = 1e-9


def free_flight(
    environment: Environment, radius: float, state: ObjectState, times: ArrayLike
) -> NDArray[np.float64]:
    """Positions (n, 3) m of a ball that stops at the first plane it reaches.

    Parameters
    ----------
    environment : its planes and gravity count
    radius : m
    state : where the flight begins
    times : (n,) s after the state
    """
    flown = np.minimum(
        finite_array(times, "times", (None,)), _contact_time(environment, radius, state)
    )
    since = flown[:, None]
    return state.position + since * state.linear_velocity + 0.5 * since**2 * environment.gravity


def _contact_time(environment: Environment, radius: float, state: ObjectState) -> float:
    contacts = [
        _time_to_plane(
            float(plane.signed_distances(state.position)) - radius,
            float(plane.normal @ state.linear_velocity),
            float(plane.normal @ environment.gravity),
        )
        for plane in environment.planes
    ]
    return min(contacts, default=np.inf)


def _time_to_plane(distance: float, speed: float, acceleration: float) -> float:
    """First t ≥ 0 with d + s t + a t² / 2 ≤ 0 while approaching; infinite where there is none."""
    if distance <= 0.0 and speed <= SMALLEST_APPROACH:
        return 0.0
    if abs(acceleration) < SMALLEST_APPROACH:
        return distance / -speed if speed < 0.0 and distance > 0.0 else np.inf
    discriminant = speed**2 - 2.0 * acceleration * distance
    if discriminant < 0.0:
        return np.inf
    # At the root where the distance falls, s + a t = -√(s² - 2 a d).
    time = (-np.sqrt(discriminant) - speed) / acceleration
    return float(time) if time > 0.0 else np.inf
