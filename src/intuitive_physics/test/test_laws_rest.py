"""Rest is balance: what nothing holds starts, however slowly, and what is held stands."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState

from .laws_scenes import (
    EVENT_DRIVEN,
    STEPPED,
    Body,
    G,
    about_y,
    coefficients,
    downhill,
    engines,
    incline,
    make_scene,
    on_incline,
)

SLOPES = np.radians([0.02, 0.1, 0.3])
EDGE = 0.2


@pytest.mark.parametrize("slope", SLOPES)
@engines(EVENT_DRIVEN, STEPPED)
def test_a_ball_that_nothing_holds_starts(engine, slope):
    # Rolling without slip and resistance: a = 5/7 g sin α, from rest, so 5/14 g sin α t².
    radius, t = 0.1, np.linspace(0.5, 10.0, 20)
    ball = Body(Sphere(radius), on_incline(slope, radius))
    path = engine.path(make_scene(ball, planes=[incline(slope)]), coefficients(), t)[0]
    expected = 5 / 14 * G * np.sin(slope) * t**2
    np.testing.assert_allclose(
        (path - path[0]) @ downhill(slope), expected - expected[0], rtol=1e-6
    )


@pytest.mark.parametrize("slope", SLOPES)
def test_a_box_without_friction_starts(slope):
    # a = g sin α.
    t = np.linspace(0.5, 10.0, 20)
    box = Body(Box((EDGE,) * 3), on_incline(slope, EDGE / 2), about_y(slope))
    path = STEPPED.path(make_scene(box, planes=[incline(slope)]), coefficients(0.0), t)[0]
    expected = 0.5 * G * np.sin(slope) * t**2
    np.testing.assert_allclose(
        (path - path[0]) @ downhill(slope), expected - expected[0], rtol=1e-4
    )


@pytest.mark.parametrize(("part", "holds"), [(0.99, True), (1.01, False)])
def test_friction_holds_a_box_up_to_its_angle(part, holds):
    # It holds as long as tan α ≤ μ_s; the box is too flat to tip.
    slope = np.arctan(part * 0.5)
    box = Body(Box((EDGE, EDGE, 0.05)), on_incline(slope, 0.025), about_y(slope))
    scene = make_scene(box, planes=[incline(slope)])
    path = STEPPED.path(scene, coefficients(0.5), [0.1, 5.0])[0]
    moved = np.linalg.norm(path[1] - path[0])
    # Beyond it, a = g (sin α - μ cos α) = 0.01 / 1.01 g sin α.
    expected = 0.0 if holds else 0.5 * 0.01 / 1.01 * G * np.sin(slope) * (5.0**2 - 0.1**2)
    assert moved == pytest.approx(expected, rel=0.01, abs=2e-5)


@pytest.mark.parametrize("degrees", [0.02, 0.05, 0.2])
def test_a_cube_off_balance_on_its_edge_falls(degrees):
    # About the edge, I φ'' = m g d sin φ with I = 2/3 m a² and d = a / √2, from rest: at small
    # angles φ = φ₀ cosh(k t) with k² = m g d / I. A step of h is late by about k h of its angle.
    first = np.radians(degrees)
    k = np.sqrt(G * EDGE / np.sqrt(2) / (2 / 3 * EDGE**2))
    centre = EDGE / np.sqrt(2) * np.array([np.sin(first), 0.0, np.cos(first)])
    box = Body(Box((EDGE,) * 3), centre, about_y(np.pi / 4 + first))
    t = np.arccosh(0.03 / first) / k
    x, q = STEPPED.poses(make_scene(box), coefficients(2.0), [t, 8.0])
    # The edge below is on the side -x, -z of the cube or, with the turn about y, +x, -z.
    up = rotation_matrix(q[0, 0]) @ np.array([-1.0, 0.0, 1.0]) / np.sqrt(2)
    angle = np.arctan2(np.hypot(up[0], up[1]), up[2])
    assert angle == pytest.approx(0.03, rel=2 * k * STEPPED.step)
    assert x[0, 1, 2] == pytest.approx(EDGE / 2, abs=1e-4)


@pytest.mark.parametrize(("part", "stands"), [(0.95, True), (1.05, False)])
def test_rolling_resistance_holds_a_cube_on_its_edge(part, stands):
    # The torque of its weight about the edge, m g d sin φ with d = a / √2, against μ_r r N with
    # N = m g and r = a / 2, half the shortest edge.
    resistance = 0.03
    lean = np.arcsin(part * resistance * np.sqrt(0.5))
    centre = EDGE / np.sqrt(2) * np.array([np.sin(lean), 0.0, np.cos(lean)])
    box = Body(Box((EDGE,) * 3), centre, about_y(np.pi / 4 + lean))
    path = STEPPED.path(make_scene(box), coefficients(2.0, mu_r=resistance), [5.0])[0]
    assert path[0, 2] == pytest.approx(centre[2] if stands else EDGE / 2, abs=1e-4)


def stack(ratio: float, shape, planes) -> tuple[Scene, StaticParameters]:
    """A body on one of the same shape that is `ratio` times lighter, 0.2 m high each."""
    objects = (SceneObject("l", "light", shape), SceneObject("h", "heavy", shape))
    states = (ObjectState((0, 0, 0.1)), ObjectState((0, 0, 0.3)))
    environment = Environment([Plane(f"p{k}", "room", p[:3], p[3]) for k, p in enumerate(planes)])
    table = np.stack([np.full((3, 3), value) for value in (0.5, 0.4, 0.0, 0.0)])
    theta = StaticParameters(["light", "heavy", "room"], np.array([100.0, 100 * ratio, 1e3]), table)
    return Scene(environment, objects, states), theta


@pytest.mark.parametrize("ratio", [1, 10, 200, 1000])
def test_a_heavy_cube_stands_on_a_light_one(ratio):
    scene, theta = stack(ratio, Box((EDGE,) * 3), [(0, 0, 1, 0)])
    path = STEPPED.path(scene, theta, np.linspace(0.05, 5.0, 100))
    starts = np.array([state.position for state in scene.states])
    np.testing.assert_allclose(path, np.repeat(starts[:, None], 100, axis=1), atol=5e-5)


@pytest.mark.parametrize("ratio", [1, 10, 100, 500])
@engines(EVENT_DRIVEN, STEPPED)
def test_a_heavy_ball_stands_on_a_light_one_in_a_shaft(engine, ratio):
    walls = [(1, 0, 0, -0.1), (-1, 0, 0, -0.1), (0, 1, 0, -0.1), (0, -1, 0, -0.1)]
    scene, theta = stack(ratio, Sphere(0.1), [(0, 0, 1, 0), *walls])
    path = engine.path(scene, theta, np.linspace(0.05, 5.0, 100))
    starts = np.array([state.position for state in scene.states])
    np.testing.assert_allclose(path, np.repeat(starts[:, None], 100, axis=1), atol=5e-5)


@pytest.mark.parametrize("heavy_first", [False, True])
@pytest.mark.parametrize("count", [4, 8, 12])
@pytest.mark.parametrize("ratio", [1, 3, 10, 100])
def test_a_tower_of_light_and_heavy_cubes_stands(ratio, count, heavy_first):
    # It is in balance: each cube bears the weight of those above it, and all centres are in line.
    names = ["heavy", "light"] if heavy_first else ["light", "heavy"]
    objects = tuple(SceneObject(f"c{k}", names[k % 2], Box((EDGE,) * 3)) for k in range(count))
    states = tuple(ObjectState((0, 0, EDGE * (k + 0.5))) for k in range(count))
    scene = Scene(Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]), objects, states)
    table = np.stack([np.full((3, 3), value) for value in (0.5, 0.4, 0.0, 0.0)])
    theta = StaticParameters(["light", "heavy", "floor"], np.array([1.0, ratio, 1.0]), table)
    path = STEPPED.path(scene, theta, np.linspace(0.05, 5.0, 100))
    starts = np.array([state.position for state in states])
    np.testing.assert_allclose(path, np.repeat(starts[:, None], 100, axis=1), atol=5e-5)
