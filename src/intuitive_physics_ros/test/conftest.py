"""Messages that check what is put into them."""

import os

# Without this a message takes a field of the wrong type, or one it does not have, in silence.
# It is looked at when a message module is imported; child processes run as they do at users'.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
import diagnostic_msgs.msg  # noqa: F401
import geometry_msgs.msg  # noqa: F401
import intuitive_physics_msgs.msg  # noqa: F401
import std_msgs.msg  # noqa: F401
import visualization_msgs.msg  # noqa: F401

del os.environ["ROS_PYTHON_CHECK_FIELDS"]
