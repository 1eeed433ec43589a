"""What lies where one has looked and nothing stood is new; what lies elsewhere is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.environment.known_space import (
    BEHIND,
    KNOWN,
    MOST_VIEWS,
    NEW,
    SAME_PLACE,
    UNKNOWN,
    KnownSpace,
)
from intuitive_physics_perception.environment.noise import RangeNoise

NOISE = RangeNoise(0.002, 0.0, 0.05, 1e-4)
WALL = 3.0
SPACING = 0.004
TANGENT = 0.5
"""Of the half angle of the camera's image."""

EDGE = 4.0 * SPACING * WALL
"""Distance from an edge within which cells of directions hold both of its sides, m."""


def wall_frame(post: bool = False) -> NDArray[np.float32]:
    """A wall across the optical axis; a post of 0.4 m at half the distance, if there is one."""
    a = np.linspace(-TANGENT, TANGENT, round(2.0 * TANGENT / SPACING))
    x, y = np.meshgrid(a, a)
    depth = np.full_like(x, WALL)
    if post:
        depth[np.abs(x) * 0.5 * WALL < 0.2] = 0.5 * WALL
    return np.stack([x * depth, y * depth, depth], axis=-1).astype(np.float32)


def space_of(*frames: NDArray[np.float32]) -> KnownSpace:
    space = KnownSpace(NOISE, SPACING)
    for frame in frames:
        space.take(space.view([frame], RigidTransform()))
    return space


def mark_of(space: KnownSpace, place: tuple[float, float, float], pose: RigidTransform) -> int:
    """Mark of a reading at a place of the frame that stands still."""
    reading = pose.inverse.points(np.array([place])).astype(np.float32)
    return int(space.marks(reading, np.array([0]), pose)[0])


@settings(max_examples=200, deadline=None)
@given(
    depth=st.floats(0.3, 5.0),
    x=st.floats(-2.0, 2.0),
    y=st.floats(-2.0, 2.0),
    shift=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    angle=st.floats(-np.pi, np.pi),
)
def test_a_ray_was_free_up_to_what_was_read_on_it(depth, x, y, shift, angle) -> None:
    """Before the wall within the image NEW, at it KNOWN, beside the image UNKNOWN, and behind it as
    well, unless the sensor is where it was, wherever it is now."""
    half = 0.5 * angle
    pose = RigidTransform(shift, (0.0, np.sin(half), 0.0, np.cos(half)))
    found = mark_of(space_of(wall_frame()), (x, y, depth), pose)
    sideways = max(abs(x), abs(y)) / depth
    if sideways > TANGENT + 4.0 * SPACING:
        assert found == UNKNOWN
    elif sideways < TANGENT - 4.0 * SPACING:
        if depth < WALL - 0.1:
            assert found == NEW
        elif depth > WALL + 0.1:
            stays = np.linalg.norm(shift) < SAME_PLACE and abs(angle) < SAME_PLACE
            assert found == (BEHIND if stays else UNKNOWN)
        elif abs(depth - WALL) < 0.002:
            assert found == KNOWN


def test_what_is_read_where_a_view_was_is_unknown() -> None:
    assert mark_of(space_of(wall_frame()), (0.0, 0.0, 0.0), RigidTransform((0, 0, -1))) == UNKNOWN


def test_what_a_post_hides_is_unknown() -> None:
    space, here = space_of(wall_frame(post=True)), RigidTransform()
    elsewhere = RigidTransform((0.1, 0.0, 0.0))
    beside = 0.2 + EDGE
    assert mark_of(space, (0.0, 0.0, 0.5 * WALL), here) == KNOWN
    assert mark_of(space, (0.0, 0.0, 0.75 * WALL), here) == BEHIND
    assert mark_of(space, (0.0, 0.0, WALL), here) == BEHIND
    assert mark_of(space, (0.0, 0.0, WALL), elsewhere) == UNKNOWN
    assert mark_of(space, (beside, 0.0, 0.5 * WALL), here) == NEW
    assert mark_of(space, (0.0, 0.0, 0.25 * WALL), here) == NEW


@pytest.mark.parametrize(("last", "mark"), [(False, NEW), (True, KNOWN)])
def test_the_newest_view_tells(last, mark) -> None:
    """Where a post has gone, one that comes is new; where it has come, it is known."""
    space = space_of(wall_frame(post=not last), wall_frame(post=last))
    assert mark_of(space, (0.0, 0.0, 0.5 * WALL), RigidTransform()) == mark


@given(seed=st.integers(0, 10_000))
def test_each_reading_of_a_frame_is_marked_as_it_is_alone(seed) -> None:
    """Whichever are asked for, and whichever of two views from two places decides; others get 0."""
    rng = np.random.default_rng(seed)
    space, aside = space_of(wall_frame()), RigidTransform((0.5, 0.1, 0.0))
    space.take(space.view([wall_frame(post=True)], aside))
    frame = (wall_frame(post=bool(seed % 2)).reshape(-1, 3) * rng.uniform(0.3, 1.7)).astype("f4")
    frame = frame[rng.random(len(frame)) < 0.01]
    before = np.flatnonzero(rng.random(len(frame)) < 0.5)
    expected = np.zeros(len(frame), dtype=np.uint8)
    for k in before:
        expected[k] = space.marks(frame[k : k + 1], np.array([0]), aside)[0]
    assert space.marks(frame, before, aside).tolist() == expected.tolist()


def test_the_first_view_stays_however_many_come() -> None:
    space = space_of(wall_frame())
    behind = RigidTransform((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
    for _ in range(2 * MOST_VIEWS):
        space.take(space.view([wall_frame()], behind))
    assert mark_of(space, (0.0, 0.0, 1.0), RigidTransform()) == NEW
    assert mark_of(space, (0.0, 0.0, -1.0), RigidTransform()) == NEW


def test_frames_that_differ_fill_each_other() -> None:
    """A scanner whose pattern does not repeat sees in many frames what none shows whole."""
    frame = wall_frame().reshape(-1, 3)
    parts = np.array_split(np.random.default_rng(0).permutation(frame), 4 * MOST_VIEWS)
    space = KnownSpace(NOISE, SPACING)
    for part in parts:
        space.fill(space.view([part[None]], RigidTransform()))
    before = (0.5 * frame).astype(np.float32)
    assert (space.marks(before, np.arange(len(before)), RigidTransform()) == NEW).all()


def test_what_is_known_stays_where_a_view_is_filled() -> None:
    """Something that passes later is no part of what stood there."""
    space = space_of(wall_frame())
    space.fill(space.view([wall_frame(post=True)], RigidTransform()))
    assert mark_of(space, (0.0, 0.0, 0.5 * WALL), RigidTransform()) == NEW
