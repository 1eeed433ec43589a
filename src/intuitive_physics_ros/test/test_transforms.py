"""What is said of transforms that are not there."""

from __future__ import annotations

import pytest
import rclpy
from rclpy.node import Node


@pytest.mark.needs("tf2_ros")
def test_an_unknown_transform_is_named_in_one_short_line() -> None:
    from intuitive_physics_ros.transforms import Transforms, UnknownTransformError

    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node("listening", context=context)
    try:
        with pytest.raises(UnknownTransformError) as raised:
            Transforms(node).lookup("target" * 100_000, "source\n" * 100_000)
        assert len(str(raised.value)) < 1000
        assert "\n" not in str(raised.value)
    finally:
        node.destroy_node()
        context.try_shutdown()
