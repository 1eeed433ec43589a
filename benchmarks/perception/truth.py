"""The true balls in each frame of a rendered recording, in the sensor's frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.scenes import first_bounce
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.throws import Throw


@dataclass(frozen=True, eq=False)
class TrueBall:
    """One ball in one frame."""

    throw: int  # its number in the recording
    position: NDArray[np.float64]  # (3,) m, in the sensor's frame
    velocity: NDArray[np.float64]  # (3,) m/s, in the sensor's frame
    radius: float  # m
    pixels: int  # pixels whose nearest surface is the ball, whether the camera reads them or not
    before_bounce: float | None  # s until it first meets a plane; None after that or without

    @property
    def distance(self) -> float:
        """m from the sensor to the centre."""
        return float(np.linalg.norm(self.position))


class TrueRecording:
    """The true balls at any time of a recording."""

    def __init__(self, truth: GroundTruth) -> None:
        self.truth = truth
        self._renderer = DepthRenderer(truth.camera, truth.environment)
        self._bounces = [first_bounce(throw, truth.environment) for throw in truth.throws]

    def balls_at(self, time: float) -> list[TrueBall]:
        """Return the balls that are there `time` s after the recording's start."""
        throws = self.truth.throws
        there = [k for k, t in enumerate(throws) if t.start_time <= time <= t.end_time]
        places = [throws[k].positions_at(np.array([time]))[0] for k in there]
        owner = self._renderer.render_balls(places, [throws[k].radius for k in there]).owner
        return [
            self._ball(k, throws[k], place, time, int((owner == n).sum()))
            for n, (k, place) in enumerate(zip(there, places, strict=True))
        ]

    def _ball(
        self, number: int, throw: Throw, place: NDArray[np.float64], time: float, pixels: int
    ) -> TrueBall:
        camera, motion = self.truth.camera, throw.motion
        since = time - throw.start_time
        velocity = np.array([np.interp(since, motion.times, v) for v in motion.velocities.T])
        bounce = self._bounces[number]
        return TrueBall(
            number,
            camera.to_optical(place),
            velocity @ camera.rotation,
            throw.radius,
            pixels,
            bounce - since if bounce is not None and since < bounce else None,
        )
