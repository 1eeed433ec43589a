"""Planes end where an edge was seen, and go on where none was."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.environment.plane_edges import REACH, SeenAround, boundary_polygon
from intuitive_physics_perception.settings import PerceptionSettings

SCATTERED = 20000
SPACING = 2.0 / np.sqrt(SCATTERED)
"""m between readings scattered over a square of 2 m."""

EDGE_TOLERANCE = 0.015
"""m. Two pixels, which are what is fused for edges, meet a table at 2 m up to 13 mm apart, and each
edge is a line through many of them; what noise and unevenness let pass for the table adds 5 mm."""


def modelled(room, *boxes, frames=6):
    clouds = [room.points(extra=boxes) for _ in range(frames)]
    return model_environment(clouds, PerceptionSettings(), np.random.default_rng(1))


def perceived(room, *boxes):
    return modelled(room, *boxes).environment


def top_of(environment, height):
    (top,) = [
        plane
        for plane in environment.planes
        if plane.normal[2] > 0.99 and abs(plane.offset - height) < 0.01
    ]
    return top


def distances_to_corners(boundary, corners) -> list[float]:
    """How far each of the true corners (n, 2) is from the nearest one of a boundary."""
    return [np.linalg.norm(boundary[:, :2] - corner, axis=1).min() for corner in corners]


@pytest.fixture(scope="module")
def table_room(make_room):
    return make_room(tilt=35.0, height=1.2, walls=(((-1.0, 0.0, 0.0), -3.2),))


def test_a_room_whose_planes_meet_or_leave_the_view_has_no_edges(corner_model) -> None:
    assert [plane.boundary for plane in corner_model[1].environment.planes] == [None] * 3


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_table_ends_at_its_edges(table_room, shapes, turn) -> None:
    edges = np.array([0.7, 0.9])
    environment = perceived(table_room, shapes["box"]((1.5, 0.0, 0.3), (*edges, 0.6), turn))
    top = top_of(environment, 0.6)
    c, s = np.cos(turn), np.sin(turn)
    corners = 0.5 * edges * [(1, 1), (-1, 1), (-1, -1), (1, -1)] @ np.array([[c, s], [-s, c]])
    assert len(top.boundary) == 4
    assert max(distances_to_corners(top.boundary, corners + [1.5, 0.0])) < EDGE_TOLERANCE
    assert np.abs(top.signed_distances(top.boundary)).max() < 1e-9
    # The floor goes on below it and beyond the view.
    assert top_of(environment, 0.0).boundary is None


def test_the_front_of_a_table_is_no_wall_beside_and_above_it(table_room, shapes) -> None:
    environment = perceived(table_room, shapes["box"]((1.5, 0.0, 0.3), (0.7, 0.9, 0.6), 0.0))
    (front,) = [plane for plane in environment.planes if abs(plane.offset + 1.15) < 0.01]
    above = front.boundary[front.boundary[:, 2] > 0.0]
    assert above[:, 2].max() == pytest.approx(0.6, abs=EDGE_TOLERANCE)
    assert np.abs(above[:, 1]).max() == pytest.approx(0.45, abs=EDGE_TOLERANCE)


def test_a_table_goes_on_where_the_view_ends(table_room, shapes) -> None:
    environment = perceived(table_room, shapes["box"]((1.5, 0.8, 0.3), (0.7, 1.5, 0.6), 0.0))
    boundary = top_of(environment, 0.6).boundary
    corners = [(1.15, 0.05), (1.85, 0.05)]
    assert max(distances_to_corners(boundary, corners)) < EDGE_TOLERANCE
    assert boundary[:, 1].max() > 0.9 * REACH


def test_an_edge_that_something_hides_is_none(table_room, shapes) -> None:
    # A screen before the left half of the table hides all of its left edge. The room has its own
    # noise, whichever tests ran before.
    room = table_room.__class__(tilt=35.0, height=1.2, walls=table_room.walls, seed=1)
    table = shapes["box"]((1.7, 0.0, 0.3), (0.7, 0.8, 0.6), 0.0)
    screen = shapes["box"]((1.1, 0.35, 0.5), (0.05, 0.6, 1.0), 0.0)
    boundary = top_of(perceived(room, table, screen), 0.6).boundary
    far, right, left = 2.05, -0.4, 0.4
    assert boundary[:, 0].max() == pytest.approx(far, abs=EDGE_TOLERANCE)
    assert boundary[:, 1].min() == pytest.approx(right, abs=EDGE_TOLERANCE)
    assert boundary[:, 1].max() > left + 1.0


def scattered(rng, inside) -> SeenAround:
    """Readings all over a square, on the plane where `inside` says so and far behind it else."""
    places = rng.uniform(-1.0, 1.0, (SCATTERED, 2))
    on = inside(places)
    return SeenAround(
        places[on],
        np.full(on.sum(), SPACING),
        places[~on],
        np.ones((~on).sum(), dtype=bool),
        np.zeros((0, 2)),
        places[on],
    )


def hull(places):
    return places[ConvexHull(places).vertices]


def area(corners) -> float:
    (x, y), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
    return 0.5 * float((x * y1 - x1 * y).sum())


def test_a_round_table_is_a_polygon_of_its_size(rng) -> None:
    around = scattered(rng, lambda places: np.linalg.norm(places, axis=1) < 0.6)
    polygon = boundary_polygon(around, hull(around.surface))
    assert area(polygon) == pytest.approx(np.pi * 0.6**2, rel=0.05)


def test_what_is_not_convex_has_no_boundary_that_would_cut_it(rng) -> None:
    around = scattered(rng, lambda p: (np.abs(p).max(axis=1) < 0.7) & ~((p > 0.0).all(axis=1)))
    polygon = boundary_polygon(around, hull(around.surface))
    assert polygon is None or area(polygon) > 3 * 0.7**2


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(0.2, 0.8),
    st.floats(0.2, 0.8),
    st.floats(0.0, np.pi),
    st.floats(0.0, 0.02),
)
def test_a_boundary_is_convex_turns_left_and_holds_the_rectangle(
    seed, width, depth, turn, stray
) -> None:
    rng = np.random.default_rng(seed)
    c, s = np.cos(turn), np.sin(turn)

    def inside(places):
        own = places @ np.array([[c, -s], [s, c]])
        strays = rng.random(len(places)) < stray
        return (np.abs(own) < 0.5 * np.array([width, depth])).all(axis=1) ^ strays

    around = scattered(rng, inside)
    polygon = boundary_polygon(around, hull(around.surface))
    if polygon is None:
        assert stray > 0.0
        return
    sides = np.roll(polygon, -1, axis=0) - polygon
    turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
    assert (turns > -1e-9).all()
    # Never smaller than the rectangle by more than the places of readings leave open.
    assert area(polygon) > (width - 3 * SPACING) * (depth - 3 * SPACING)


def test_two_tables_of_one_height_are_two(table_room, shapes) -> None:
    edges = (0.6, 0.5, 0.6)
    tables = [shapes["box"]((1.5, y, 0.3), edges, 0.0) for y in (-0.45, 0.45)]
    environment = perceived(table_room, *tables)
    tops = [plane for plane in environment.planes if plane.normal[2] > 0.99 and plane.offset > 0.5]
    assert len(tops) == 2
    middles = sorted(float(top.boundary.mean(axis=0)[1]) for top in tops)
    assert middles == pytest.approx([-0.45, 0.45], abs=EDGE_TOLERANCE)


def test_a_floor_that_something_cuts_in_two_is_one(table_room, shapes) -> None:
    pillar = shapes["box"]((0.6, 0.0, 0.9), (0.1, 0.2, 1.8), 0.0)
    model = modelled(table_room, pillar)
    (floor,) = [k for k, p in enumerate(model.environment.planes) if p.normal[2] > 0.99]
    assert model.environment.planes[floor].boundary is None
    # What was seen of it reaches to both sides of the pillar and of its shadow.
    across = model.hulls()[floor][:, 1]
    assert across.min() < -0.5
    assert across.max() > 0.5
