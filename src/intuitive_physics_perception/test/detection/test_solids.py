"""Boxes and capsules: where they are, how they lie, how large they are, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.scene import Environment, StaticBox
from intuitive_physics.shapes import Box, Capsule
from intuitive_physics_perception.detection.box_fit import BEYOND_ENDS, ends_of_row
from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.detection.solids import SolidFinder
from intuitive_physics_perception.environment.static_boxes import StaticBoxFilter
from intuitive_physics_perception.settings import PerceptionSettings

SETTINGS = PerceptionSettings()


@pytest.fixture(scope="module")
def find(corner_model):
    """Solids of a depth image of the corner, in the world."""
    room, model = corner_model
    foreground = ForegroundFinder(model, SETTINGS)
    finder = SolidFinder(model, SETTINGS, np.random.default_rng(4))

    def solids(*shapes, balls=()):
        points = room.points(balls, shapes)
        fits = finder.find(points, foreground.find(points).indices)
        return [solid.moved(room.rotation, room.origin) for solid in fits if solid is not None]

    return solids


def sorted_edges(solid):
    return np.sort(solid.shape.edge_lengths)


def face_error(solid, rotation):
    """Largest angle in degrees of the box's axes to the nearest of the true ones."""
    cosines = np.abs(solid.rotation.T @ rotation).max(axis=1)
    return np.degrees(np.arccos(np.clip(cosines, 0, 1))).max()


@given(st.floats(-1.0, 1.0), st.floats(0.05, 0.5), st.integers(100, 500), st.floats(0.0, 1.0))
def test_an_even_row_ends_where_it_does_whatever_few_stray_beyond(low, length, count, part) -> None:
    row = low + length * (np.arange(count) + 0.5) / count
    ends = low, low + length
    assert ends_of_row(row) == pytest.approx(ends, abs=length / count)
    strays = np.full(int(part * BEYOND_ENDS * count), low + 2.0 * length)
    assert ends_of_row(np.append(row, strays)) == pytest.approx(ends, abs=0.03 * length)


@pytest.mark.parametrize("seed", range(6))
def test_a_box_in_the_air(find, shapes, seed) -> None:
    rng = np.random.default_rng(seed)
    edges = np.array([0.12, 0.2, 0.28])
    rotation = Rotation.random(random_state=seed).as_matrix()
    # At least two faces must be seen well.
    view = rotation.T @ np.array([1.0, 0.0, -0.2])
    while np.sort(np.abs(view))[1] < 0.4:
        rotation = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        view = rotation.T @ np.array([1.0, 0.0, -0.2])
    center = np.array([1.5, rng.uniform(-0.2, 0.2), 0.55])
    (solid,) = find(shapes["box"](center, edges, rotation))
    assert isinstance(solid.shape, Box)
    assert solid.center == pytest.approx(center, abs=0.02)
    assert sorted_edges(solid) == pytest.approx(edges, abs=0.025)
    assert face_error(solid, rotation) < 4.0


@pytest.mark.parametrize("turn", [0.3, 0.7, 1.2])
def test_a_box_on_the_floor_reaches_down_to_it(find, shapes, turn) -> None:
    (solid,) = find(shapes["box"]((1.5, 0.0, 0.08), (0.2, 0.24, 0.16), turn))
    assert solid.center == pytest.approx([1.5, 0.0, 0.08], abs=0.015)
    assert sorted_edges(solid) == pytest.approx([0.16, 0.2, 0.24], abs=0.02)
    lowest = solid.center[2] - 0.5 * np.abs(solid.rotation[2]) @ solid.shape.edge_lengths
    assert lowest == pytest.approx(0.0, abs=0.008)


@pytest.mark.parametrize("seed", range(6))
def test_a_capsule_in_the_air(find, shapes, seed) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3) * [0.5, 1.0, 1.0]
    axis /= np.linalg.norm(axis)
    radius, half = rng.uniform(0.03, 0.06), rng.uniform(0.05, 0.12)
    center = np.array([rng.uniform(1.2, 1.7), rng.uniform(-0.2, 0.2), 0.5])
    (solid,) = find(shapes["capsule"](center, half * axis, radius))
    assert isinstance(solid.shape, Capsule)
    assert solid.center == pytest.approx(center, abs=0.01)
    assert solid.shape.radius == pytest.approx(radius, abs=0.004)
    assert solid.shape.length == pytest.approx(2 * half, abs=0.015)
    assert abs(solid.rotation[:, 2] @ axis) > np.cos(np.radians(4.0))


def test_balls_bowls_and_cylinders_are_neither(find, shapes) -> None:
    assert find(balls=[((1.5, 0.1, 0.5), 0.07)]) == []
    assert find(shapes["bowl"]((1.4, 0.0, 0.4), 0.1)) == []
    assert find(shapes["cylinder"](1.4, 0.1, 0.06, 0.3)) == []


def test_a_box_of_which_one_face_is_seen_has_no_depth(find, shapes) -> None:
    # Its axes along the line of sight of the middle of the image.
    tilt = Rotation.from_euler("y", 25.0, degrees=True).as_matrix()
    assert find(shapes["box"]((1.5, 0.0, 0.1), (0.3, 0.2, 0.2), tilt)) == []


def test_what_the_image_cuts_off_is_not_measured(corner_model, find, shapes) -> None:
    room, _ = corner_model
    edge = room.rotation @ (np.array([(0 - 319.5) / room.focal, -0.1, 1.0]) * 1.5) + room.origin
    assert find(shapes["box"](edge, (0.2, 0.2, 0.2), 0.6)) == []


def furnished(corner_model, place, edges, turn):
    """The model of the corner with a static box, whose true place is in the world."""
    room, model = corner_model
    rotation = Rotation.from_matrix(model.rotation @ room.rotation.T)
    rotation *= Rotation.from_euler("z", turn)
    center = model.to_environment(room.to_camera(place))
    crate = StaticBox("crate", "wood", center, rotation.as_quat(), edges)
    environment = model.environment
    return replace(model, environment=Environment(environment.planes, [crate], environment.gravity))


def test_a_static_box_of_the_environment_is_no_object(corner_model, shapes) -> None:
    room, model = corner_model
    place, edges = np.array([1.5, 0.0, 0.08]), (0.2, 0.24, 0.16)
    points = room.points(extra=[shapes["box"](place, edges, 0.7)])
    clusters = ForegroundFinder(model, SETTINGS).find(points).indices
    for world, count in ((model, 1), (furnished(corner_model, place, edges, 0.7), 0)):
        finder = SolidFinder(world, SETTINGS, np.random.default_rng(4))
        solids = [solid for solid in finder.find(points, clusters) if solid is not None]
        assert len(solids) == count


def test_a_crate_is_a_static_box_and_a_ball_before_it_or_on_it_is_not(corner_model, shapes) -> None:
    room, _ = corner_model
    place, edges = np.array([1.6, 0.0, 0.1]), (0.3, 0.3, 0.2)
    model = furnished(corner_model, place, edges, 0.5)
    foreground = ForegroundFinder(model, SETTINGS)
    static_boxes = StaticBoxFilter(model, SETTINGS)
    box = shapes["box"](place, edges, 0.5)
    for balls in ([], [((1.25, 0.0, 0.25), 0.05)], [((1.6, 0.0, 0.25), 0.05)]):
        points = room.points(balls, [box])
        clusters = static_boxes.without(points, foreground.find(points))
        assert len(clusters.indices) == len(balls)
        if balls:
            center = room.to_camera(np.array(balls[0][0]))
            readings = points.reshape(-1, 3)[clusters.indices[0]]
            assert np.linalg.norm(readings - center, axis=1).min() < 0.055
