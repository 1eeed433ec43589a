"""MuJoCo behind the interface obeys the laws as far as its springs let it."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.engines.mujoco_simulator import MujocoSimulator, damping_ratio

G = 9.81
FLOOR = Environment([Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0)])


def theta(*materials: str, mu: float = 0.4, rolling: float = 0.0, e: float = 0.0):
    return StaticParameters.uniform(
        [*materials, "floor"],
        static_friction=mu,
        dynamic_friction=mu,
        rolling_friction=rolling,
        restitution=e,
    )


@pytest.mark.parametrize("e", [0.2, 0.5, 0.8])
def test_a_spring_that_only_pushes_rebounds_as_asked(e):
    # m ẍ = -k x - c ẋ until the force is zero, by small steps.
    ratio, x, v, step = damping_ratio(e), 0.0, -1.0, 1e-5
    while True:
        a = -x - 2.0 * ratio * v
        if a <= 0.0:
            break
        v += step * a
        x += step * v
    assert v == pytest.approx(e, abs=1e-3)


@pytest.mark.parametrize("e", [0.3, 0.6, 0.9])
def test_a_ball_bounces_nearly_to_its_restitution(e):
    # Contacts of eight steps miss e by up to 0.06: they begin within a step.
    ball = SceneObject("ball", "ball", Sphere(0.1))
    scene = Scene(FLOOR, (ball,), (ObjectState((0.0, 0.0, 1.1)),))
    times = np.arange(0.5, 1.4, 0.002)
    path = MujocoSimulator().rollout([scene], theta("ball", e=e), times).positions[0, 0]
    peak = path[:, 2].max() - 0.1
    assert np.sqrt(peak) == pytest.approx(e, abs=0.06)


def test_a_box_slides_as_far_as_friction_lets_it():
    # s = v² / (2 μ g)
    box = SceneObject("box", "box", Box((0.2, 0.2, 0.1)))
    start = ObjectState((0.0, 0.0, 0.05), linear_velocity=(2.0, 0.0, 0.0))
    times = [1.0]
    path = MujocoSimulator().rollout([Scene(FLOOR, (box,), (start,))], theta("box"), times)
    assert path.positions[0, 0, 0, 0] == pytest.approx(4.0 / (2.0 * 0.4 * G), rel=0.03)


def test_pairs_have_coefficients_of_their_own():
    ice = SceneObject("ice", "ice", Box((0.2, 0.2, 0.1)))
    felt = SceneObject("felt", "felt", Box((0.2, 0.2, 0.1)))
    starts = [ObjectState((0.0, y, 0.05), linear_velocity=(2.0, 0.0, 0.0)) for y in (0.0, 1.0)]
    slippery = theta("ice", "felt").with_pair(
        "ice", "floor", static_friction=0.05, dynamic_friction=0.05
    )
    scene = Scene(FLOOR, (ice, felt), tuple(starts))
    (ice_way, felt_way) = MujocoSimulator().rollout([scene], slippery, [0.5]).positions[0, :, 0, 0]
    assert ice_way == pytest.approx(2.0 * 0.5 - 0.5 * 0.05 * G * 0.25, rel=0.02)
    assert felt_way == pytest.approx(4.0 / (2.0 * 0.4 * G), rel=0.03)


def test_a_batch_equals_its_members():
    rng = np.random.default_rng(0)
    things = (
        SceneObject("ball", "a", Sphere(0.1)),
        SceneObject("rod", "b", Capsule(0.05, 0.2)),
    )
    scenes = [
        Scene(
            FLOOR,
            things,
            (
                ObjectState((0.0, 0.0, 0.5), linear_velocity=rng.normal(size=3)),
                ObjectState((1.0, 0.0, 0.5), angular_velocity=rng.normal(size=3)),
            ),
        )
        for _ in range(3)
    ]
    sets = [theta("a", "b", mu=0.2, e=0.3), theta("a", "b", rolling=0.02), theta("a", "b")]
    times = np.linspace(0.0, 1.0, 11)
    simulator = MujocoSimulator()
    together = simulator.rollout(scenes, sets, times)
    for k, (scene, parameters) in enumerate(zip(scenes, sets, strict=True)):
        alone = simulator.rollout([scene], parameters, times)
        assert np.array_equal(together.positions[k], alone.positions[0])
        assert np.array_equal(together.orientations[k], alone.orientations[0])


def test_what_it_cannot_express_it_refuses():
    ball = SceneObject("ball", "ball", Sphere(0.1))
    scene = Scene(FLOOR, (ball,), (ObjectState((0.0, 0.0, 0.5)),))
    two = StaticParameters.uniform(["ball", "floor"], static_friction=0.5, dynamic_friction=0.4)
    with pytest.raises(UnsupportedSceneError, match="one friction coefficient"):
        MujocoSimulator().rollout([scene], two, [1.0])
    dragged = Scene(
        FLOOR, (SceneObject("ball", "ball", Sphere(0.1), drag_coefficient=0.4),), scene.states
    )
    with pytest.raises(UnsupportedSceneError, match="air drag"):
        MujocoSimulator().rollout([dragged], theta("ball"), [1.0])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    edged = Environment([Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0, corners)])
    with pytest.raises(UnsupportedSceneError, match="boundary"):
        MujocoSimulator().rollout([Scene(edged, (ball,), scene.states)], theta("ball"), [1.0])
