"""A table-tennis ball in air and on its table, simulated for many states at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import WorldBatch, make_simulator, pack_worlds
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.recorded_sets.table_tennis import (
    BALL_MASS,
    BALL_MATERIAL,
    BALL_RADIUS,
    TABLE_MATERIAL,
)

COEFFICIENTS = ("drag", "lift", "lift_ratio", "restitution", "friction", "height", "slope")
"""What varies from flight to flight: C_D without spin; largest lift coefficient, and the spin ratio
that it is approached at (`_air_coefficients`); e and μ of ball and table; height of the ball's
centre at a bounce at y = 0 (m), and how much that grows along y."""

STATE_SIZE = 9
"""Position, velocity and spin."""

UNKNOWN_SIZE = STATE_SIZE + len(COEFFICIENTS)
"""State and coefficients."""

LOWEST = np.array([0.0, 0.0, 0.05, 0.0, 0.0, -0.1, -0.2])
HIGHEST = np.array([3.0, 2.0, 3.0, 1.1, 2.0, 0.1, 0.2])
"""Bounds of the coefficients. Where a camera measures heights askew, a bounce may seem to be faster
than the fall before it: restitution may be a little above 1."""

DRAG_LAW = (0.56, -0.60, -0.029)
"""C_D over the drag of a flight, less one, grows by these with the spin ratio, its square, and the
speed (s/m): a fit to those flights of even number whose bounce gives their spin."""

USUAL_SPEED = 8.0
"""m/s, at which a ball without spin has the drag of its flight."""

HIGHEST_RATIO = 1.2
"""Spin ratio up to which the laws of drag and lift were fitted; they stay as they are above."""

LEAST_DRAG = 0.3
"""C_D over the drag of a flight, at least."""

LEG = 0.1
"""s, after which drag and Magnus coefficient follow speed and spin, which a bounce changes."""

INSTANT = 1e-5
"""s, over which velocity and spin are taken from positions and orientations."""

SHELL = 5.0 / 3.0
"""Moment of inertia of a thin shell over that of a solid ball."""


class BallModel:
    """Simulates balls that differ in state and coefficients."""

    def __init__(self) -> None:
        self._simulator = make_simulator("stepped")
        ball = SceneObject("ball", BALL_MATERIAL, Sphere(BALL_RADIUS), 1.0, 1.0, SHELL)
        table = Plane("table", TABLE_MATERIAL, (0.0, 0.0, 1.0), -BALL_RADIUS)
        density = BALL_MASS / Sphere(BALL_RADIUS).volume
        parameters = StaticParameters.uniform((BALL_MATERIAL, TABLE_MATERIAL), density=density)
        scene = Scene(Environment([table]), (ball,), (ObjectState((0.0, 0.0, 1.0)),))
        self._world = pack_worlds(
            [scene], parameters.with_pair(BALL_MATERIAL, TABLE_MATERIAL, rolling_friction=0.0)
        )

    def positions(
        self, unknowns: NDArray[np.float64], times: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Simulate.

        Parameters
        ----------
        unknowns : (n, 16) position (m), velocity (m/s) and spin (rad/s) at time 0, then
            `COEFFICIENTS`; those out of bounds count as the bounds
        times : (k,) s, increasing, none negative

        Returns
        -------
        array
            (n, k, 3) m
        """
        paths = np.empty((len(unknowns), len(times), 3))
        now, begin = unknowns, 0.0
        while True:
            end = begin + LEG
            inside = (times >= begin) & (times < end)
            if times[-1] < end:
                paths[:, inside] = self._leg(now, times[inside] - begin)[0]
                return paths
            asked = np.concatenate([times[inside] - begin, LEG + INSTANT * np.arange(3.0)])
            places, turns = self._leg(now, asked, turns=True)
            paths[:, inside] = places[:, :-3]
            now, begin = _state_at_end(now, places[:, -3:], turns[:, -3:]), end + INSTANT

    def _leg(
        self, unknowns: NDArray[np.float64], times: NDArray[np.float64], *, turns: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions (n, k, 3) m and, if asked for, orientations (n, k, 4)."""
        rollout = self._simulator.rollout_batch(self._worlds(unknowns), times, orientations=turns)
        orientations = np.empty(0) if rollout.orientations is None else rollout.orientations[:, 0]
        return rollout.positions[:, 0], orientations

    def _worlds(self, unknowns: NDArray[np.float64]) -> WorldBatch:
        n = len(unknowns)
        states = np.zeros((n, 1, 13))
        states[:, 0, :3], states[:, 0, 6] = unknowns[:, :3], 1.0
        states[:, 0, 7:] = unknowns[:, 3:STATE_SIZE]
        known = np.clip(unknowns[:, STATE_SIZE:], LOWEST, HIGHEST)
        drag, lift, lift_ratio, restitution, friction, height, slope = known.T
        copies = self._world.repeated(states)
        air = copies.air_factors.copy()
        air[:, 0] *= _air_coefficients(unknowns, drag, lift, lift_ratio)
        coefficients = np.repeat(self._world.coefficients, n, axis=0)
        coefficients[:, :2] = friction[:, None, None, None]
        coefficients[:, 3] = restitution[:, None, None]
        planes = np.zeros((n, 1, 4))
        planes[:, 0, 1], planes[:, 0, 2] = -slope, 1.0
        planes[:, 0, 3] = height
        planes /= np.sqrt(1.0 + slope**2)[:, None, None]
        planes[:, 0, 3] -= BALL_RADIUS
        one_each = {
            name: np.repeat(getattr(self._world, name), n, axis=0) for name in _ENVIRONMENT_ARRAYS
        }
        return replace(
            copies,
            **one_each,
            air_factors=air,
            planes=planes,
            coefficients=coefficients,
            density=np.repeat(self._world.density, n, axis=0),
            environment_index=np.arange(n),
            parameter_index=np.arange(n),
            environments=self._world.environments * n,
        )


def _state_at_end(
    unknowns: NDArray[np.float64], places: NDArray[np.float64], turns: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Unknowns (n, 16) in the middle of three instants: places (n, 3, 3) m, turns (n, 3, 4)."""
    state = unknowns.copy()
    state[:, :3] = places[:, 1]
    state[:, 3:6] = (places[:, 2] - places[:, 0]) / (2.0 * INSTANT)
    turned = Rotation.from_quat(turns[:, 2]) * Rotation.from_quat(turns[:, 0]).inv()
    state[:, 6:9] = turned.as_rotvec() / (2.0 * INSTANT)
    return state


_ENVIRONMENT_ARRAYS = (
    "gravity",
    "plane_counts",
    "plane_materials",
    "corner_counts",
    "corners",
    "box_counts",
    "boxes",
    "box_materials",
)


def _air_coefficients(
    unknowns: NDArray[np.float64],
    drag: NDArray[np.float64],
    lift: NDArray[np.float64],
    lift_ratio: NDArray[np.float64],
) -> NDArray[np.float64]:
    """C_D and C_M (n, 2) of balls (n, 16), by the ratio S = r |ω × v| / v² of rim speed to speed.

    C_M = C_L / S, and the lift coefficient C_L = lift · tanh(S / lift_ratio) of a fast spin
    approaches a constant, as it does in wind tunnels.
    """
    velocity, spin = unknowns[:, 3:6], unknowns[:, 6:9]
    speeds = np.maximum(np.linalg.norm(velocity, axis=1), 1e-3)
    ratios = BALL_RADIUS * np.linalg.norm(np.cross(spin, velocity), axis=1) / speeds**2
    ratios = np.clip(ratios, 1e-6, HIGHEST_RATIO)
    first, second, by_speed = DRAG_LAW
    law = 1.0 + first * ratios + second * ratios**2 + by_speed * (speeds - USUAL_SPEED)
    magnus = lift * np.tanh(ratios / lift_ratio) / ratios
    return np.column_stack([drag * np.maximum(law, LEAST_DRAG), magnus])
