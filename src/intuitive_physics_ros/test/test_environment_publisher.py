"""The environment's frame hangs below the camera's where the camera stands."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Header

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.messages.geometry import xyz, xyzw
from intuitive_physics.scene import Environment, Plane
from intuitive_physics_ros.environment_publisher import EnvironmentPublisher, transform_from_parent
from intuitive_physics_ros.qos import LATCHED

number = st.floats(-3.0, 3.0)


@given(
    st.tuples(number, number, number),
    st.tuples(number, number, number, number).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(number, number, number),
)
def test_there_and_back_is_where_one_was(position, quaternion, point) -> None:
    orientation = np.array(quaternion) / np.linalg.norm(quaternion)
    camera = Header(frame_id="camera")
    pose = RigidTransform(position, orientation)
    message = transform_from_parent("environment", camera, pose)
    assert (message.header.frame_id, message.child_frame_id) == ("camera", "environment")
    in_environment = rotation_matrix(orientation) @ np.array(point) + position
    turn = np.array(xyzw(message.transform.rotation))
    back = rotation_matrix(turn) @ in_environment + xyz(message.transform.translation)
    assert back == pytest.approx(point, abs=1e-9)


@dataclass
class TFMessage:
    """The one field of tf2_msgs/TFMessage, of which there is no wheel."""

    transforms: list = field(default_factory=list)


class PublishingNode:
    """Keeps what is published, by type, topic and quality of service."""

    def __init__(self) -> None:
        self.published: dict[tuple, list] = {}

    def create_publisher(self, kind, topic, qos, **options):
        sent = self.published.setdefault((kind.__name__, topic, qos == LATCHED), [])
        return SimpleNamespace(publish=sent.append)


@pytest.mark.parametrize("installed", [True, False])
def test_the_transform_is_published_where_tf2_msgs_is_installed(monkeypatch, installed) -> None:
    stand_in = ModuleType("tf2_msgs.msg")
    stand_in.TFMessage = TFMessage
    # None makes an import fail.
    monkeypatch.setitem(sys.modules, "tf2_msgs", ModuleType("tf2_msgs") if installed else None)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", stand_in if installed else None)
    node = PublishingNode()
    publisher = EnvironmentPublisher(node)
    position = np.array([0.1, -0.2, 0.8])
    pose = RigidTransform(position, (0.5, 0.5, -0.5, 0.5))
    for _ in range(2):
        publisher.publish(
            Environment([Plane("floor", "wood", (0, 0, 1), 0.0)], frame_id="room"),
            camera=Header(frame_id="camera"),
            camera_pose=pose,
        )
    publisher.hang("room", Header(frame_id="camera"), pose)
    environments = node.published.pop(("Environment", "intuitive_physics/environment", True))
    assert [message.version for message in environments] == [1, 2]
    if not installed:
        assert node.published == {}
        return
    (transform,) = node.published[("TFMessage", "/tf_static", True)][0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("camera", "room")
    # The camera stands at the origin of its own frame: there and back again.
    turn = np.array(xyzw(transform.transform.rotation))
    back = rotation_matrix(turn) @ position + xyz(transform.transform.translation)
    assert back == pytest.approx(np.zeros(3), abs=1e-12)
