"""Plays a rosbag2 recording (MCAP or SQLite), as `ros2 bag play` does where it is installed."""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
import threading
import time
from pathlib import Path
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics_recordings.bag_reader import BagMessage, BagReader, BagTopic
from intuitive_physics_recordings.replay import Replay, ReplaySettings
from intuitive_physics_ros.diagnostics import Diagnostics, Level, Status
from intuitive_physics_ros.lifecycle.run_node import farewell, run_node
from intuitive_physics_ros.parameters import Parameter, declare_parameters
from intuitive_physics_ros.qos import create_publisher
from intuitive_physics_ros.topics import (
    ENVIRONMENT,
    OBJECT_STATES,
    OBSERVATIONS,
    PREDICTIONS,
    STATIC_PARAMETERS,
)
from intuitive_physics_ros.unexpected_errors import unexpected_errors

TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")
"""Names of messages, as ROS allows them."""

CLOCK_TOPIC = "/clock"
"""Topic of simulated time."""

TRANSFORM_TOPICS = ("/tf", "/tf_static")
"""Topics that all robots of a graph share."""

QUEUE_DEPTH = 10
"""Messages kept for a slow subscriber of a replayed topic, unless its publisher kept more, and of a
latched topic unless the bag says how many."""

LARGEST_DEPTH = 1000
"""Messages kept at most, whatever a bag says: rosbag2 records a publisher that keeps all as one
with an enormous depth. Our choice."""

STOP_PATIENCE = 0.5
"""s to wait at the end for the message under way."""

POLL_PERIOD = 0.05
"""s between two checks for subscribers."""

SETTLING_TIME = 0.25
"""s between the last awaited subscriber and the first message: the other side learns of this
publisher a little later than this one of it, and drops best-effort messages until then."""

ACKNOWLEDGE_TIMEOUT = 2.0
"""s that subscribers have at the end to acknowledge the last messages."""

SENSOR_TYPES = {
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/PointCloud2",
}
"""Types of messages that perception takes."""

SUITE_TOPICS = {ENVIRONMENT, OBJECT_STATES, OBSERVATIONS, PREDICTIONS, STATIC_PARAMETERS}
"""Topics that the suite publishes."""

PARAMETERS = (
    Parameter("bag", "", "folder of the bag, or one .mcap or .db3 file"),
    Parameter("rate", 1.0, "bag seconds in one real second", range=(0.01, 100.0)),
    Parameter("loop", False, "start again at the end"),
    Parameter("start_offset", 0.0, "s of the bag left out at its start", range=(0.0, 1e9)),
    Parameter("clock", True, "publish bag time on /clock, 100 times a second at most"),
    Parameter(
        "topic_prefix",
        "",
        "put before the names of the bag's topics and of /clock, such as /robot1, so that two bags "
        "do not mix; /tf and /tf_static stay, and so does what begins with it already",
    ),
    Parameter(
        "inputs_only",
        False,
        "where the bag has depth images or clouds, leave out what the suite made of them, which is "
        f"made again: {', '.join(sorted(SUITE_TOPICS))}",
    ),
    Parameter(
        "wait_for_subscribers",
        [""],
        "topics, of the bag or of other nodes, that must have a subscriber before the bag starts; "
        "if none of them is the bag's, it waits for a subscriber of any of its topics as well; "
        "empty names count for nothing",
    ),
    Parameter(
        "wait_timeout",
        30.0,
        "s to wait for those subscribers at most: then it ends, or, where none was named, plays",
        range=(0.0, 3600.0),
    ),
)
"""Parameters of the node."""


class ReplayNode(Node):
    """Publishes the messages of a bag as they were recorded and ends with it."""

    def __init__(self) -> None:
        super().__init__("replay")
        values = declare_parameters(self, PARAMETERS)
        if not values["bag"]:
            raise InvalidInputError(
                "parameter bag is empty; expected the path of a bag (-p bag:=PATH)"
            )
        self.exit_code = 0
        self._prefix = values["topic_prefix"].rstrip("/")
        self._clock_publisher = (
            self.create_publisher(Clock, f"{self._prefix}{CLOCK_TOPIC}", 1)
            if values["clock"]
            else None
        )
        self._bag = BagReader(values["bag"])
        self._publishers_by_topic = self._make_publishers(inputs_only=values["inputs_only"])
        self._awaited = [name for name in values["wait_for_subscribers"] if name]
        self._wait_timeout = values["wait_timeout"]
        self._replay = Replay(
            self._bag,
            list(self._publishers_by_topic),
            ReplaySettings(values["rate"], values["loop"], values["start_offset"]),
            self._publish,
            None if self._clock_publisher is None else self._publish_clock,
        )
        self._phase = "waits for subscribers"
        Diagnostics(self).add("bag", self._status)
        self._stopping = threading.Event()
        self._finished = self.create_guard_condition(self._end)
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """Stop playing, then close the bag."""
        self._stopping.set()
        self._replay.stop()
        self._thread.join(STOP_PATIENCE)
        farewell(self._publishers_by_topic.values())
        if not self._thread.is_alive():
            self._bag.close()
        super().destroy_node()

    def _make_publishers(self, *, inputs_only: bool) -> dict[str, Publisher]:
        publishers: dict[str, Publisher] = {}
        again = inputs_only and any(topic.type in SENSOR_TYPES for topic in self._bag.topics)
        for topic in self._bag.topics:
            played = self._played_name(topic.name)
            if again and played.removeprefix(f"{self._prefix}/") in SUITE_TOPICS:
                self.get_logger().info(f"{topic.name} is left out: it is made again")
                continue
            if topic.name == CLOCK_TOPIC and self._clock_publisher is not None:
                self.get_logger().warning(
                    "the bag's own /clock is skipped; set clock:=false to play it instead"
                )
                continue
            message_class = _message_class(topic.type)
            if message_class is None:
                self.get_logger().warning(
                    f"{topic.name} is skipped: its type {topic.type} is not installed"
                )
                continue
            publishers[topic.name] = create_publisher(self, message_class, played, _qos(topic))
        if not publishers:
            raise InvalidInputError(
                f"bag {self._bag.path} has no topic that can be played; "
                "expected messages of types that are installed"
            )
        return publishers

    def _played_name(self, topic: str) -> str:
        if topic in TRANSFORM_TOPICS or topic.startswith(f"{self._prefix}/"):
            return topic
        return f"{self._prefix}{topic}"

    def _run(self) -> None:
        try:
            self._wait_for_subscribers()
            self._phase = "plays"
            self.get_logger().info(
                f"plays {self._bag.path}: {self._bag.duration:.1f} s, "
                f"{', '.join(self._publishers_by_topic)}"
            )
            if self._replay.run():
                farewell(self._publishers_by_topic.values(), ACKNOWLEDGE_TIMEOUT)
                self.get_logger().info("the bag is at its end")
        except IntuitivePhysicsError as error:
            self.exit_code = 1
            self.get_logger().fatal(str(error))
        except Exception as error:
            self.exit_code = 1
            unexpected_errors(self).report(error, "the replay")
        if not self._stopping.is_set():
            self._finished.trigger()

    def _wait_for_subscribers(self) -> None:
        deadline = time.monotonic() + self._wait_timeout
        if missing := self._without_subscriber():
            self.get_logger().info(
                f"waits {self._wait_timeout:g} s at most for a subscriber of {', '.join(missing)}"
            )
        while missing := self._without_subscriber():
            if self._stopping.is_set():
                return
            if time.monotonic() > deadline:
                self._complain(missing)
                return
            self._stopping.wait(POLL_PERIOD)
        self._stopping.wait(SETTLING_TIME)

    def _without_subscriber(self) -> list[str]:
        """Return the topics that are waited for, all of the bag where any of them would do."""
        missing = [name for name in self._awaited if not self._subscriber_count(name)]
        played = list(self._publishers_by_topic)
        if not set(self._awaited) & set(played) and not any(map(self._subscriber_count, played)):
            missing += played
        return missing

    def _subscriber_count(self, name: str) -> int:
        publisher = self._publishers_by_topic.get(name)
        if publisher is not None:
            return publisher.get_subscription_count()
        return self.count_subscribers(name)

    def _complain(self, missing: list[str]) -> None:
        problem = f"nobody subscribed to {', '.join(missing)} within {self._wait_timeout:g} s"
        if self._awaited:
            raise InvalidInputError(
                f"{problem}; expected a subscriber: start it, or leave the topic out of "
                "wait_for_subscribers"
            )
        self.get_logger().warning(
            f"{problem}: plays all the same; to be heard, start a subscriber of one of them or "
            "rename the topic with -r TOPIC:=OTHER"
        )

    def _publish(self, message: BagMessage) -> None:
        if rclpy.ok():
            self._publishers_by_topic[message.topic].publish(message.data)

    def _publish_clock(self, nanoseconds: int) -> None:
        if rclpy.ok() and self._clock_publisher is not None:
            seconds, rest = divmod(nanoseconds, 1_000_000_000)
            self._clock_publisher.publish(Clock(clock=Time(sec=seconds, nanosec=rest)))

    def _end(self) -> None:
        # Ends the executor's spinning, in its own thread.
        raise ExternalShutdownException

    def _status(self) -> Status:
        return Status(
            Level.OK,
            f"{self._phase} {self._bag.path}",
            {
                "position": f"{self._replay.position:.1f} s",
                "duration": f"{self._bag.duration:.1f} s",
            },
        )


def _message_class(type_name: str) -> Any | None:
    """Return the class of a type such as "sensor_msgs/msg/Image", None where it is unknown."""
    package, _, name = type_name.partition("/msg/")
    # A name of a bag is imported: only what is known to be a package of messages is.
    if not TYPE_NAME.fullmatch(type_name) or not _has_messages(package):
        return None
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        return None


def _has_messages(package: str) -> bool:
    """Whether the ROS generators made a Python package, without importing it."""
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # A module that was made by a program and not found.
        return False
    folders = [] if spec is None else spec.submodule_search_locations or []
    return any(
        next(Path(folder).glob(f"{package}_s__rosidl_typesupport_*"), None) is not None
        for folder in folders
    )


def _qos(topic: BagTopic) -> QoSProfile:
    # Reliable matches best-effort (sensor data) subscribers as well as reliable ones.
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    # Who subscribes late to a latched topic receives as many messages as from the robot.
    depth = topic.depth if topic.latched else max(QUEUE_DEPTH, topic.depth)
    return QoSProfile(
        depth=min(depth or QUEUE_DEPTH, LARGEST_DEPTH),
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
    )


def main() -> int:
    """Run the node; exit code 1 when the bag could not be played to its end."""
    made: list[ReplayNode] = []

    def make() -> ReplayNode:
        made.append(ReplayNode())
        return made[-1]

    code = run_node(make)
    return code or (made[-1].exit_code if made else 0)


if __name__ == "__main__":
    sys.exit(main())
