"""Quality of service of the suite's topics."""

from collections.abc import Callable
from copy import copy
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.qos_overriding_options import QoSOverridingOptions

QOS_OVERRIDES = QoSOverridingOptions.with_default_policies()
"""Overrides of each topic of a node, so that parameters `qos_overrides.TOPIC.publisher.depth` and
the like change history, depth and reliability. rclpy writes them into the profile, so pass it a
copy."""

SENSOR_DATA = qos_profile_sensor_data
"""Subscriptions to sensors and to what is derived from each of their frames: best effort, the
newest few."""

STREAM = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""Topics with a message for each frame or tick: reliable, so that subscribers with the default
quality of service receive them as well as those of best effort."""

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Environment and static parameters: a node that starts late, or again, gets the newest."""

OBSERVATIONS = QoSProfile(
    depth=50,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Finished observations: a learner that starts late, or again, still gets the newest 50."""

RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""Topics whose messages must not be lost while both ends live."""


def create_publisher(node: Node, kind: type[Any], topic: str, profile: QoSProfile) -> Publisher:
    """Create a publisher of messages of a kind, with parameters that override its profile."""
    return node.create_publisher(kind, topic, copy(profile), qos_overriding_options=QOS_OVERRIDES)


def create_subscription(
    node: Node,
    kind: type[Any],
    topic: str,
    callback: Callable[[Any], None],
    profile: QoSProfile,
    *,
    raw: bool = False,
) -> None:
    """Subscribe to messages of a kind, with parameters that override the profile.

    `raw`: whether the callback gets serialised messages.
    """
    node.create_subscription(
        kind, topic, callback, copy(profile), qos_overriding_options=QOS_OVERRIDES, raw=raw
    )
