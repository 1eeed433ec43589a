"""Nodes as processes: their arguments, images that they are fed with, messages that they send."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

from intuitive_physics_bringup.connections import NODES
from intuitive_physics_recordings.bag_reader import BagMessage, BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC
from intuitive_physics_ros.qos import SENSOR_DATA
from intuitive_physics_ros.scripting import Peer

PERCEPTION, LEARNER, PREDICTOR = NODES
RATE = 30.0  # images a second
SECOND = 1_000_000_000  # ns
LONGEST_PERIOD = 0.25  # s; a longer time without a prediction is one without a tracked object

# Arguments with which perception takes the images of a `DepthPublisher`
PERCEPTION_ARGUMENTS = (
    *("-p", "input:=depth", "-r", f"~/depth/image:={DEPTH_TOPIC}"),
    *("-r", f"~/depth/camera_info:={CAMERA_INFO_TOPIC}"),
)


def parameter_arguments(**values: object) -> list[str]:
    """Return the command-line arguments that set parameters of a node."""
    return [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]


class MessageQueue:
    """The serialised messages that wait in the queue of a subscription.

    The middleware writes the time of arrival on each. An executor that waited for each message
    would take processor time from the nodes.
    """

    def __init__(self, peer: Peer, kind: type, topic: str, depth: int = 100) -> None:
        # Best effort, so that nothing is sent again; deep, so that nothing is lost between calls.
        qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._kind = kind
        self._subscription = peer.node.create_subscription(kind, topic, _leave, qos, raw=True)

    def take(self) -> Iterator[tuple[bytes, float]]:
        """Yield each message and its time of arrival, s since the epoch."""
        handle = self._subscription.handle
        with handle:
            while taken := handle.take_message(self._kind, True):
                message, info = taken
                yield message, 1e-9 * info["received_timestamp"]


def _leave(_: bytes) -> None:
    """Take no message: all are taken from the queue."""


class DepthPublisher:
    """Publishes recorded depth images with stamps of choice."""

    def __init__(self, peer: Peer) -> None:
        self._publishers = {
            topic: peer.node.create_publisher(kind, topic, SENSOR_DATA)
            for topic, kind in {CAMERA_INFO_TOPIC: CameraInfo, DEPTH_TOPIC: Image}.items()
        }

    def is_connected(self) -> bool:
        """Whether images and camera info have subscribers."""
        return all(p.get_subscription_count() for p in self._publishers.values())

    def publish(self, messages: Sequence[BagMessage], stamp: int) -> None:
        """Publish an image and its camera info with a stamp, ns since the epoch."""
        for message in messages:
            data = bytearray(message.data)
            # CDR: four bytes that give the byte order, then header.stamp.
            struct.pack_into("<iI", data, 4, *divmod(stamp, SECOND))
            self._publishers[message.topic].publish(bytes(data))


def recorded_images(reader: BagReader) -> Iterator[tuple[float, list[BagMessage]]]:
    """Yield each image with its camera info, and the time of both since the start, s."""
    messages = reader.messages([DEPTH_TOPIC, CAMERA_INFO_TOPIC])
    for first, second in zip(messages, messages, strict=True):
        yield 1e-9 * (first.time - reader.start_time), [first, second]


def header_stamp(message: bytes) -> int:
    """Return the stamp (ns) of a serialised message that begins with a header."""
    return _stamp_at(message, 4)


def states_stamp(message: bytes) -> int:
    """Return the stamp (ns) of the states that a serialised distribution was predicted from."""
    # After header.stamp come the length and the letters of the frame's name, and states_stamp.
    (length,) = struct.unpack_from("<I", message, 12)
    after = 16 + length
    return _stamp_at(message, after + -after % 4)


def _stamp_at(message: bytes, position: int) -> int:
    seconds, nanoseconds = struct.unpack_from("<iI", message, position)
    return int(seconds) * SECOND + int(nanoseconds)


def prediction_rate(arrivals: Sequence[float]) -> float:
    """Return the predictions a second while an object was tracked; arrivals in s."""
    periods = np.diff(arrivals)
    tracked = periods[periods < LONGEST_PERIOD]
    return float(tracked.size / tracked.sum()) if tracked.size else 0.0
