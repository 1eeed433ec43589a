"""Energy never grows, nothing sinks, over thousands of random scenes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.materials import StaticParameters
from intuitive_physics.rotation import rotation_matrix
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.state import ObjectState

from .laws_scenes import (
    BULLET,
    EVENT_DRIVEN,
    STEPPED,
    Engine,
    G,
    engines,
    first_motion,
    motion_between,
    random_quaternion,
)

WALLS = [(1, 0, 0, -1), (-1, 0, 0, -1), (0, 1, 0, -1), (0, -1, 0, -1)]
SPHERES, ALL_SHAPES = ("sphere",), ("sphere", "box", "capsule")


def random_shape(rng, kinds) -> Shape:
    kind = kinds[rng.integers(len(kinds))]
    if kind == "sphere":
        return Sphere(rng.uniform(0.03, 0.1))
    if kind == "box":
        return Box(tuple(rng.uniform(0.05, 0.2, 3)))
    return Capsule(rng.uniform(0.03, 0.07), rng.uniform(0.05, 0.2))


def random_environment(rng, with_boxes) -> Environment:
    """A room of 2 m with a floor that may tilt, and perhaps a static box in the middle of it."""
    tilt = rng.choice([0.0, 0.0, 0.1, 0.3])
    planes = [(np.sin(tilt), 0, np.cos(tilt), 0), *WALLS]
    boxes = []
    if with_boxes and rng.random() < 0.5:
        at = (0, 0, rng.uniform(-0.1, 0.1))
        edges = rng.uniform(0.2, 0.6, 3)
        boxes.append(StaticBox("step", "ground", at, random_quaternion(rng), edges))
    return Environment([Plane(f"p{k}", "ground", p[:3], p[3]) for k, p in enumerate(planes)], boxes)


def random_scene(rng, kinds, most=4) -> Scene:
    """Spinning objects one above the other, clear of the floor, the walls and the static box."""
    environment = random_environment(rng, kinds is not SPHERES)
    objects, states = [], []
    z = 0.75
    for k in range(rng.integers(1, most + 1)):
        shape = random_shape(rng, kinds)
        z += shape.bounding_radius + 0.01
        at = (*rng.uniform(-0.3, 0.3, 2), z)
        z += shape.bounding_radius
        objects.append(SceneObject(f"o{k}", f"m{k % 2}", shape))
        states.append(
            ObjectState(at, random_quaternion(rng), rng.normal(size=3), rng.normal(size=3) * 5)
        )
    return Scene(environment, tuple(objects), tuple(states))


def random_parameters(rng, uniform=False) -> StaticParameters:
    """θ_s of two kinds of objects and the ground, all pairs different, or all the same."""
    m = 3
    mu_s, part, mu_r, e = (
        rng.uniform(size=(4, m, m)) if not uniform else rng.uniform(size=(4, 1, 1))
    )
    values = np.stack(
        [np.broadcast_to(v, (m, m)) for v in (1.2 * mu_s, 1.2 * mu_s * part, 0.1 * mu_r, e)]
    )
    if uniform:
        values = values[[0, 0, 2, 3]]
    symmetric = np.triu(values) + np.triu(values, 1).transpose(0, 2, 1)
    return StaticParameters(["m0", "m1", "ground"], rng.uniform(50, 3000, m), symmetric)


def energy_with(theta: StaticParameters, scene: Scene, motion) -> float:
    """Kinetic and potential energy, objects of different densities."""
    total = 0.0
    for k, thing in enumerate(scene.objects):
        density = theta.density[theta.index(thing.material)]
        mass = thing.shape.mass(density)
        turn = rotation_matrix(motion.orientation[k])
        own = turn.T @ motion.spin[k]
        total += 0.5 * mass * motion.velocity[k] @ motion.velocity[k]
        total += 0.5 * own @ (thing.shape.inertia(density) * own)
        total += mass * G * motion.position[k, 2]
    return total


def lowest_gap(scene: Scene, k: int, position, orientation) -> float:
    """Distance between object k and the nearest plane; below zero where it has sunk in."""
    shape = scene.objects[k].shape
    turn = rotation_matrix(orientation)
    gap = np.inf
    for plane in scene.environment.planes:
        n = turn.T @ plane.normal
        if isinstance(shape, Sphere):
            reach = shape.radius
        elif isinstance(shape, Box):
            reach = 0.5 * np.abs(n) @ shape.edge_lengths
        else:
            reach = shape.radius + 0.5 * shape.length * abs(n[2])
        gap = min(gap, float(plane.signed_distances(position)) - reach)
    return gap


GAP = 0.01
SAMPLES = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0])
TIMES = np.sort(np.concatenate([SAMPLES, SAMPLES + GAP]))


def check_energy(engine: Engine, scenes, thetas):
    """Energy at each sample is at most that of any before, and nothing is inside a plane."""
    rollout = engine.simulator.rollout(scenes, thetas, TIMES)
    assert (rollout.status == 0).all()
    worst_growth, worst_gap = 0.0, 0.0
    for w, (scene, theta) in enumerate(zip(scenes, thetas, strict=True)):
        n = len(scene.objects)
        x, q = rollout.positions[w, :n], rollout.orientations[w, :n]
        least = energy_with(theta, scene, first_motion(scene))
        # Two orientations tell the spin up to (|ω| gap)² / 12 where the axis turns meanwhile.
        reading = 0.0
        scale = sum(
            thing.shape.mass(theta.density[theta.index(thing.material)]) for thing in scene.objects
        )
        for i in range(len(SAMPLES)):
            motion = motion_between(x[:, 2 * i : 2 * i + 2], q[:, 2 * i : 2 * i + 2], GAP)
            energy = energy_with(theta, scene, motion)
            fastest = np.linalg.norm(motion.spin, axis=1).max()
            reading = (fastest * GAP) ** 2 / 6
            # And the engine may lift what has sunk by 2 mm.
            allowed = least + reading * abs(energy) + scale * G * 2e-3
            worst_growth = max(worst_growth, (energy - allowed) / (scale * G))
            least = min(least, energy)
        for k in range(n):
            worst_gap = min(
                worst_gap,
                *(lowest_gap(scene, k, x[k, i], q[k, i]) for i in range(0, len(TIMES), 2)),
            )
    assert worst_growth <= 0.0, f"grows by a lift of {worst_growth:.2g} m"
    # Nothing sinks by more than what closing at up to 6 m/s leaves of a second contact in a step.
    assert worst_gap > -5e-3


@pytest.mark.parametrize("kinds", [SPHERES, ALL_SHAPES], ids=["spheres", "mixed"])
@pytest.mark.parametrize("seed", range(4))
@engines(STEPPED)
def test_energy_never_grows_in_many_scenes(engine, kinds, seed):
    # E = Σ m v² / 2 + ω·I ω / 2 + m g z never grows, here in 4 × 250 scenes of each kind.
    rng = np.random.default_rng([seed, 1])
    scenes = [random_scene(rng, kinds) for _ in range(250)]
    check_energy(engine, scenes, [random_parameters(rng) for _ in scenes])


@engines(EVENT_DRIVEN)
def test_energy_never_grows_in_many_scenes_of_balls(engine):
    rng = np.random.default_rng(2)
    scenes = [random_scene(rng, SPHERES) for _ in range(200)]
    check_energy(engine, scenes, [random_parameters(rng) for _ in scenes])


@engines(STEPPED)
@given(
    seed=st.integers(0, 2**32 - 1),
    most=st.integers(1, 6),
    kinds=st.sampled_from([SPHERES, ("box",), ("capsule",), ALL_SHAPES]),
)
@settings(max_examples=60)
def test_energy_never_grows_in_any_scene(engine, seed, most, kinds):
    rng = np.random.default_rng(seed)
    check_energy(engine, [random_scene(rng, kinds, most)], [random_parameters(rng)])


@engines(BULLET)
def test_energy_never_grows_in_the_witness(engine):
    # Balls only: Bullet's tumbling boxes gain energy by its method of first order.
    rng = np.random.default_rng(3)
    scenes = [random_scene(rng, SPHERES, 2) for _ in range(6)]
    thetas = [random_parameters(rng, uniform=True) for _ in scenes]
    for scene, theta in zip(scenes, thetas, strict=True):
        rollout = engine.simulator.rollout([scene], theta, TIMES)
        n = len(scene.objects)
        start = energy_with(theta, scene, first_motion(scene))
        mass = sum(t.shape.mass(theta.density[theta.index(t.material)]) for t in scene.objects)
        x, q = rollout.positions[0, :n], rollout.orientations[0, :n]
        for i in range(len(SAMPLES)):
            motion = motion_between(x[:, 2 * i : 2 * i + 2], q[:, 2 * i : 2 * i + 2], GAP)
            # Each impact that comes late by a step h lets gravity do m g v h more.
            late = mass * G * 6.0 * engine.step * 10
            assert energy_with(theta, scene, motion) <= start + late


@engines(STEPPED)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_what_lies_still_has_lost_its_energy(engine, seed):
    # Level floor, friction of all kinds, e < 0.6: after 20 s everything lies and does not move.
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, ALL_SHAPES, 3)
    level = Environment(
        [Plane("floor", "ground", (0, 0, 1), 0.0), *scene.environment.planes[1:]], ()
    )
    scene = Scene(level, scene.objects, scene.states)
    theta = StaticParameters.uniform(
        ["m0", "m1", "ground"],
        static_friction=0.6,
        dynamic_friction=0.5,
        rolling_friction=0.1,
        restitution=0.5,
    )
    x, q = engine.poses(scene, theta, [20.0, 25.0])
    np.testing.assert_allclose(x[:, 1], x[:, 0], atol=1e-3)
    assert np.abs((q[:, 0] * q[:, 1]).sum(axis=1)).min() > np.cos(0.01)
