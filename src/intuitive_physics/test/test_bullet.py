"""PyBullet as the independent witness, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation.bullet import BulletSimulator

from .laws_scenes import (
    EVENT_DRIVEN,
    LYING_ALONG_X,
    LYING_ALONG_Y,
    UPRIGHT,
    Body,
    G,
    about_y,
    coefficients,
    make_scene,
)

R = 0.05
STEP = 2.5e-4


@pytest.fixture(scope="module")
def bullet():
    return BulletSimulator(time_step=STEP)


def test_two_balls_collide_as_in_event_driven(bullet):
    # Level floor, pairs that are products: floor-ball 0.3 = 0.5 · 0.6 would do, here all equal e.
    flying = Body(Sphere(R), (-0.3, 0.02, R), UPRIGHT, (1.5, 0, 0), (0, 30, 0))
    scene = make_scene(Body(Sphere(R), (0, 0, R)), flying)
    theta = coefficients(0.0, e=0.5)
    times = np.linspace(0.05, 0.6, 12)
    ours = EVENT_DRIVEN.path(scene, theta, times)
    theirs = bullet.rollout([scene], theta, times).positions[0]
    np.testing.assert_allclose(theirs, ours, atol=20 * STEP)


def test_boxes_and_capsules_come_to_rest_on_a_static_box(bullet):
    # Centres at half the height above the top of the static box; Bullet's margins are below 1 mm.
    scene = make_scene(
        Body(Box((0.2, 0.3, 0.1)), (0, 0, 0.9)),
        Body(Capsule(0.06, 0.2), (0.6, 0, 0.9), LYING_ALONG_X),
        planes=(),
        boxes=[((0, 0, 0.4), (2, 2, 0.8))],
    )
    rollout = bullet.rollout([scene], coefficients(0.5, mu_r=0.01), [0.0, 3.0])
    heights = rollout.positions[0, :, 1, 2] - 0.8
    np.testing.assert_allclose(heights, [0.05, 0.06], atol=2e-3)


@pytest.mark.parametrize("shape", [Box((0.1, 0.12, 0.1)), Capsule(0.05, 0.2), Sphere(0.05)])
def test_nothing_sinks_into_the_ground(bullet, shape):
    # Half a height above the ground while it slides and rolls and when it lies, for 3 s.
    lying = LYING_ALONG_Y if isinstance(shape, Capsule) else UPRIGHT
    scene = make_scene(Body(shape, (0, 0, 0.05), lying, (1.5, 0, 0)))
    rollout = bullet.rollout([scene], coefficients(0.4, e=0.5), np.arange(1, 11) * 0.3)
    np.testing.assert_allclose(rollout.positions[0, 0, :, 2], 0.05, atol=1e-3)


def test_rolling_friction_does_not_hold_a_box(bullet):
    # Its edges do: a tall box on an edge falls as fast with μ_r as without.
    height = 0.1 * np.cos(0.4) + 0.025 * np.sin(0.4)
    scene = make_scene(Body(Box((0.05, 0.1, 0.2)), (0, 0, height), about_y(0.4)))
    paths = [
        bullet.rollout([scene], coefficients(1.0, mu_r=mu_r, e=0.5), [0.05, 0.1, 0.2]).positions
        for mu_r in (0.0, 0.5)
    ]
    np.testing.assert_array_equal(paths[0], paths[1])


def test_pairs_of_which_one_does_not_roll(bullet):
    # Ball and box on a floor, μ_r = 0.05 everywhere: the ball brakes at 5/7 μ_r g, the box slides.
    mu, mu_r, v0 = 0.4, 0.05, 0.5
    scene = make_scene(
        Body(Sphere(R), (0, 0, R), UPRIGHT, (v0, 0, 0), (0, v0 / R, 0)),
        Body(Box((0.1, 0.1, 0.1)), (0, 1, 0.05), UPRIGHT, (v0, 0, 0)),
    )
    theta = coefficients(mu, mu_r=mu_r, e=0.5)
    x = bullet.rollout([scene], theta, [1.0]).positions[0, :, 0, 0]
    ball = v0 - 0.5 * 5 / 7 * mu_r * G
    np.testing.assert_allclose(x, (ball, v0**2 / (2 * mu * G)), atol=10 * STEP)


def test_rolling_friction_that_is_no_sum_is_refused(bullet):
    # Two balls and a floor are three pairs for three numbers; of three balls of different sizes
    # there are six pairs.
    scene = make_scene(*[Body(Sphere(r), (k, 0, 1)) for k, r in enumerate((0.03, 0.05, 0.09))])
    with pytest.raises(UnsupportedSceneError, match=r"rolling friction .* use stepped"):
        bullet.rollout([scene], coefficients(0.5, mu_r=0.1, e=0.5), [0.1])


def test_what_bullet_cannot_express_is_refused(bullet):
    balls = make_scene(Body(Sphere(R), (0, 0, 1)), Body(Sphere(R), (1, 0, 1)))
    with pytest.raises(UnsupportedSceneError, match="one friction coefficient"):
        bullet.rollout([balls], coefficients(0.4, mu_s=0.5), [1.0])
    mixed = Environment([Plane("a", "floor", (0, 0, 1), 0), Plane("b", "glass", (1, 0, 0), -3)])
    theta = StaticParameters.uniform(
        ["body", "glass", "floor", "cork"], static_friction=0.4, restitution=0.5
    )
    theta = theta.with_pair("body", "glass", restitution=0.9).with_pair(
        "body", "cork", restitution=0.1
    )
    objects = (balls.objects[0], SceneObject("other", "cork", Sphere(R)))
    with pytest.raises(UnsupportedSceneError, match="restitution of the pairs is no product"):
        bullet.rollout([Scene(mixed, objects, balls.states)], theta, [1.0])
