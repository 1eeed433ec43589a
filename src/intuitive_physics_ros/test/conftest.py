"""Own DDS domain for this package's tests, and messages that check what is put into them."""

import os

os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

# Without this a message takes a field of the wrong type, or one it does not have, in silence.
# It is looked at when a message module is imported; child processes run as they do at users'.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
import diagnostic_msgs.msg  # noqa: F401
import geometry_msgs.msg  # noqa: F401
import intuitive_physics_msgs.msg  # noqa: F401
import std_msgs.msg  # noqa: F401
import visualization_msgs.msg  # noqa: F401

del os.environ["ROS_PYTHON_CHECK_FIELDS"]
