"""What a depth camera in a rendered room sends, and how it is played to a node."""

from __future__ import annotations

import array
from itertools import count

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_ros.conversions import seconds_from_stamp, stamp_from_seconds

from .answers import wait_for_states

FRAMES = 4
"""From which the node models the environment."""

STEP = 0.05
"""s from image to image."""


def image_message(depth: np.ndarray, time: float, **changes) -> Image:
    height, width = depth.shape
    message = Image(
        header=Header(stamp=stamp_from_seconds(time), frame_id="camera"),
        height=height,
        width=width,
        encoding="16UC1",
        step=2 * width,
        data=array.array("B", depth.astype("<u2").tobytes()),
    )
    return changed(message, **changes)


def changed(message, **changes):
    """A message with other values of some fields."""
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def info_message(room) -> CameraInfo:
    return CameraInfo(
        header=Header(frame_id="camera"),
        width=room.width,
        height=room.height_pixels,
        k=room.matrix.ravel(),
        distortion_model="plumb_bob",
    )


def cloud_message(points: np.ndarray, time: float, **changes) -> PointCloud2:
    height, width = points.shape[:2]
    message = PointCloud2(
        header=Header(stamp=stamp_from_seconds(time), frame_id="lidar"),
        height=height,
        width=width,
        fields=[
            PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
            for k, name in enumerate("xyz")
        ],
        point_step=12,
        row_step=12 * width,
        data=array.array("B", points.astype("<f4").tobytes()),
    )
    return changed(message, **changes)


def transform_stamped(
    parent: str, child: str, pose: RigidTransform, time: float = 0.0
) -> TransformStamped:
    """Pose of a frame in its parent, as tf has it."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, stamp_from_seconds(time)
    message.transform.translation = Vector3(**dict(zip("xyz", pose.translation, strict=True)))
    message.transform.rotation = Quaternion(**dict(zip("xyzw", pose.orientation, strict=True)))
    return message


def says(heard, name: str, text: str, node: str = "perception_node") -> bool:
    """Whether a diagnostic of a node says something."""
    return any(
        status.name == f"{node}: {name}" and text in status.message
        for message in heard
        for status in message.status
    )


def throw(room) -> list[np.ndarray]:
    """Depth images: the empty room, a ball that flies through it, the empty room."""
    times = np.arange(0, 0.5, STEP)
    places = np.array([1.4, -0.4, 0.5]) + times[:, None] * [0.4, 0.9, 1.2]
    places[:, 2] -= 0.5 * 9.81 * times**2
    empty = [room.depth() for _ in range(FRAMES + 2)]
    return [*empty, *(room.depth([(place, 0.07)]) for place in places), *empty, *empty]


def play(peer, publisher, messages) -> None:
    for message in messages:
        publisher.publish(message)
        peer.spin_for(0.03)


def play_answered(peer, publisher, messages, states) -> None:
    """Publish each message once there are states of that before, or it is lost."""
    for message in messages:
        publisher.publish(message)
        wait_for_states(peer, states, seconds_from_stamp(message.header.stamp))


def play_until(peer, publisher, make, holds, what: str) -> None:
    """Publish what `make` makes of later and later times (s) until something holds.

    A single message of best effort is lost where the node has not discovered its publisher yet,
    which can be later than the publisher sees the node.
    """
    times = count(0.0, STEP)
    peer.spin_until(lambda: holds() or play(peer, publisher, [make(next(times))]), what)


def show_until(peer, publisher, depth, start: float, holds, what: str) -> None:
    """Publish one depth image again and again, from a time (s) on, until something holds."""
    play_until(peer, publisher, lambda time: image_message(depth, start + time), holds, what)
