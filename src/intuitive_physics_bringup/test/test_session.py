"""A recorded session has all inputs and all results."""

from __future__ import annotations

import pytest

from intuitive_physics_bringup.connections import CAMERAS, session_topics

MADE = {
    f"intuitive_physics/{topic}"
    for topic in (
        "environment",
        "object_states",
        "observations",
        "static_parameters",
        "predictions",
    )
}


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("color", [False, True])
def test_inputs_of_perception_are_recorded(camera, color):
    inputs = CAMERAS[camera].topics(color=color)
    images = session_topics(CAMERAS[camera], color=color)
    heard = {"~/depth/image", "~/depth/camera_info", "~/imu"} | (
        {"~/color/image"} if color else set()
    )
    assert {f"/{inputs[name]}" for name in heard} <= set(images)
    assert f"/{inputs['~/points']}" not in images
    clouds = session_topics(CAMERAS[camera], clouds=True)
    assert f"/{CAMERAS[camera].points}" in clouds
    assert f"/{CAMERAS[camera].depth_image}" not in clouds
    # Where the camera is, and what one recording differs from the next in.
    for topics in (images, clouds):
        assert {"/tf", "/tf_static", *(f"/{name}" for name in MADE)} <= set(topics)
        assert len(topics) == len(set(topics))


def test_a_robot_has_its_own_topics():
    topics = session_topics(CAMERAS["generic"], "left/arm")
    shared = {"/tf", "/tf_static", "/diagnostics"}
    assert all(topic.startswith("/left/arm/") for topic in set(topics) - shared)
    assert shared <= set(topics)
