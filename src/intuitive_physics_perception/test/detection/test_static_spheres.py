"""What was there from the start is a ball where it looks like one in nearly all frames."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.static_spheres import (
    DISTRUST_FRAMES,
    FEWEST_LOOKS,
    STATIC_SUCCESSES,
    StaticSpheres,
)

RADIUS = 0.05
SPHERE = DetectedSphere(np.array([0.1, 0.2, 1.0]), RADIUS, np.eye(4), 300.0, 1.0)
LOOKED, NOT_LOOKED = np.array([True]), np.array([False])


def after(found: list[bool]) -> StaticSpheres:
    """Places after a first frame with the sphere, and others in which it was found or not."""
    spheres = StaticSpheres()
    assert spheres.is_trusted(SPHERE)
    for is_there in found:
        spheres.take(LOOKED, [SPHERE] if is_there else [])
    return spheres


@given(st.lists(st.booleans(), min_size=FEWEST_LOOKS, max_size=FEWEST_LOOKS + 20))
def test_it_is_trusted_as_long_as_it_is_found_in_enough_frames(found: list[bool]) -> None:
    looks = np.arange(1, len(found) + 2)
    hits = np.cumsum([True, *found])
    failed = (looks >= FEWEST_LOOKS) & (hits < STATIC_SUCCESSES * looks)
    assert after(found).is_trusted(SPHERE) == (not failed.any())


def test_what_is_one_in_every_other_frame_is_soon_none() -> None:
    trusted = [after([k % 2 == 1 for k in range(n)]).is_trusted(SPHERE) for n in range(60)]
    assert not any(trusted[2 * FEWEST_LOOKS :])


def test_it_is_judged_anew_after_a_while() -> None:
    spheres = after([False] * (FEWEST_LOOKS - 1))
    for _ in range(DISTRUST_FRAMES):
        assert not spheres.is_trusted(SPHERE)
        spheres.take(LOOKED, [SPHERE])
    assert spheres.is_trusted(SPHERE)


def test_frames_in_which_it_was_not_searched_do_not_count() -> None:
    spheres = after([True])
    for _ in range(3 * FEWEST_LOOKS):
        spheres.take(NOT_LOOKED, [])
    assert spheres.is_trusted(SPHERE)


@given(
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3),
    st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.dot(q, q) > 0.01),
)
def test_a_sensor_that_has_moved_knows_the_place_again(way, turn) -> None:
    spheres = after([False] * (FEWEST_LOOKS - 1))
    pose = RigidTransform(way, np.array(turn) / np.linalg.norm(turn))
    spheres.look_from(pose)
    np.testing.assert_allclose(
        spheres.spheres, [[*pose.inverse.points(SPHERE.center), RADIUS]], atol=1e-9
    )
    seen = SPHERE.moved(pose.inverse.matrix, pose.inverse.translation)
    assert not spheres.is_trusted(seen)
