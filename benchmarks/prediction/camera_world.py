"""Thrown balls with a spin of choice, as perception sees them through a rendered camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import IntuitivePhysicsError
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
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings

FRAME_RATE = 30.0  # Hz
LEAD_IN, DURATION, PAUSE = 1.0, 2.4, 0.6  # s before the first throw, of each, and after each


class BenchmarkError(IntuitivePhysicsError):
    """What is to be judged did not come about."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """What perception says of the ball in one frame."""

    time: float  # s
    seen: PerceivedObject  # the object with its state and detection


@dataclass(frozen=True, eq=False)
class SeenThrow:
    """A throw, and every frame in which its ball was tracked."""

    throw: Throw
    sightings: tuple[Sighting, ...]


@dataclass(frozen=True, eq=False)
class World:
    """Throws of one spin, as seen."""

    throws: tuple[SeenThrow, ...]  # in their order
    observations: tuple[Observation, ...]  # of each throw, where there is one
    model: EnvironmentModel  # environment as perceived

    def perceived_point(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return true points (..., 3) m in the perceived environment."""
        optical = corner_camera().to_optical(points)
        return optical @ self.model.rotation.T + self.model.translation

    def perceived_direction(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a true vector (3,) in the axes of the perceived environment."""
        return self.model.rotation @ corner_camera().rotation.T @ vector


def see_world(spin: float, count: int, seed: int, patterns: Sequence[str] = ()) -> World:
    """Throw balls, render them and perceive every frame."""
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
    pipeline = PerceptionPipeline(settings, own_rng)
    sightings: dict[int, list[Sighting]] = {k: [] for k in range(count)}
    observations: list[Observation] = []
    for time, points, colors in _frames(throws, patterns, noise_rng):
        result = pipeline.process(points, time, colors)
        observations += result.observations
        k = int((time - LEAD_IN) // (DURATION + PAUSE))
        if len(result.objects) == 1 and 0 <= k < count and time <= throws[k].end_time:
            sightings[k].append(Sighting(time, result.objects[0]))
    observations += pipeline.finish()
    if pipeline.model is None:
        raise BenchmarkError("perception did not find the environment")
    seen = tuple(SeenThrow(throws[k], tuple(sightings[k])) for k in range(count))
    return World(seen, tuple(observations), pipeline.model)


def _frames(
    throws: Sequence[Throw], patterns: Sequence[str], rng: np.random.Generator
) -> Iterator[tuple[float, NDArray[np.float32], NDArray[np.uint8] | None]]:
    """Yield the time in s of each frame, its points (height, width, 3) m, and its colours, if any,
    of the same shape."""
    camera = DepthColorCamera(DepthRenderer(corner_camera(), corner_environment()), rng)
    painted = list(zip(throws, map(BallSurface, cycle(patterns or [PLAIN])), strict=False))
    for frame in range(int((throws[-1].end_time + PAUSE) * FRAME_RATE)):
        time = frame / FRAME_RATE
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
    found = []
    for plane in corner_environment().planes:
        gaps = motion.positions @ plane.normal - plane.offset - throw.radius
        speeds = motion.velocities @ plane.normal
        turns = (speeds[:-1] < -0.3) & (speeds[1:] > 0.1) & (gaps[1:] < 0.05)
        found += (throw.start_time + motion.times[1:][turns]).tolist()
    return sorted(found)
