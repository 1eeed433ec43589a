"""The perception pipeline run over a whole bag, with no ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_result import FrameResult
from intuitive_physics_perception.input.depth import IMAGE_TYPES
from intuitive_physics_perception.input.frame_decoder import FrameDecoder
from intuitive_physics_perception.input.point_cloud import points_of_cloud
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader

IMAGE, COMPRESSED_IMAGE, CAMERA_INFO, CLOUD = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo", "PointCloud2")
)
"""Types of the messages that frames are read from."""

TRANSPORT = "/compressedDepth"
"""Suffix that image_transport adds to the name of a topic of depth images."""


@dataclass(frozen=True)
class FrameSource:
    """The topics that frames come from.

    Parameters
    ----------
    topic : of depth images or clouds
    type : of its messages
    camera_info_topic : of the images' camera; "" for clouds
    frames : messages on the topic
    """

    topic: str
    type: str
    camera_info_topic: str
    frames: int


def find_frame_source(bag: BagReader, topic: str | None = None) -> FrameSource:
    """Guess which topic shows the scene: depth images first, then compressed ones, then a cloud."""
    wanted = [candidate for candidate in bag.topics if topic is None or candidate.name == topic]
    infos = [candidate.name for candidate in bag.topics if candidate.type == CAMERA_INFO]
    images = [
        candidate
        for kind in (IMAGE, COMPRESSED_IMAGE)
        for candidate in wanted
        if candidate.type == kind and _is_depth(bag, candidate.name)
    ]
    for candidate in images:
        info = _camera_info_beside(candidate.name, infos)
        if info is not None:
            return FrameSource(candidate.name, candidate.type, info, candidate.message_count)
        if topic is not None:
            raise InvalidInputError(
                f"depth images {topic} have no camera info beside them; expected "
                f"{_namespace(topic)}/camera_info in the bag"
            )
    for candidate in wanted:
        if candidate.type == CLOUD:
            return FrameSource(candidate.name, candidate.type, "", candidate.message_count)
    listed = ", ".join(f"{candidate.name} ({candidate.type})" for candidate in bag.topics)
    raise InvalidInputError(
        f"bag {bag.path} has {listed or 'no topics'}; expected depth images "
        f"({', '.join(IMAGE_TYPES)}, or {TRANSPORT}) with camera info, or PointCloud2"
        + (f", on {topic}" if topic else "")
    )


def read_frames(
    bag: BagReader, source: FrameSource, *, rectified: bool = False
) -> Iterator[tuple[float, NDArray[np.float32]]]:
    """Yield time in s of each frame's stamp, and its points (height, width, 3) m, NaN: no reading.

    Images that are `rectified` already have no distortion, and the camera matrix of P, not of K.
    """
    decoder = FrameDecoder(rectified=rectified)
    points_of = {
        IMAGE: decoder.image_points,
        COMPRESSED_IMAGE: decoder.compressed_image_points,
        CLOUD: points_of_cloud,
    }[source.type]
    if source.camera_info_topic:
        first = next(bag.messages([source.camera_info_topic]), None)
        if first is None:
            raise InvalidInputError(
                f"{source.camera_info_topic} has no message; expected the camera of {source.topic}"
            )
        decoder.take_camera(bag.decode(first))
    for message in bag.messages([source.topic]):
        frame = bag.decode(message)
        yield _stamp(frame), points_of(frame)


def _is_depth(bag: BagReader, topic: str) -> bool:
    for message in bag.messages([topic]):
        image = bag.decode(message)
        if message.type == COMPRESSED_IMAGE:
            return "compressedDepth" in image.format
        return image.encoding in IMAGE_TYPES
    return False


def _camera_info_beside(topic: str, infos: list[str]) -> str | None:
    beside = [name for name in infos if _namespace(name) == _namespace(topic)]
    return beside[0] if beside else None


def _namespace(topic: str) -> str:
    return topic.removesuffix(TRANSPORT).rpartition("/")[0]


def _stamp(message: Any) -> float:
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


@dataclass(frozen=True, eq=False)
class PerceivedRecording:
    """The result of perception on a bag.

    Parameters
    ----------
    source : where the frames came from
    duration : s of the bag
    model : the environment; None when it was never known
    frames_with_spheres : number of frames in which at least one sphere was found
    problems : frames that could not be used, by the reason
    observations : finished observations, in order of time
    """

    source: FrameSource
    duration: float
    model: EnvironmentModel | None
    frames_with_spheres: int
    problems: Counter[str]
    observations: tuple[Observation, ...]


def perceive_recording(
    path: Path,
    settings: PerceptionSettings,
    rng: np.random.Generator,
    *,
    topic: str | None = None,
    rectified: bool = False,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
    on_frame: Callable[[NDArray[np.float32], FrameResult], None] = lambda points, perceived: None,
) -> PerceivedRecording:
    """Perceive every frame of a bag.

    `on_progress` is called with the frames done and the frames in all, `on_frame` with each frame's
    points (..., 3) m and what was perceived.
    """
    pipeline = PerceptionPipeline(settings, rng)
    model: EnvironmentModel | None = None
    observations: list[Observation] = []
    problems: Counter[str] = Counter()
    with_spheres = 0
    with BagReader(path) as bag:
        source, duration = find_frame_source(bag, topic), bag.duration
        frames = read_frames(bag, source, rectified=rectified)
        for done, (time, points) in enumerate(frames, start=1):
            perceived = pipeline.process(points, time)
            on_frame(points, perceived)
            model = perceived.model or model
            observations += perceived.observations
            with_spheres += perceived.diagnostics.spheres > 0
            if perceived.diagnostics.problem:
                problems[perceived.diagnostics.problem] += 1
            on_progress(done, source.frames)
    observations += pipeline.finish()
    return PerceivedRecording(source, duration, model, with_spheres, problems, tuple(observations))
