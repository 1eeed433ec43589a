"""What stands still is a ball where it looks like one in nearly all frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.detection.detections import Bulge, DetectedSphere, Outline
from intuitive_physics_perception.detection.static_spheres import (
    BALL_HITS,
    DISTRUST_FRAMES,
    StaticSpheres,
    evidence_of_looks,
)

RADIUS = 0.05
LOOKED, NOT_LOOKED = np.array([True]), np.array([False])


def sphere(new: float, known: float, unknown: float) -> DetectedSphere:
    """A sphere with parts of its readings where nothing was, something was, and nobody looked."""
    bulge = Bulge(np.zeros(3), np.eye(3))
    outline = Outline(new, known, unknown, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, bulge)
    center = np.array([0.1, 0.2, 1.0])
    return DetectedSphere(center, RADIUS, np.eye(4), 300, 1.0, outline=outline)


SPHERE = sphere(new=0.0, known=1.0, unknown=0.0)


def after(
    found: list[bool], first: DetectedSphere = SPHERE, looks_before: int = 0
) -> StaticSpheres:
    """Places after a first frame with the sphere, and others in which it was found or not.

    `looks_before`: frames before the first one, without it.
    """
    spheres = StaticSpheres()
    for _ in range(looks_before):
        spheres.take(np.zeros(0, dtype=bool), [])
    spheres.take(np.zeros(0, dtype=bool), [first])
    for is_there in found:
        spheres.take(LOOKED, [first] if is_there else [])
    return spheres


@given(hits=st.integers(0, 30), misses=st.integers(0, 10))
def test_the_evidence_is_that_of_bayes(hits: int, misses: int) -> None:
    def chance(power: float) -> float:
        """Of these looks, for a chance p of each of density (power + 1) p^power."""
        looks = (lambda p: p ** (power + hits) * (1.0 - p) ** misses), 0.0, 1.0
        return (power + 1.0) * quad(*looks, epsabs=0.0)[0]

    expected = np.log(chance(BALL_HITS - 1.0) / chance(0.0))
    assert evidence_of_looks(hits, misses) == pytest.approx(expected, abs=1e-5)


def test_a_ball_that_is_missed_now_and_then_stays_one() -> None:
    found = [k % 30 != 29 for k in range(300)]
    assert all(after(found[:n]).is_trusted(SPHERE) for n in range(0, 300, 10))


def test_what_is_one_in_every_other_frame_is_none() -> None:
    trusted = [after([k % 2 == 1 for k in range(n)]).is_trusted(SPHERE) for n in range(60)]
    assert trusted[0]
    assert not any(trusted[1:])


def test_what_an_earlier_frame_has_shown_is_no_ball_before_it_was_one_for_a_while() -> None:
    first = [after([True] * n, looks_before=1).is_trusted(SPHERE) for n in range(20)]
    needed = next(h for h in range(20) if evidence_of_looks(h, 1) > 0.0)
    assert first == [n + 1 >= needed for n in range(20)]


@pytest.mark.parametrize(
    ("new", "known", "unknown", "trusted"),
    [
        (1.0, 0.0, 0.0, True),  # has come
        (0.0, 0.0, 1.0, True),  # where nobody has looked
        (0.0, 0.2, 0.0, False),  # most of it as near to a plane as noise is
        (0.0, 0.4, 0.6, True),
        (0.2, 0.8, 0.0, True),  # too near to what stood there to be new
    ],
)
def test_only_what_was_seen_before_was_missed(new, known, unknown, trusted) -> None:
    first = sphere(new, known, unknown)
    assert after([], first, looks_before=1).is_trusted(first) == trusted


def test_it_is_judged_anew_after_a_while() -> None:
    failed = [False] * 3
    assert not after(failed + [True] * DISTRUST_FRAMES).is_trusted(SPHERE)
    assert after(failed + [True] * (DISTRUST_FRAMES + 10)).is_trusted(SPHERE)


def test_frames_in_which_it_was_not_searched_do_not_count() -> None:
    spheres = after([True])
    for _ in range(15):
        spheres.take(NOT_LOOKED, [])
    assert spheres.is_trusted(SPHERE)


@given(
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3),
    st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.dot(q, q) > 0.01),
)
def test_a_sensor_that_has_moved_knows_the_place_again(way, turn) -> None:
    spheres = after([False] * 4)
    pose = RigidTransform(way, np.array(turn) / np.linalg.norm(turn))
    spheres.look_from(pose)
    np.testing.assert_allclose(
        spheres.spheres, [[*pose.inverse.points(SPHERE.center), RADIUS]], atol=1e-9
    )
    seen = SPHERE.moved(pose.inverse.matrix, pose.inverse.translation)
    assert not spheres.is_trusted(seen)
