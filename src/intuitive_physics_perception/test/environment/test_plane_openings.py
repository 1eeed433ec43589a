"""A plane has an opening where the sensor looked through it, and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.environment.plane_openings import (
    EDGE_CELLS,
    opening_mask,
    plane_parts,
)
from intuitive_physics_perception.environment.range_cloud import in_polygon
from intuitive_physics_perception.settings import PerceptionSettings

SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
READINGS = 40000
NARROWEST = 0.03

WALL = 2.2
JAMBS = (-0.35, 0.45)
LINTEL = 1.1
EDGE_TOLERANCE = 0.03
"""m. A wall at 2.2 m has cells of 12 mm, and an edge is up to two cells off."""


@dataclass
class WallWithDoorway:
    """A wall x = WALL with a doorway from the floor to a lintel."""

    lintel: float = LINTEL

    def hit(self, origin, rays):
        with np.errstate(divide="ignore"):
            t = np.where(rays[..., 0] > 0.0, (WALL - origin[0]) / rays[..., 0], np.inf)
        places = origin + np.where(np.isfinite(t), t, 0.0)[..., None] * rays
        y, z = places[..., 1], places[..., 2]
        doorway = (y > JAMBS[0]) & (y < JAMBS[1]) & (z < self.lintel)
        cosine = rays[..., 0] / np.linalg.norm(rays, axis=-1)
        return np.where(doorway, np.inf, t), cosine


def split_square(rng, is_open):
    """Parts of a square of 2 m with openings, which lies in a far larger plane, and the edge of a
    cell of its mask."""
    places = rng.uniform(-1.0, 1.0, (READINGS, 2))
    through = is_open(places)
    mask = opening_mask(places[~through], places[through], SQUARE, NARROWEST)
    return plane_parts(5.0 * SQUARE, SQUARE, *mask), mask[1]


def times_covered(parts, places):
    return sum(in_polygon(part, places).astype(int) for part in parts)


def within(rectangle, margin):
    """Whether places lie in a rectangle that is larger by a margin on all sides."""
    (left, low), (right, high) = rectangle
    return lambda p: (
        (p[:, 0] > left - margin)
        & (p[:, 0] < right + margin)
        & (p[:, 1] > low - margin)
        & (p[:, 1] < high + margin)
    )


@given(st.floats(-0.6, 0.2), st.floats(-0.6, 0.2), st.floats(0.2, 0.35), st.floats(0.2, 0.35))
def test_parts_cover_all_but_the_opening_once(left, low, width, height) -> None:
    rng = np.random.default_rng(0)
    window = ((left, low), (left + width, low + height))
    parts, cell = split_square(rng, within(window, 0.0))
    places = rng.uniform(-1.5, 1.5, (4000, 2))
    covered = times_covered(parts, places)
    assert (covered[~within(window, EDGE_CELLS * cell)(places)] == 1).all()
    assert (covered[within(window, -EDGE_CELLS * cell)(places)] == 0).all()


def test_an_opening_of_the_border_goes_on_there(rng) -> None:
    parts, cell = split_square(rng, within(((-0.3, -1.0), (0.4, 0.2)), 0.0))
    assert len(parts) == 3
    below = np.array([(0.05, y) for y in np.linspace(-4.9, 0.2 - EDGE_CELLS * cell, 50)])
    assert not times_covered(parts, below).any()


def test_an_l_shaped_table_is_two_parts(rng) -> None:
    parts, cell = split_square(rng, within(((0.1, -0.2), (1.0, 1.0)), 0.0))
    assert len(parts) == 2
    assert not times_covered(parts, np.array([(0.1 + EDGE_CELLS * cell, 0.9)])).any()
    assert times_covered(parts, np.array([(0.1 - EDGE_CELLS * cell, 0.9), (0.5, -0.3)])).all()


def test_two_windows_are_two_openings(rng) -> None:
    windows = [within(((x, -0.3), (x + 0.4, 0.3)), 0.0) for x in (-0.7, 0.3)]
    parts, _ = split_square(rng, lambda p: windows[0](p) | windows[1](p))
    covered = times_covered(parts, np.array([(-0.5, 0.0), (0.0, 0.0), (0.5, 0.0)]))
    assert covered.tolist() == [0, 1, 0]


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_stray_readings_behind_a_plane_open_nothing(rng, share) -> None:
    places = rng.uniform(-1.0, 1.0, (READINGS, 2))
    stray = rng.random(READINGS) < share
    assert opening_mask(places[~stray], places[stray], SQUARE, NARROWEST) is None


@pytest.fixture(scope="module")
def doorway(make_room):
    room = make_room(tilt=10.0, height=0.9, walls=(((-1.0, 0.0, 0.0), -4.0),), seed=5)
    frames = [room.points(extra=[WallWithDoorway()]) for _ in range(6)]
    return room, model_environment(frames, PerceptionSettings(), np.random.default_rng(1))


def wall_parts(model):
    return [plane for plane in model.environment.planes if abs(plane.offset + WALL) < 0.02]


def test_a_wall_with_a_doorway_is_three_convex_parts(doorway) -> None:
    parts = wall_parts(doorway[1])
    assert [plane.id.partition("/")[2] for plane in parts] == ["", "part_2", "part_3"]
    y = np.array([JAMBS[0] - EDGE_TOLERANCE, JAMBS[0] + EDGE_TOLERANCE, 0.0, 0.0])
    z = np.array([0.5, 0.5, LINTEL + EDGE_TOLERANCE, LINTEL - EDGE_TOLERANCE])
    places = np.column_stack([np.full(4, WALL), y, z])
    covered = sum(plane.covers(places).astype(int) for plane in parts)
    assert covered.tolist() == [1, 0, 1, 0]
    # Nothing stands in the doorway: it is open down to the floor.
    sill = np.array([[WALL, 0.0, height] for height in (0.0, 0.01, 0.05)])
    assert not any(plane.covers(sill).any() for plane in parts)


def test_what_hides_a_wall_does_not_open_it(make_room, shapes) -> None:
    room = make_room(tilt=10.0, height=0.9, walls=(((-1.0, 0.0, 0.0), -WALL),), seed=5)
    frames = [
        room.points(extra=[shapes["box"]((1.2, 0.0, 0.5), (0.3, 0.4, 0.6), 0.0)]) for _ in "123456"
    ]
    model = model_environment(frames, PerceptionSettings(), np.random.default_rng(1))
    (wall,) = wall_parts(model)
    assert wall.boundary is None


def test_what_is_shown_of_the_parts_lies_in_the_hull(doorway) -> None:
    _, model = doorway
    hulls = dict(zip(model.plane_ids, model.hulls(), strict=True))
    for plane in model.seen_environment().planes:
        hull = hulls[plane.id.partition("/")[0]]
        assert (plane.boundary <= hull.max(axis=0) + 1e-9).all()
        assert (plane.boundary >= hull.min(axis=0) - 1e-9).all()


def test_an_organised_and_an_unorganised_frame_have_the_same_foreground(doorway) -> None:
    room, model = doorway
    frame = room.points(balls=[((3.0, 0.0, 0.4), 0.12)], extra=[WallWithDoorway()])
    finder = ForegroundFinder(model, PerceptionSettings())
    foreground = finder.find(frame).foreground
    # The readings of the ball, whose outline alone differs by single precision.
    assert foreground == pytest.approx(finder.find(frame.reshape(1, -1, 3)).foreground, abs=3)
    assert foreground > 1000


def test_a_ball_beyond_a_lintel_is_found(doorway, pipeline) -> None:
    room, _ = doorway
    found = 0
    for k in range(14):
        center = np.array([3.0, -0.1, 0.4])
        balls = [(center, 0.12)] if k >= 4 else []
        result = pipeline.process(room.points(balls=balls, extra=[WallWithDoorway()]), k / 30)
        found += any(
            isinstance(detection, DetectedSphere)
            and np.linalg.norm(detection.center - center) < 0.05
            for detection in result.detections
        )
    assert found >= 9
