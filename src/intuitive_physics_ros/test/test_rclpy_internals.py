"""What the suite takes from inside rclpy is still there; else this says what a release changed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from intuitive_physics_ros.rclpy_internals import RCLError, parameter_overrides


@pytest.fixture
def context() -> Iterator[rclpy.Context]:
    made = rclpy.Context()
    rclpy.init(context=made)
    yield made
    made.try_shutdown()


def test_rcl_errors_have_a_class_of_their_own() -> None:
    assert issubclass(RCLError, Exception), "rclpy's implementation module lost RCLError"
    with pytest.raises(RCLError):
        rclpy.init(args=["--ros-args", "--remap", "not a rule"], context=rclpy.Context())


def test_a_node_knows_what_the_user_gave(context: rclpy.Context) -> None:
    given = [Parameter("unknown_to_the_node", value=3)]
    node = Node("any_node", context=context, parameter_overrides=given)
    try:
        overrides = parameter_overrides(node)
        assert "unknown_to_the_node" in overrides, "rclpy.node.Node lost _parameter_overrides"
        assert overrides["unknown_to_the_node"].value == 3
    finally:
        node.destroy_node()
