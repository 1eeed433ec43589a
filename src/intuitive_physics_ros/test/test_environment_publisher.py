"""The environment's frame hangs below the camera's where the camera stands."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Header

from intuitive_physics_ros.conversions.geometry import rotated, xyz, xyzw
from intuitive_physics_ros.environment_publisher import transform_from_camera

number = st.floats(-3.0, 3.0)


@given(
    st.tuples(number, number, number),
    st.tuples(number, number, number, number).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(number, number, number),
)
def test_there_and_back_is_where_one_was(position, quaternion, point) -> None:
    orientation = np.array(quaternion) / np.linalg.norm(quaternion)
    camera = Header(frame_id="camera")
    message = transform_from_camera("environment", camera, np.array(position), orientation)
    assert (message.header.frame_id, message.child_frame_id) == ("camera", "environment")
    in_environment = rotated(orientation, np.array(point)) + position
    turn = np.array(xyzw(message.transform.rotation))
    back = rotated(turn, in_environment) + xyz(message.transform.translation)
    assert back == pytest.approx(point, abs=1e-9)
