"""Energy never grows, nothing sinks, over thousands of random scenes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.simulation import WorldStatus
from intuitive_physics.state import ObjectState

from .laws_scenes import (
    BULLET,
    EVENT_DRIVEN,
    STEPPED,
    Engine,
    G,
    engines,
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


def random_parameters(rng) -> StaticParameters:
    """θ_s of two kinds of objects and the ground, all pairs different."""
    mu_s, part, mu_r, e = rng.uniform(size=(4, 3, 3))
    values = np.stack([1.2 * mu_s, 1.2 * mu_s * part, 0.1 * mu_r, e])
    symmetric = np.triu(values) + np.triu(values, 1).transpose(0, 2, 1)
    return StaticParameters(["m0", "m1", "ground"], rng.uniform(50, 3000, 3), symmetric)


GAP = 0.01
READINGS = 3
SAMPLES = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0])
TIMES = (SAMPLES[:, None] + GAP * np.arange(READINGS + 1)).ravel()


class Batch:
    """Masses (W, O), principal inertias (W, O, 3) and initial states (W, O, 13) of many scenes.

    Where a scene has fewer objects, the rest weighs nothing.
    """

    def __init__(self, scenes, thetas) -> None:
        shape = (len(scenes), max(len(scene.objects) for scene in scenes))
        self.mass, self.inertia = np.zeros(shape), np.zeros((*shape, 3))
        self.states = np.zeros((*shape, 13))
        self.states[..., 6] = 1.0
        for w, (scene, theta) in enumerate(zip(scenes, thetas, strict=True)):
            for k, (thing, state) in enumerate(zip(scene.objects, scene.states, strict=True)):
                density = theta.density[theta.index(thing.material)]
                self.mass[w, k] = thing.shape.mass(density)
                self.inertia[w, k] = thing.shape.inertia(density)
                self.states[w, k] = state.to_vector()

    def first_energy(self):
        """E = Σ m v² / 2 + ω·I ω / 2 + m g z at the start, shape (W,)."""
        s = self.states
        return self._energy(s[..., 2], s[..., 7:10], s[..., 3:7], s[..., 10:13])

    def energies(self, rollout, step):
        """The same in the middle of the gaps after each sample, and how far it may be misread.

        Both have the shape (W, n_samples, READINGS). Two orientations tell a spin whose axis turns
        meanwhile to (|ω| gap)² / 12 of it. A contact that still parts or closes moves its bodies by
        their last velocities all through a step h: where gravity works on them these are ahead of
        the height by up to half a step, m g v_z h / 2.
        """
        x, q = np.nan_to_num(rollout.positions), rollout.orientations
        q = np.where(np.isfinite(q), q, [0.0, 0.0, 0.0, 1.0])
        x, q = (a.reshape(*a.shape[:2], len(SAMPLES), READINGS + 1, -1) for a in (x, q))
        before, after = q[..., :-1, :], q[..., 1:, :]
        after = after * np.where((before * after).sum(-1, keepdims=True) < 0, -1.0, 1.0)
        middle = before + after
        middle = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
        # after · before⁻¹ = (vector, scalar) turns by 2 atan2(|vector|, scalar).
        u, s, v, w = before[..., :3], before[..., 3:], after[..., :3], after[..., 3:]
        vector = s * v - w * u - np.cross(v, u)
        sine = np.linalg.norm(vector, axis=-1, keepdims=True)
        angle = 2 * np.arctan2(sine, (before * after).sum(-1, keepdims=True))
        spin = vector * angle / np.maximum(sine, 1e-12) / GAP
        height = 0.5 * (x[..., :-1, 2] + x[..., 1:, 2])
        velocity = np.diff(x, axis=3) / GAP
        energy = self._energy(height, velocity, middle, spin)
        turning = (self.inertia.max(-1)[..., None, None] * (spin**2).sum(-1)).sum(1)
        turned = turning * (np.linalg.norm(spin, axis=-1).max(1) * GAP) ** 2 / 6
        ahead = (self.mass[..., None, None] * np.abs(velocity[..., 2])).sum(1) * G * step / 2
        return energy, turned + ahead

    def _energy(self, height, velocity, orientation, spin):
        more = (slice(None), slice(None), *[None] * (height.ndim - 2))
        own = rotated_back(orientation, spin)
        kinetic = self.mass[more] * (velocity**2).sum(-1) + (self.inertia[more] * own**2).sum(-1)
        return (0.5 * kinetic + self.mass[more] * G * height).sum(1)


def rotated_back(quaternions, vectors):
    """Vectors (..., 3) in the axes of the bodies of those orientations (..., 4)."""
    u, w = -quaternions[..., :3], quaternions[..., 3:]
    return vectors + 2 * np.cross(u, np.cross(u, vectors) + w * vectors)


def deepest(scenes, rollout):
    """The deepest (m) that any object is in a plane at any time."""
    deepest = 0.0
    for w, scene in enumerate(scenes):
        for k, thing in enumerate(scene.objects):
            x, q = rollout.positions[w, k], rollout.orientations[w, k]
            for plane in scene.environment.planes:
                n = rotated_back(q, np.broadcast_to(plane.normal, x.shape))
                gaps = x @ plane.normal - plane.offset - reach(thing.shape, n)
                deepest = max(deepest, -np.nanmin(gaps, initial=np.inf))
    return deepest


def reach(shape: Shape, n):
    """How far a shape reaches from its centre along directions n (..., 3) in its own axes."""
    if isinstance(shape, Sphere):
        return shape.radius
    if isinstance(shape, Box):
        return 0.5 * np.abs(n) @ shape.edge_lengths
    return shape.radius + 0.5 * shape.length * np.abs(n[..., 2])


def check_energy(engine: Engine, scenes, thetas) -> float:
    """Energy is at most what it was before, and nothing is inside a plane.

    Boxes that slide and jam may end with a word, one in thousands of scenes of five; until there
    they keep to the laws. Returns the part of the samples that could be read.
    """
    rollout = engine.simulator.rollout(scenes, thetas, TIMES)
    stopped = rollout.status != WorldStatus.OK
    assert (rollout.status[stopped] == WorldStatus.NOT_CONVERGED).all()
    assert stopped.sum() <= 1
    batch = Batch(scenes, thetas)
    energies, misread = batch.energies(rollout, engine.step)
    weight = G * batch.mass.sum(1)
    least, told = batch.first_energy(), 0.0
    for k in range(len(SAMPLES)):
        # An impact within a gap, or friction, makes the readings differ: none is then true.
        highest, doubt = energies[:, k].max(1), misread[:, k].max(1)
        agree = highest - energies[:, k].min(1) < doubt + 5e-4 * weight
        told += agree.mean() / len(SAMPLES)
        # What has sunk into something by up to 2 mm may be lifted out of it.
        growth = np.where(agree, highest - least - doubt - 2e-3 * weight, 0.0)
        assert growth.max() <= 0.0, f"scene {growth.argmax()} gains {growth.max():.3g} J"
        least = np.where(agree, np.minimum(least, highest), least)
    # No more than what a second contact that closes at 6 m/s may sink within the step.
    assert deepest(scenes, rollout) < 5e-3
    return told


@pytest.mark.parametrize("kinds", [SPHERES, ALL_SHAPES], ids=["spheres", "mixed"])
@pytest.mark.parametrize("seed", range(4))
@engines(STEPPED)
def test_energy_never_grows_in_many_scenes(engine, kinds, seed):
    # E = Σ m v² / 2 + ω·I ω / 2 + m g z never grows, here in 4 × 250 scenes of each kind.
    rng = np.random.default_rng([seed, 1])
    scenes = [random_scene(rng, kinds) for _ in range(250)]
    assert check_energy(engine, scenes, [random_parameters(rng) for _ in scenes]) > 0.7


@engines(EVENT_DRIVEN)
def test_energy_never_grows_in_many_scenes_of_balls(engine):
    rng = np.random.default_rng(2)
    scenes = [random_scene(rng, SPHERES) for _ in range(200)]
    assert check_energy(engine, scenes, [random_parameters(rng) for _ in scenes]) > 0.7


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
    # Balls without rolling friction only: Bullet's method of first order lets tumbling boxes gain
    # energy, and it cannot express the rolling friction of pairs of balls of different sizes.
    rng = np.random.default_rng(3)
    scenes = [random_scene(rng, SPHERES, 2) for _ in range(6)]
    thetas = [
        StaticParameters.uniform(
            ["m0", "m1", "ground"],
            static_friction=mu,
            dynamic_friction=mu,
            rolling_friction=0.0,
            restitution=e,
        )
        for mu, e in rng.uniform(size=(6, 2))
    ]
    rollout = engine.simulator.rollout(scenes, thetas, TIMES)
    batch = Batch(scenes, thetas)
    energies, misread = batch.energies(rollout, 0.0)
    # Each of some ten impacts that come late by a step h lets gravity do m g v h more.
    late = 10 * batch.mass.sum(1) * G * 6.0 * engine.step
    assert (energies <= (batch.first_energy() + late)[:, None, None] + misread).all()


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
