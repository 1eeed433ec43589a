"""One run of all of perception over the frames of a sensor, as every part here makes it."""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import perf_counter, thread_time

import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.scenes import PAUSE
from benchmarks.perception.score import Ball
from benchmarks.perception.truth import TrueBall, TrueRecording
from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.shapes import Sphere
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_truth
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_result import FrameResult, PerceivedObject
from intuitive_physics_perception.input.frame_decoder import FrameDecoder
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC


class NoEnvironmentModelError(IntuitivePhysicsError):
    """Perception did not find the environment, so there is nothing to measure."""


class PerceptionRun:
    """Perception of one sensor, with the time (s) of each frame in a known environment."""

    def __init__(
        self,
        settings: PerceptionSettings | None = None,
        rng: np.random.Generator | None = None,
        background: Executor | None = None,
    ) -> None:
        self.settings = settings or PerceptionSettings()
        self.pipeline = PerceptionPipeline(
            self.settings,
            rng or np.random.default_rng(0),
            clock=thread_time,
            background=background,
        )
        self.seconds: list[float] = []  # of the one thread that does the work
        self.wall: list[float] = []

    def process(
        self,
        points: NDArray[np.float32],
        time: float,
        colors: NDArray[np.uint8] | None = None,
        pose: RigidTransform | None = None,
        camera: str = "",
        offsets: NDArray[np.float32] | None = None,
    ) -> FrameResult:
        """Perceive points (height, width, 3) m, their colours and times (height, width) s after
        that of the frame, s, of a camera, from a pose."""
        wall, thread = perf_counter(), thread_time()
        result = self.pipeline.process(points, time, colors, pose, camera, offsets)
        if is_of_known_environment(result):
            self.seconds.append(thread_time() - thread)
            self.wall.append(perf_counter() - wall)
        return result

    @property
    def model(self) -> EnvironmentModel:
        """The environment."""
        if self.pipeline.model is None:
            raise NoEnvironmentModelError("perception did not find the environment")
        return self.pipeline.model


def is_of_known_environment(result: FrameResult) -> bool:
    """Return whether objects were looked for in a frame, and not the environment."""
    return result.model is not None and not result.is_new_model


def detected_spheres(result: FrameResult) -> list[DetectedSphere]:
    """Return the spheres of a frame alone."""
    return [item for item in result.detections if isinstance(item, DetectedSphere)]


def detected_balls(result: FrameResult) -> list[Ball]:
    """Return the spheres of a frame alone, in the sensor's frame; none without an environment."""
    if result.model is None:
        return []
    to_sensor = result.model.to_sensor
    return [(to_sensor(sphere.center), sphere.radius) for sphere in detected_spheres(result)]


def tracked_spheres(result: FrameResult) -> list[PerceivedObject]:
    """Return the published objects that are spheres."""
    return [item for item in result.objects if isinstance(item.object.shape, Sphere)]


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a rendered bag."""

    time: float  # s of its stamp
    points: NDArray[np.float32]  # (height, width, 3) m in the sensor's frame
    seconds: float  # of the thread, from the message to the points
    wall: float  # s, the same
    recording: TrueRecording

    @cached_property
    def balls(self) -> list[TrueBall]:
        """The true balls."""
        return self.recording.balls_at(self.time - 1e-9 * self.recording.truth.start_time)


@contextmanager
def rendered_bag(truth: GroundTruth, rng: np.random.Generator) -> Iterator[Path]:
    """Render a bag that exists until the block ends."""
    with tempfile.TemporaryDirectory(prefix="bench-perception-") as folder:
        bag = Path(folder) / "bag"
        render_truth(bag, truth, RenderSettings(pause=PAUSE), rng)
        yield bag


def bag_frames(
    path: Path, recording: TrueRecording, stamps: Collection[float] | None = None
) -> Iterator[Frame]:
    """Yield the frames of a bag in order of time, all or those with some stamps, s."""
    with BagReader(path) as bag:
        decoder = FrameDecoder()
        decoder.take_camera(bag.decode(next(iter(bag.messages([CAMERA_INFO_TOPIC])))))
        for message in bag.messages([DEPTH_TOPIC]):
            image = bag.decode(message)
            stamp = image.header.stamp.sec + image.header.stamp.nanosec * 1e-9
            if stamps is None or stamp in stamps:
                wall, thread = perf_counter(), thread_time()
                points = decoder.image_points(image)
                seconds = thread_time() - thread
                yield Frame(stamp, points, seconds, perf_counter() - wall, recording)
