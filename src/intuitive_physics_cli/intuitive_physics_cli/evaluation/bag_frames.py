"""Frames of points from a bag: depth images with their camera info, or point clouds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.input.depth import IMAGE_TYPES
from intuitive_physics_perception.input.frame_decoder import FrameDecoder
from intuitive_physics_recordings.bag_reader import BagReader

IMAGE, CAMERA_INFO, CLOUD = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "CameraInfo", "PointCloud2")
)


@dataclass(frozen=True)
class FrameSource:
    """Where frames come from.

    Parameters
    ----------
    topic : of depth images or clouds
    camera_info_topic : of the images' camera; "" for clouds
    frames : messages on the topic
    """

    topic: str
    camera_info_topic: str
    frames: int


def find_frame_source(bag: BagReader, topic: str | None = None) -> FrameSource:
    """Guess which topic shows the scene: depth images first, else a point cloud.

    Parameters
    ----------
    topic : take this one

    Raises
    ------
    InvalidInputError
        When there is no such topic, or images have no camera info beside them.
    """
    wanted = [known for known in bag.topics if topic is None or known.name == topic]
    infos = [known.name for known in bag.topics if known.type == CAMERA_INFO]
    for known in wanted:
        if known.type == IMAGE and _is_depth(bag, known.name):
            info = _camera_info_beside(known.name, infos)
            if info is not None:
                return FrameSource(known.name, info, known.message_count)
            if topic is not None:
                raise InvalidInputError(
                    f"depth images {topic} have no camera info beside them; expected "
                    f"{_namespace(topic)}/camera_info in the bag"
                )
    for known in wanted:
        if known.type == CLOUD:
            return FrameSource(known.name, "", known.message_count)
    listed = ", ".join(f"{known.name} ({known.type})" for known in bag.topics)
    raise InvalidInputError(
        f"bag {bag.path} has {listed or 'no topics'}; expected depth images "
        f"({', '.join(IMAGE_TYPES)}) with camera info, or PointCloud2"
        + (f", on {topic}" if topic else "")
    )


def read_frames(bag: BagReader, source: FrameSource) -> Iterator[tuple[float, NDArray[np.float32]]]:
    """Yield time in s of each frame's stamp, and its points (height, width, 3) m, NaN: no reading.

    Raises
    ------
    InvalidInputError
        When a message is not what its type says, or an image comes before its camera info.
    """
    decoder = FrameDecoder()
    if not source.camera_info_topic:
        for message in bag.messages([source.topic]):
            cloud = bag.decode(message)
            yield _stamp(cloud), decoder.cloud_points(cloud)
        return
    infos = bag.messages([source.camera_info_topic])
    first = next(infos, None)
    if first is None:
        raise InvalidInputError(
            f"{source.camera_info_topic} has no message; expected the camera of {source.topic}"
        )
    decoder.take_camera(bag.decode(first))
    for message in bag.messages([source.topic]):
        image = bag.decode(message)
        yield _stamp(image), decoder.image_points(image)


def _is_depth(bag: BagReader, topic: str) -> bool:
    for message in bag.messages([topic]):
        return bag.decode(message).encoding in IMAGE_TYPES
    return False


def _camera_info_beside(topic: str, infos: list[str]) -> str | None:
    beside = [name for name in infos if _namespace(name) == _namespace(topic)]
    return beside[0] if beside else None


def _namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


def _stamp(message: Any) -> float:
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
