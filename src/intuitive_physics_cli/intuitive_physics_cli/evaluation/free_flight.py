"""The baseline of knowing no material: objects fly freely and stop where they first touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.scene import Environment
from intuitive_physics.simulation.event_driven.roots import first_fall_quadratic
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import finite_array


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
        first_fall_quadratic(
            float(plane.signed_distances(state.position)) - radius,
            float(plane.normal @ state.linear_velocity),
            float(plane.normal @ environment.gravity),
        )
        for plane in environment.planes
    ]
    return min(contacts, default=np.inf)
