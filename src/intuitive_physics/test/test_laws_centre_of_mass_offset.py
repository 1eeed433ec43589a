"""What a centre of mass beside the shape's centre changes: flight, impacts, tipping, energy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule
from intuitive_physics.state import ObjectState

from .laws_scenes import (
    BULLET,
    STEPPED,
    G,
    about_y,
    coefficients,
    engines,
    motion_between,
    quaternion,
    quaternion_product,
)

EDGE = 0.2
FLOOR = Plane("floor", "ground", (0, 0, 1), 0.0)


def cube(mass_centre) -> SceneObject:
    return SceneObject("cube", "body", Box((EDGE, EDGE, EDGE)), mass_centre=tuple(mass_centre))


def scene_of(thing: SceneObject, state: ObjectState, planes=(FLOOR,), gravity=(0, 0, -G)) -> Scene:
    return Scene(Environment(planes, gravity=gravity), (thing,), (state,))


@engines(STEPPED, BULLET)
@settings(max_examples=25)
@given(st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3), st.integers(0, 2**31))
def test_the_centre_of_mass_flies_on_a_parabola(engine, relative, seed):
    # x_m(t) = x_m + v_m t + g t²/2 and R(t) = exp(ω t) R, for a cube has three equal moments;
    # the shape's centre is x_m(t) - R(t) c.
    rng = np.random.default_rng(seed)
    c = 0.5 * EDGE * np.array(relative)
    v, w = rng.uniform(-2, 2, 3), rng.uniform(-5, 5, 3)
    q = rng.normal(size=4)
    start = ObjectState((0, 0, 9), q / np.linalg.norm(q), v, w)
    times = np.array([0.05, 0.13, 0.4])
    x, turned = engine.poses(scene_of(cube(c), start), coefficients(), times)
    arm = rotation_matrix(start.orientation) @ c
    for k, t in enumerate(times):
        expected = quaternion_product(quaternion(w * t), start.orientation)
        rotation = rotation_matrix(expected)
        centre = start.position + arm + (v + np.cross(w, arm)) * t - rotation @ c
        centre[2] -= 0.5 * G * t**2
        # Bullet's flight is of first order: g step t / 2 low, and its turning.
        allowed = 1e-9 if engine is STEPPED else 2.0 * G * engine.flight_step * t + 1e-4
        np.testing.assert_allclose(x[0, k], centre, atol=allowed)
        assert abs(expected @ turned[0, k]) == pytest.approx(1.0, abs=1e-9 + engine.flight_step)


@engines(STEPPED, BULLET)
def test_an_impact_turns_a_body_about_its_centre_of_mass(engine):
    # An edge hits a smooth floor without gravity: ω = m (1 + e) v d / (I + m d²), the edge d beside
    # the centre of mass, I = m a² / 6 about it.
    speed, tilted, e = 1.0, np.radians(20.0), 0.5
    for x, z in ((0.0, 0.0), (0.02, 0.0), (-0.03, 0.04)):
        arm = rotation_matrix(about_y(tilted)) @ (x, 0.0, z)
        beside = EDGE / np.sqrt(2) * np.cos(np.pi / 4 + tilted)
        height = EDGE / np.sqrt(2) * np.sin(np.pi / 4 + tilted)
        start = ObjectState((0, 0, height + 1e-3), about_y(tilted), (0.0, 0.0, -speed))
        theta = coefficients(0.0, e=e)
        scene = scene_of(cube((x, 0, z)), start, gravity=(0, 0, 0))
        (_,), (turns,) = engine.poses(scene, theta, [0.021, 0.031])
        turned = quaternion_product(turns[1], turns[0] * np.array([-1, -1, -1, 1]))
        # The lowest edge is on the side of +x or -x that tilting brings down.
        down = rotation_matrix(about_y(tilted)) @ (0.5 * EDGE, 0, -0.5 * EDGE)
        assert abs(down[0]) == pytest.approx(beside)
        lever = abs(down[0] - arm[0])
        expected = (1 + e) * speed * lever / (EDGE**2 / 6 + lever**2) * 0.01
        rel = 5e-2 if engine is BULLET else 1e-3
        assert 2.0 * np.linalg.norm(turned[:3]) == pytest.approx(expected, rel=rel)


@engines(STEPPED, BULLET)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_cube_on_its_edge_falls_to_its_heavy_side(engine, side):
    # A cube stands on an edge, its diagonal upright: a centre of mass to one side of the edge tips
    # it there; it comes to rest on the face that is then below.
    c = 0.02
    q = about_y(np.pi / 4)
    to_side = rotation_matrix(q).T @ (side * c, 0.0, 0.0)
    start = ObjectState((0, 0, EDGE / np.sqrt(2)), q)
    x, turned = engine.poses(scene_of(cube(to_side), start), coefficients(0.8), [3.0])
    assert x[0, 0, 2] == pytest.approx(0.5 * EDGE, abs=1e-3)
    assert (rotation_matrix(turned[0, 0]) @ to_side)[2] < 0.0
    assert side * x[0, 0, 0] > 0.3 * EDGE


def test_a_capsule_rights_itself_as_a_tumbler_does():
    # Its heavy end low, a capsule that stands on it is stable: the restoring moment is m g h sin α
    # with the centre of mass h below the centre of the cap. Rolling friction stops the rocking.
    weighted = SceneObject("tumbler", "body", Capsule(0.1, 0.05), mass_centre=(0.0, 0.0, -0.08))
    start = ObjectState((0, 0, 0.13), about_y(0.3))
    scene = scene_of(weighted, start)
    (x,), (turned,) = STEPPED.poses(scene, coefficients(0.6, mu_r=0.02), np.linspace(0.2, 20, 50))
    assert rotation_matrix(turned[-1])[2, 2] > np.cos(0.1)
    assert x[-1, 2] == pytest.approx(0.125, abs=2e-3)
    balanced = SceneObject("pin", "body", Capsule(0.1, 0.05))
    (_,), (fallen,) = STEPPED.poses(scene_of(balanced, start), coefficients(0.6, mu_r=0.02), [20.0])
    assert abs(rotation_matrix(fallen[0])[2, 2]) < 0.1


@settings(max_examples=50)
@given(st.lists(st.floats(-0.6, 0.6), min_size=3, max_size=3), st.integers(0, 2**31))
def test_elastic_bounces_of_a_off_centre_cube_keep_the_energy(relative, seed):
    # ½ m v_m² + ½ ω·Iω + m g z_m is kept where e = 1 and nothing rubs.
    rng = np.random.default_rng(seed)
    c = 0.5 * EDGE * np.array(relative)
    q = rng.normal(size=4)
    state = ObjectState((0, 0, 0.6), q / np.linalg.norm(q), rng.normal(size=3), rng.normal(size=3))
    scene = scene_of(cube(c), state)
    theta = coefficients(0.0, e=1.0)
    gap = 1e-4
    times = np.arange(0.0, 1.0, 0.05)
    x, turned = STEPPED.poses(scene, theta, np.sort(np.concatenate([times, times + gap])))
    energies = []
    for k in range(0, x.shape[1], 2):
        motion = motion_between(x[:, k : k + 2], turned[:, k : k + 2], gap)
        arm = rotation_matrix(motion.orientation[0]) @ c
        v = motion.velocity[0] + np.cross(motion.spin[0], arm)
        height = motion.position[0, 2] + arm[2]
        turning = EDGE**2 / 6 * motion.spin[0] @ motion.spin[0]
        energies.append(0.5 * v @ v + 0.5 * turning + G * height)
    # A gap that holds an impact tells no speed; all others tell the same energy. Two corners that
    # hit within IMPACT_GAP of each other rebound as one, which moves them by as much.
    assert np.mean(np.abs(np.array(energies) / energies[0] - 1.0) < 2e-3) > 0.85
