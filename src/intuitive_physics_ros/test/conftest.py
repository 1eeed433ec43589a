"""Messages that check their fields, and a clock that tests set."""

import os
from types import SimpleNamespace

import pytest

# Without this a message takes a field of the wrong type, or one it does not have, in silence.
# It is looked at when a message module is imported; child processes run as they do at users'.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
import diagnostic_msgs.msg  # noqa: F401
import geometry_msgs.msg  # noqa: F401
import intuitive_physics_msgs.msg  # noqa: F401
import std_msgs.msg  # noqa: F401
import visualization_msgs.msg  # noqa: F401

del os.environ["ROS_PYTHON_CHECK_FIELDS"]

from intuitive_physics_ros import monitors, silence


@pytest.fixture
def clock(monkeypatch):
    """Time `now` (s) that a test sets, in place of that of monitors."""
    clock = SimpleNamespace(now=1000.0)
    clock.monotonic = lambda: clock.now
    for module in (monitors, silence):
        monkeypatch.setattr(module, "time", clock)
    return clock
