"""Quality of service of the suite's topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data

SENSOR_DATA = qos_profile_sensor_data
"""Sensors and what is derived from each of their frames: best effort, the newest few."""

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
"""What must not be lost while both ends live, such as finished observations."""
