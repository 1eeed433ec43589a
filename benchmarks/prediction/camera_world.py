"""Thrown balls with a spin of choice, perceived through a rendered camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.perceive import PerceptionRun
from benchmarks.running_nodes import RATE
from intuitive_physics.observation import Observation
from intuitive_physics_experiments.rendering.ball_surface import PLAIN, BallSurface
from intuitive_physics_experiments.rendering.color_camera import DepthColorCamera
from intuitive_physics_experiments.rendering.corner_room import (
    BALL_RADII,
    corner_camera,
    corner_environment,
    true_parameters,
)
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_experiments.rendering.throws import Throw, make_throws
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_result import PerceivedObject
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings

LEAD_IN, DURATION, PAUSE = 1.0, 2.4, 0.6  # s before the first throw, of each, and after each


@dataclass(frozen=True, eq=False)
class SeenThrow:
    """A throw, and the time (s) and the perceived ball of every frame in which it was tracked."""

    throw: Throw
    sightings: list[tuple[float, PerceivedObject]]


@dataclass(frozen=True, eq=False)
class World:
    """Throws of one spin in a perceived environment, and an observation of nearly each."""

    throws: list[SeenThrow]
    observations: list[Observation]
    model: EnvironmentModel

    def perceived_point(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return true points (..., 3) m in the perceived environment."""
        optical = corner_camera().to_optical(points)
        return optical @ self.model.rotation.T + self.model.translation

    def perceived_direction(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a true vector (3,) in the axes of the perceived environment."""
        return self.model.rotation @ corner_camera().rotation.T @ vector


def see_world(spin: float, count: int, seed: int, patterns: Sequence[str] = ()) -> World:
    """Throw balls, render them and perceive every frame.

    The spin (rad/s) is the standard deviation of the initial spin about each axis. With patterns,
    which balls have in turn, the camera sees colour too.
    """
    throw_rng, noise_rng, own_rng = map(
        np.random.default_rng, np.random.SeedSequence(seed).spawn(3)
    )
    camera, environment = corner_camera(), corner_environment()
    throws = make_throws(
        count,
        camera,
        environment,
        true_parameters(),
        throw_rng,
        first_start=LEAD_IN,
        duration=DURATION,
        pause=PAUSE,
        spin=spin,
    )
    known = [KnownObject(name, radius, name) for name, radius in BALL_RADII.items()]
    settings = PerceptionSettings(known_objects=tuple(known))
    run = PerceptionRun(settings, own_rng)
    seen = [SeenThrow(throw, []) for throw in throws]
    observations: list[Observation] = []
    for time, points, colors in _frames(throws, patterns, noise_rng):
        result = run.process(points, time, colors)
        observations += result.observations
        k = int((time - LEAD_IN) // (DURATION + PAUSE))
        if len(result.objects) == 1 and 0 <= k < count and time <= throws[k].end_time:
            seen[k].sightings.append((time, result.objects[0]))
    observations += run.pipeline.finish()
    return World(seen, observations, run.model)


def _frames(
    throws: Sequence[Throw], patterns: Sequence[str], rng: np.random.Generator
) -> Iterator[tuple[float, NDArray[np.float32], NDArray[np.uint8] | None]]:
    """Yield the time (s) of each frame, its points (height, width, 3) m and its colours, if any."""
    camera = DepthColorCamera(DepthRenderer(corner_camera(), corner_environment()), rng)
    painted = list(zip(throws, map(BallSurface, cycle(patterns or [PLAIN])), strict=False))
    for frame in range(int((throws[-1].end_time + PAUSE) * RATE)):
        time = frame / RATE
        balls = [
            throw.colored_at(time, surface)
            for throw, surface in painted
            if throw.start_time <= time <= throw.end_time
        ]
        points = camera.points(balls)
        yield time, points, camera.colors(balls) if patterns else None


def bounces(throw: Throw) -> list[float]:
    """Return the times, s, at which a ball bounces off floor or walls."""
    motion = throw.motion
    times: list[float] = []
    for plane in corner_environment().planes:
        gaps = motion.positions @ plane.normal - plane.offset - throw.radius
        speeds = motion.velocities @ plane.normal
        turns = (speeds[:-1] < -0.3) & (speeds[1:] > 0.1) & (gaps[1:] < 0.05)
        times += (throw.start_time + motion.times[1:][turns]).tolist()
    return sorted(times)
