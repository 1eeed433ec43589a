"""The baseline of knowing no contact: a cube flies and turns, and stops where it first touches."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from intuitive_physics.scene import Environment
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import increasing_times


def tumbling_flight(
    environment: Environment, width: float, state: ObjectState, times: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions (n, 3) m and orientations (n, 4) of a cube that stops where it first touches.

    The `times` (n,) s after the state strictly increase; the width is the cube's edge in m. A cube
    has three equal moments of inertia, so in free flight its angular velocity is constant.
    """
    instants = increasing_times(times, "times")
    flight = _Flight(environment, width, state)
    touching = np.flatnonzero(flight.gaps(instants) <= 0.0)
    if touching.size:
        after = instants[touching[0]]
        before = instants[touching[0] - 1] if touching[0] else 0.0
        instants = np.minimum(instants, flight.contact_time(before, after))
    return flight.positions(instants), flight.turns(instants).as_quat()


def cube_gaps(
    environment: Environment,
    width: float,
    positions: NDArray[np.float64],
    axes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Distance (n,) m of the lowest corner of a cube from the nearest plane.

    The `positions` (n, 3) m are of its centre, `axes` (n, 3, 3) rotate from the cube to the world.
    """
    gaps = np.full(len(axes), np.inf)
    for plane in environment.planes:
        reach = 0.5 * width * np.abs(plane.normal @ axes).sum(axis=-1)
        gaps = np.minimum(gaps, plane.signed_distances(positions) - reach)
    return gaps


class _Flight:
    def __init__(self, environment: Environment, width: float, state: ObjectState) -> None:
        self._environment = environment
        self._width = width
        self._state = state

    def positions(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        since, state = times[:, None], self._state
        falling = 0.5 * since**2 * self._environment.gravity
        return state.position + since * state.linear_velocity + falling

    def turns(self, times: NDArray[np.float64]) -> Rotation:
        turned = Rotation.from_rotvec(times[:, None] * self._state.angular_velocity)
        return turned * Rotation.from_quat(self._state.orientation)

    def gaps(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance in m, shape (n,), of the lowest corner from the nearest plane."""
        axes = self.turns(times).as_matrix()
        return cube_gaps(self._environment, self._width, self.positions(times), axes)

    def contact_time(self, before: float, after: float) -> float:
        """Time in s of first touch, given one before or at it and one after it."""

        def gap(time: float) -> float:
            return float(self.gaps(np.array([time]))[0])

        return before if gap(before) <= 0.0 else float(brentq(gap, before, after))
