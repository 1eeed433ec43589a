"""Balls thrown by hand into a corner (Sec. VI-C): random initial states and what became of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.rendering.ball_surface import BallSurface
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.color_camera import ColoredBall
from intuitive_physics_experiments.rendering.corner_room import BALL_RADII, ROOM_MATERIAL
from intuitive_physics_experiments.rendering.thrown_ball import (
    AS_BULLET_HAS_IT,
    BallContact,
    BallMotion,
    Fidelity,
    move_ball,
)

MOST_ATTEMPTS = 500  # Draws of a throw that stays in view before it is given up
IMAGE_MARGIN = 4.0  # Pixels kept free between a ball and the image's edge
HIGHEST_CENTER = 1.0  # m; a hand does not throw over the walls
LITTLE_SPIN = 2.0  # rad/s about each axis, of a ball that a hand lets go without turning it


@dataclass(frozen=True, eq=False)
class Throw:
    """One ball, thrown once."""

    material: str  # name, one of `BALL_RADII`
    radius: float  # m
    start_time: float  # s after the recording's start
    motion: BallMotion  # what the ball did, times after `start_time`, in the world

    @property
    def end_time(self) -> float:
        """Time in s after the recording's start when the ball is taken away."""
        return self.start_time + float(self.motion.times[-1])

    def positions_at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centre (n, 3) m at times (n,) s after the recording's start, all within the throw."""
        since = np.asarray(times, dtype=np.float64) - self.start_time
        known = self.motion.times
        if since.size and (since.min() < -1e-6 or since.max() > known[-1] + 1e-6):
            raise InvalidInputError(
                f"times reach from {since.min():.6g} to {since.max():.6g} s of the throw; "
                f"expected 0 to {known[-1]:.6g} s"
            )
        return np.column_stack(
            [np.interp(since, known, self.motion.positions[:, k]) for k in range(3)]
        )

    def colored_at(self, time: float, surface: BallSurface) -> ColoredBall:
        """Return the ball as a colour camera sees it, with a painted surface, s after the start."""
        motion, since = self.motion, time - self.start_time
        velocity, spin = (
            np.array([np.interp(since, motion.times, column) for column in values.T])
            for values in (motion.velocities, motion.angular_velocities)
        )
        return ColoredBall(
            self.positions_at(np.array([time]))[0],
            self.radius,
            surface,
            motion.orientation_at(since),
            velocity,
            spin,
        )


def make_throws(
    count: int,
    camera: Camera,
    environment: Environment,
    parameters: StaticParameters,
    rng: np.random.Generator,
    *,
    first_start: float,
    duration: float,
    pause: float,
    materials: Sequence[str] = tuple(BALL_RADII),
    fidelity: Fidelity = AS_BULLET_HAS_IT,
    spin: float = LITTLE_SPIN,
) -> list[Throw]:
    """Throw balls in turn, each in view of the camera from hand to end.

    The first ball appears `first_start` s after the recording's start; each throw lasts `duration`
    s, with `pause` s without a ball after it. The spin is the standard deviation in rad/s of the
    initial angular velocity about each axis.
    """
    throws = []
    for i in range(count):
        material = materials[i % len(materials)]
        motion = _throw_in_view(
            material, camera, environment, parameters, rng, duration, fidelity, spin
        )
        start_time = first_start + i * (duration + pause)
        throws.append(Throw(material, BALL_RADII[material], start_time, motion))
    return throws


def _throw_in_view(
    material: str,
    camera: Camera,
    environment: Environment,
    parameters: StaticParameters,
    rng: np.random.Generator,
    duration: float,
    fidelity: Fidelity,
    spin: float,
) -> BallMotion:
    radius = BALL_RADII[material]
    pair = parameters.pair(material, ROOM_MATERIAL)
    contact = BallContact(pair["static_friction"], pair["rolling_friction"], pair["restitution"])
    density = float(parameters.density[parameters.index(material)])
    for _ in range(MOST_ATTEMPTS):
        start = _release(rng, spin)
        motion = move_ball(
            environment, radius, density, contact, start, duration, fidelity=fidelity
        )
        if _in_view(camera, motion.positions, radius):
            return motion
    raise InvalidInputError(
        f"none of {MOST_ATTEMPTS} throws of {duration:g} s stayed in the camera's view; "
        "expected a shorter throw or a camera that sees more of the corner"
    )


def _release(rng: np.random.Generator, spin: float) -> ObjectState:
    """Draw the initial state of a throw towards the corner, somewhat upward."""
    along, across = rng.uniform(-0.1, 0.4), rng.uniform(-0.35, 0.35)
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    sideways = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)
    position = along * diagonal + across * sideways + np.array([0.0, 0.0, rng.uniform(0.35, 0.85)])
    heading = rng.normal(0.0, np.radians(30.0))
    speed = rng.uniform(1.0, 2.6)
    velocity = speed * (np.cos(heading) * diagonal + np.sin(heading) * sideways)
    velocity[2] = rng.uniform(-0.5, 1.6)
    return ObjectState(
        position, linear_velocity=velocity, angular_velocity=rng.normal(0.0, spin, size=3)
    )


def _in_view(camera: Camera, positions: NDArray[np.float64], radius: float) -> bool:
    depth = camera.to_optical(positions)[:, 2]
    if depth.min() < 0.6 or positions[:, 2].max() > HIGHEST_CENTER:
        return False
    pixels = camera.project(positions)
    reach = (camera.focal_length * radius / (depth - radius) + IMAGE_MARGIN)[:, None]
    size = np.array([camera.width, camera.height])
    return bool(((pixels > reach) & (pixels < size - 1 - reach)).all())
