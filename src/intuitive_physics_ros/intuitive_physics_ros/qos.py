"""Quality of service of the suite's topics."""

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
