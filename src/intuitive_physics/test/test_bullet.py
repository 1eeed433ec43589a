"""PyBullet as the independent witness, and what it refuses."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError, UnsupportedSceneError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.simulation.bullet import BulletSimulator
from intuitive_physics.state import ObjectState

G = 9.81
R = 0.05
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
STEP = 2.5e-4


@pytest.fixture(scope="module")
def bullet():
    return BulletSimulator(time_step=STEP)


def test_free_fall(bullet, world):
    # Semi-implicit Euler lags by g h t / 2.
    times = np.array([0.1, 0.3])
    path = bullet.rollout([world.scene((R, (0, 0, 1)))], world.parameters(0.4, 0.4), times)
    truth = 1 - 0.5 * G * times**2
    np.testing.assert_allclose(path.positions[0, 0, :, 2], truth, atol=G * STEP * 0.3)


@pytest.mark.parametrize("e", [0.3, 0.7, 0.9])
def test_first_bounce_height(bullet, world, e):
    # e² h; Bullet's impact is late by up to one step: δz ≈ v h.
    times = np.sqrt(2 / G) * (1 + np.linspace(0.9, 1.1, 41) * e)
    path = bullet.rollout([world.scene((R, (0, 0, 1 + R)))], world.parameters(0.4, 0.4, e=e), times)
    peak = path.positions[0, 0, :, 2].max() - R
    assert peak == pytest.approx(e**2, abs=3 * np.sqrt(2 * G) * STEP)


@pytest.mark.parametrize(
    ("velocity", "spin", "mu", "mu_r"),
    [
        ((2, 0, 0), (0, 0, 0), 0.3, 0.0),
        ((1, 0.5, 0), (0, -30.0, 0), 0.4, 0.0),
        ((1, 0, 0), (0, 20.0, 0), 0.4, 0.1),
    ],
)
def test_sliding_and_rolling_agree_with_event_driven(bullet, world, velocity, spin, mu, mu_r):
    # Both obey Coulomb's law and a rolling torque μ_r r N; Bullet's Euler steps leave O(h) v.
    scene = world.scene((R, (0, 0, R), UPRIGHT, velocity, spin))
    theta = world.parameters(mu, mu, mu_r=mu_r)
    times = np.linspace(0.1, 1.5, 8)
    ours = world.path(scene, theta, times)
    theirs = bullet.rollout([scene], theta, times).positions[0]
    np.testing.assert_allclose(theirs, ours, atol=10 * STEP)


def test_oblique_bounce_agrees_with_event_driven(bullet, world):
    # Up to the first bounce's next landing; a step's delay of the impact costs |v| h.
    scene = world.scene((R, (0, 0, R + 0.3), UPRIGHT, (2, 1, 0), (5, -20, 9)))
    theta = world.parameters(0.3, 0.3, e=0.6)
    times = np.linspace(0.02, 0.5, 10)
    ours = world.path(scene, theta, times)
    theirs = bullet.rollout([scene], theta, times).positions[0]
    np.testing.assert_allclose(theirs, ours, atol=20 * STEP)


def test_two_balls_collide_as_in_event_driven(bullet, world):
    # Level floor, pairs that are products: floor-ball 0.3 = 0.5 · 0.6 would do, here all equal e.
    scene = world.scene((R, (0, 0, R)), (R, (-0.3, 0.02, R), UPRIGHT, (1.5, 0, 0), (0, 30, 0)))
    theta = world.parameters(0.0, 0.0, e=0.5, between={"restitution": 0.5})
    times = np.linspace(0.05, 0.6, 12)
    ours = world.path(scene, theta, times)
    theirs = bullet.rollout([scene], theta, times).positions[0]
    np.testing.assert_allclose(theirs, ours, atol=20 * STEP)


def test_boxes_and_capsules_come_to_rest_on_a_static_box(bullet):
    # Centres at half the height above the top of the static box; Bullet's margins are below 1 mm.
    environment = Environment([], [StaticBox("table", "floor", (0, 0, 0.4), UPRIGHT, (2, 2, 0.8))])
    objects = (
        SceneObject("box", "wood", Box((0.2, 0.3, 0.1))),
        SceneObject("capsule", "wood", Capsule(0.06, 0.2)),
    )
    lying = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
    states = (ObjectState((0, 0, 0.9)), ObjectState((0.6, 0, 0.9), lying))
    theta = StaticParameters.uniform(
        ["wood", "floor"], static_friction=0.5, dynamic_friction=0.5, restitution=0.0
    )
    rollout = bullet.rollout([Scene(environment, objects, states)], theta, [0.0, 3.0])
    heights = rollout.positions[0, :, 1, 2] - 0.8
    np.testing.assert_allclose(heights, [0.05, 0.06], atol=2e-3)


def test_threads_take_turns(bullet, world):
    scenes = [world.scene((R, (0, 0, 0.2 + 0.1 * k))) for k in range(6)]
    theta = world.parameters(0.4, 0.4)

    def roll(scene):
        return bullet.rollout([scene], theta, [0.5]).positions

    alone = [roll(scene) for scene in scenes]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(roll, scenes))
    np.testing.assert_array_equal(alone, together)
    batch = bullet.rollout(scenes, theta, [0.5]).positions
    np.testing.assert_array_equal(batch, np.concatenate(alone))


def test_a_batch_from_two_threads_at_once(bullet, world):
    # PyBullet itself crashes there; the two calls take turns and answer what each does alone.
    scenes = [world.scene((R, (0, 0, 0.2 + 0.1 * k)), (R, (1, 0, 0.3))) for k in range(3)]
    theta = world.parameters(0.4, 0.4)
    alone = bullet.rollout(scenes, theta, [0.2, 0.4])
    with ThreadPoolExecutor(2) as pool:
        calls = [pool.submit(bullet.rollout, scenes, theta, [0.2, 0.4]) for _ in range(6)]
    for call in calls:
        np.testing.assert_array_equal(call.result().positions, alone.positions)
        np.testing.assert_array_equal(call.result().orientations, alone.orientations)


@pytest.mark.parametrize("shape", [Box((0.1, 0.12, 0.1)), Capsule(0.05, 0.2), Sphere(0.05)])
def test_nothing_sinks_into_the_ground(bullet, shape):
    # Half a height above the ground while it slides and rolls and when it lies, for 3 s.
    lying = (np.sqrt(0.5), 0, 0, np.sqrt(0.5)) if isinstance(shape, Capsule) else UPRIGHT
    scene = Scene(
        Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]),
        (SceneObject("body", "wood", shape),),
        (ObjectState((0, 0, 0.05), lying, (1.5, 0, 0)),),
    )
    theta = StaticParameters.uniform(
        ["wood", "floor"], static_friction=0.4, dynamic_friction=0.4, rolling_friction=0.0
    )
    rollout = bullet.rollout([scene], theta, np.arange(1, 11) * 0.3)
    np.testing.assert_allclose(rollout.positions[0, 0, :, 2], 0.05, atol=1e-3)


def test_rolling_friction_does_not_hold_a_box(bullet):
    # Its edges do: a tall box on an edge falls as fast with μ_r as without.
    lean = (0.0, np.sin(0.2), 0.0, np.cos(0.2))
    height = 0.1 * np.cos(0.4) + 0.025 * np.sin(0.4)
    scene = Scene(
        Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]),
        (SceneObject("box", "wood", Box((0.05, 0.1, 0.2))),),
        (ObjectState((0, 0, height), lean),),
    )
    paths = [
        bullet.rollout(
            [scene],
            StaticParameters.uniform(
                ["wood", "floor"], static_friction=1.0, dynamic_friction=1.0, rolling_friction=mu_r
            ),
            [0.05, 0.1, 0.2],
        ).positions
        for mu_r in (0.0, 0.5)
    ]
    np.testing.assert_array_equal(paths[0], paths[1])


def test_pairs_of_which_one_does_not_roll(bullet):
    # Ball and box on a floor, μ_r = 0.05 everywhere: the ball brakes at 5/7 μ_r g, the box slides.
    mu, mu_r, v0 = 0.4, 0.05, 0.5
    scene = Scene(
        Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]),
        (
            SceneObject("ball", "wood", Sphere(R)),
            SceneObject("box", "wood", Box((0.1, 0.1, 0.1))),
        ),
        (
            ObjectState((0, 0, R), UPRIGHT, (v0, 0, 0), (0, v0 / R, 0)),
            ObjectState((0, 1, 0.05), UPRIGHT, (v0, 0, 0)),
        ),
    )
    theta = StaticParameters.uniform(
        ["wood", "floor"], static_friction=mu, dynamic_friction=mu, rolling_friction=mu_r
    )
    x = bullet.rollout([scene], theta, [1.0]).positions[0, :, 0, 0]
    ball = v0 - 0.5 * 5 / 7 * mu_r * G
    np.testing.assert_allclose(x, (ball, v0**2 / (2 * mu * G)), atol=10 * STEP)


def test_rolling_friction_that_is_no_sum_is_refused(bullet, world):
    # Two balls and a floor are three pairs for three numbers; of three balls of different sizes
    # there are six pairs.
    scene = world.scene((0.03, (0, 0, 1)), (0.05, (1, 0, 1)), (0.09, (2, 0, 1)))
    with pytest.raises(UnsupportedSceneError, match=r"rolling friction .* use stepped"):
        bullet.rollout([scene], world.parameters(0.5, 0.5, mu_r=0.1), [0.1])


def test_the_air_is_refused(bullet, world):
    scene = world.scene((R, (0, 0, 1)))
    for air in ({"drag_coefficient": 0.5}, {"magnus_coefficient": 1.0}):
        light = SceneObject("light", "ball", Sphere(R), **air)
        flying = Scene(scene.environment, (light,), scene.states)
        with pytest.raises(UnsupportedSceneError, match=r"drag or Magnus force.*stepped"):
            bullet.rollout([flying], world.parameters(0.4, 0.4), [0.1])


def test_what_bullet_cannot_express_is_refused(bullet, world):
    scene = world.scene((R, (0, 0, 1)))
    with pytest.raises(UnsupportedSceneError, match="one friction coefficient"):
        bullet.rollout([scene], world.parameters(0.5, 0.4), [1.0])
    two = world.scene((R, (0, 0, 1)), (R, (1, 0, 1)))
    mixed = Environment([Plane("a", "floor", (0, 0, 1), 0), Plane("b", "glass", (1, 0, 0), -3)])
    theta = StaticParameters.uniform(
        ["ball", "glass", "floor", "cork"], static_friction=0.4, restitution=0.5
    )
    theta = theta.with_pair("ball", "glass", restitution=0.9).with_pair(
        "ball", "cork", restitution=0.1
    )
    objects = (two.objects[0], SceneObject("other", "cork", Sphere(R)))
    with pytest.raises(UnsupportedSceneError, match="restitution of the pairs is no product"):
        bullet.rollout([Scene(mixed, objects, two.states)], theta, [1.0])
    edged = Environment([Plane("t", "floor", (0, 0, 1), 0, [(0, 0, 0), (1, 0, 0), (0, 1, 0)])])
    with pytest.raises(UnsupportedSceneError, match="boundary"):
        bullet.rollout([Scene(edged, scene.objects, scene.states)], world.parameters(), [1.0])
    with pytest.raises(InvalidInputError, match="time step"):
        BulletSimulator(time_step=1.0)


def test_it_is_known_by_name():
    assert make_simulator("bullet").name == "bullet"
