"""Messages of others say what the suite's own say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Header

from intuitive_physics.messages.geometry import xyz
from intuitive_physics.scene import SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions import object_state_to_message, stamp_from_seconds
from intuitive_physics_ros.conversions.scenes import (
    box_around,
    detections_to_message,
)

length = st.floats(0.01, 2.0)
shapes = st.one_of(
    st.builds(Sphere, length),
    st.builds(Box, st.tuples(length, length, length)),
    st.builds(Capsule, length, length),
)


@given(shapes, st.integers(0, 2**32 - 1))
def test_the_box_around_a_shape_just_holds_it(shape: Shape, seed: int) -> None:
    half = 0.5 * box_around(shape)
    # The middles of its six sides touch the shape, and beyond them nothing does.
    for axis in range(3):
        middle = np.zeros(3)
        middle[axis] = half[axis]
        assert shape.contains(middle * (1.0 - 1e-9))
        assert not shape.contains(middle * (1.0 + 1e-6))
    outside = np.random.default_rng(seed).uniform(-2.0, 2.0, (20, 3))
    outside = outside[(np.abs(outside) > 1.0).any(axis=1)] * half
    assert not any(shape.contains(point) for point in outside)


@pytest.mark.needs("vision_msgs")
def test_detections_have_pose_covariance_size_and_id() -> None:
    crate = SceneObject("crate_1", "wood", Box((0.1, 0.2, 0.3)))
    covariance = np.diag(np.arange(1.0, 13.0))
    state = ObjectState((1, 2, 3), (0.0, 0.6, 0.0, 0.8), (4, 5, 6), (7, 8, 9), covariance)
    header = Header(frame_id="room", stamp=stamp_from_seconds(7.5))
    message = detections_to_message([crate], [state], header)
    own = object_state_to_message(crate, state)
    (detection,) = message.detections
    assert (message.header, detection.header) == (header, header)
    assert detection.id == "crate_1"
    assert detection.bbox.center == own.pose.pose
    assert xyz(detection.bbox.size) == (0.1, 0.2, 0.3)
    (result,) = detection.results
    assert (result.hypothesis.class_id, result.hypothesis.score) == ("wood", 1.0)
    assert list(result.pose.covariance) == list(own.pose.covariance)
