"""What the suite takes from inside rclpy is still there; else this says what a release changed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from intuitive_physics_ros.rclpy_internals import (
    AnsweringLifecycleNode,
    RCLError,
    parameter_overrides,
    refuse_unknown_types,
)
from intuitive_physics_ros.scripting import Peer


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


@pytest.mark.parametrize("kind", [SetParameters, SetParametersAtomically])
def test_a_parameter_of_a_type_that_does_not_exist_is_refused(
    context: rclpy.Context, kind: type
) -> None:
    node = Node("any_node", context=context)
    node.declare_parameter("known", 1)
    refuse_unknown_types(node)
    service = next(one for one in node.services if one.srv_type is kind)
    good = ParameterMessage(name="known", value=ParameterValue(type=2, integer_value=2))
    bad = ParameterMessage(name="known", value=ParameterValue(type=10))
    try:
        for parameters, is_set in (([good, bad], False), ([good], True)):
            answer = service.callback(kind.Request(parameters=parameters), kind.Response())
            results = answer.results if kind is SetParameters else [answer.result]
            assert [one.successful for one in results] == [is_set] * len(results)
            assert len(results) == (len(parameters) if kind is SetParameters else 1)
            assert node.get_parameter("known").value == (2 if is_set else 1)
    finally:
        node.destroy_node()


def test_a_destroyed_lifecycle_node_has_left_the_middleware(context: rclpy.Context) -> None:
    node = AnsweringLifecycleNode("leaving", context=context)
    with Peer("watcher", timeout=10.0) as peer:
        peer.spin_until(lambda: "leaving" in peer.node.get_node_names(), "the node")
        node.destroy_node()
        peer.spin_until(lambda: "leaving" not in peer.node.get_node_names(), "its end")
