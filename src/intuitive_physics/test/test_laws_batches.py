"""Batches, threads, sleep: what must hold whatever the physics."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation import WorldStatus, pack_worlds
from intuitive_physics.state import ObjectState

from .laws_scenes import (
    BULLET,
    EVENT_DRIVEN,
    LYING_ALONG_X,
    ROUNDING,
    STEPPED,
    UPRIGHT,
    Body,
    G,
    coefficients,
    engines,
    make_scene,
    random_quaternion,
)

GROUNDS = [
    Environment([Plane("floor", "ground", (0, 0, 1), 0.0)]),
    Environment(
        [
            Plane("floor", "ground", (0, 0, 1), 0.0),
            Plane("wall", "ground", (-1, 0, 0), -1.0),
            Plane("shelf", "ground", (0, 0, 1), 0.2, [(-1, -1, 0.2), (0, -1, 0.2), (0, 1, 0.2)]),
        ],
        [StaticBox("step", "ground", (0.5, 0, 0.05), UPRIGHT, (0.4, 1.0, 0.1))],
    ),
]


def varied_scenes(count, kinds=(0, 1, 2), grounds=GROUNDS):
    """Worlds of one to three objects of different shapes in different environments."""
    rng = np.random.default_rng(4)
    shapes = [
        lambda: Sphere(rng.uniform(0.03, 0.08)),
        lambda: Box(tuple(rng.uniform(0.05, 0.15, 3))),
        lambda: Capsule(rng.uniform(0.03, 0.06), rng.uniform(0.05, 0.15)),
    ]
    scenes = []
    for _ in range(count):
        objects, states = [], []
        for k in range(rng.integers(1, 4)):
            shape = shapes[kinds[rng.integers(len(kinds))]]()
            objects.append(SceneObject(f"o{k}", "body", shape))
            at = (*rng.uniform(-0.4, 0.4, 2), 0.4 + 0.35 * k)
            spin = rng.normal(size=3) * 5
            states.append(ObjectState(at, random_quaternion(rng), rng.normal(size=3), spin))
        ground = grounds[rng.integers(len(grounds))]
        scenes.append(Scene(ground, tuple(objects), tuple(states)))
    return scenes


def scenes_for(engine, count):
    if engine is STEPPED:
        return varied_scenes(count)
    if engine is EVENT_DRIVEN:
        return varied_scenes(count, kinds=(0,))
    return varied_scenes(count, grounds=GROUNDS[:1])


@engines()
def test_a_batch_equals_its_members_alone(engine):
    scenes = scenes_for(engine, 48 if engine is not BULLET else 4)
    theta = coefficients(0.5, mu_r=0.0, e=0.5)
    times = np.linspace(0, 1.5, 7)
    batch = engine.simulator.rollout(scenes, theta, times)
    for w, scene in enumerate(scenes):
        n = len(scene.objects)
        alone = engine.simulator.rollout([scene], theta, times)
        np.testing.assert_array_equal(batch.positions[w, :n], alone.positions[0])
        np.testing.assert_array_equal(batch.orientations[w, :n], alone.orientations[0])
        assert np.isnan(batch.positions[w, n:]).all()


def with_threads(name, threads):
    if name == "stepped":
        from intuitive_physics.simulation.core.engines import SteppedSimulator

        return SteppedSimulator(threads=threads)
    from intuitive_physics.simulation.core.engines import EventDrivenSimulator

    return EventDrivenSimulator(threads=threads)


@pytest.mark.parametrize("threads", [2, 3, 8])
@engines(EVENT_DRIVEN, STEPPED)
def test_any_number_of_threads_gives_the_same_bits(engine, threads):
    scenes = scenes_for(engine, 100)
    theta = coefficients(0.5, mu_s=0.6, mu_r=0.02, e=0.5)
    times = np.linspace(0, 2, 9)
    one = with_threads(engine.name, 1).rollout(scenes, theta, times)
    many = with_threads(engine.name, threads).rollout(scenes, theta, times)
    np.testing.assert_array_equal(one.positions, many.positions)
    np.testing.assert_array_equal(one.orientations, many.orientations)
    np.testing.assert_array_equal(one.status, many.status)


@engines()
def test_two_threads_may_share_an_engine(engine):
    scenes = scenes_for(engine, 8 if engine is not BULLET else 2)
    theta = coefficients(0.5, e=0.5)
    times = [0.5, 1.0]
    alone = engine.simulator.rollout(scenes, theta, times).positions
    with ThreadPoolExecutor(2) as pool:
        calls = [pool.submit(engine.simulator.rollout, scenes, theta, times) for _ in range(4)]
    for call in calls:
        np.testing.assert_array_equal(call.result().positions, alone)


@engines(EVENT_DRIVEN, STEPPED)
@given(cuts=st.lists(st.floats(0.001, 1.999), min_size=1, max_size=30, unique=True))
@settings(max_examples=20)
def test_output_times_do_not_change_the_motion(engine, cuts):
    # Asked at more times it answers the same at those it was asked at before.
    scene = scenes_for(engine, 3)[2]
    theta = coefficients(0.5, mu_r=0.02, e=0.5)
    coarse = engine.path(scene, theta, [1.0, 2.0])
    times = np.unique([*cuts, 1.0, 2.0])
    fine = engine.path(scene, theta, times)
    chosen = np.searchsorted(times, [1.0, 2.0])
    np.testing.assert_allclose(fine[:, chosen], coarse, atol=1e-9)


@engines(EVENT_DRIVEN, STEPPED)
def test_each_world_may_have_its_own_parameters_and_times(engine):
    scenes = scenes_for(engine, 6)
    thetas = [coefficients(0.1 * k, e=0.15 * k, density=100.0 * (k + 1)) for k in range(6)]
    rows = np.array([[0.3, 0.7 + 0.1 * k, 1.5 if k % 2 else np.nan] for k in range(6)])
    batch = engine.simulator.rollout_batch(pack_worlds(scenes, thetas), rows)
    for k in range(6):
        n, wanted = len(scenes[k].objects), rows[k][np.isfinite(rows[k])]
        alone = engine.simulator.rollout([scenes[k]], thetas[k], wanted)
        np.testing.assert_array_equal(batch.positions[k, :n, : wanted.size], alone.positions[0])
        assert np.isnan(batch.positions[k, :, wanted.size :]).all()


@engines(EVENT_DRIVEN, STEPPED)
def test_crossed_and_repeated_batches(engine):
    scenes, times = scenes_for(engine, 3), [0.5, 1.0]
    thetas = [coefficients(0.4, e=e) for e in (0.2, 0.8)]
    roll = engine.simulator.rollout_batch
    crossed = roll(pack_worlds(scenes, thetas[0]).crossed(thetas), times)
    for c, theta in enumerate(thetas):
        alone = engine.simulator.rollout(scenes, theta, times)
        np.testing.assert_array_equal(crossed.positions[3 * c : 3 * c + 3], alone.positions)
    single = pack_worlds(scenes[:1], thetas[0])
    states = np.repeat(single.states, 2, axis=0)
    states[1, :, 2] += 0.1
    repeated, first = roll(single.repeated(states), times), roll(single, times)
    np.testing.assert_array_equal(repeated.positions[0], first.positions[0])
    assert (repeated.positions[1] != first.positions[0]).any()


@engines()
def test_without_orientations_the_positions_are_the_same(engine):
    scenes = scenes_for(engine, 4)
    theta = coefficients(0.5, e=0.5)
    both = engine.simulator.rollout(scenes, theta, [0.5, 1.0])
    less = engine.simulator.rollout(scenes, theta, [0.5, 1.0], orientations=False)
    assert less.orientations is None
    np.testing.assert_allclose(less.positions, both.positions, atol=ROUNDING)


@engines(STEPPED)
def test_orientations_are_unit_quaternions_and_continuous_poses(engine):
    rollout = engine.simulator.rollout(
        varied_scenes(30), coefficients(0.5, e=0.5), np.arange(100) * 0.013
    )
    there = np.isfinite(rollout.positions[..., 0])
    norms = np.linalg.norm(rollout.orientations[there], axis=-1)
    np.testing.assert_allclose(norms, 1.0, atol=1e-9)
    first = rollout.orientations[:, :, 0]
    for w, scene in enumerate(varied_scenes(30)):
        for k, state in enumerate(scene.states):
            assert abs(first[w, k] @ state.orientation) == pytest.approx(1.0, abs=1e-12)


@engines()
def test_a_diverging_world_harms_no_other(engine):
    far = make_scene(
        Body(Sphere(0.05), (0, 0, 1.0), UPRIGHT, (1e308, 1e308, -1e308), (1e308, 0, 0))
    )
    near = scenes_for(engine, 3)
    theta = coefficients(0.5, e=0.5)
    together = engine.simulator.rollout([near[0], far, *near[1:]], theta, [0.5, 1.0])
    assert together.status.tolist() == [0, WorldStatus.NOT_FINITE, 0, 0]
    assert np.isnan(together.positions[1, :, 1]).all()
    alone = engine.simulator.rollout(near, theta, [0.5, 1.0])
    np.testing.assert_array_equal(together.positions[[0, 2, 3]], alone.positions)


RESTING = {
    "sphere": Body(Sphere(0.05), (0, 0, 0.05)),
    "box": Body(Box((0.1, 0.12, 0.1)), (0, 0, 0.05)),
    "capsule": Body(Capsule(0.05, 0.1), (0, 0, 0.05), LYING_ALONG_X),
}


@pytest.mark.parametrize("body", RESTING.values(), ids=RESTING.keys())
@engines(STEPPED)
def test_what_sleeps_stays(engine, body):
    # Bit for bit, for a minute.
    x, q = engine.poses(make_scene(body), coefficients(0.5, mu_r=0.02), [5.0, 10.0, 60.0])
    np.testing.assert_allclose(x[0, 0], body.position, atol=1e-3)
    np.testing.assert_array_equal(x[0, 1:], x[0, :-1])
    np.testing.assert_array_equal(q[0, 1:], q[0, :-1])


@pytest.mark.parametrize("body", RESTING.values(), ids=RESTING.keys())
@engines(STEPPED)
def test_what_sleeps_wakes_when_it_is_hit(engine, body):
    # A ball falls for 2 s and lands beside the middle: what slept moves, and not before.
    height = 0.5 * G * 2.0**2
    ball = Body(Sphere(0.04), (0.03, 0.01, height + 0.2))
    scene = make_scene(body, ball)
    x = engine.path(scene, coefficients(0.5, mu_r=0.01, e=0.3), [1.0, 1.9, 2.5])[0]
    np.testing.assert_array_equal(x[1], x[0])
    assert np.linalg.norm(x[2] - x[1]) > 1e-4


@engines(STEPPED)
def test_what_sleeps_falls_when_its_support_goes(engine):
    # A box asleep on two blocks: one of them is knocked away by a fast ball after 2 s.
    block = Box((0.1, 0.1, 0.1))
    plank = Body(Box((0.5, 0.1, 0.04)), (0, 0, 0.12))
    blocks = [Body(block, (-0.2, 0, 0.05)), Body(block, (0.2, 0, 0.05))]
    ball = Body(Sphere(0.05), (0.2, -12.0, 0.05), UPRIGHT, (0, 6.0, 0), (-6.0 / 0.05, 0, 0))
    scene = make_scene(plank, *blocks, ball)
    theta = coefficients(0.3, mu_r=0.0, e=0.2, density=500.0)
    x = engine.path(scene, theta, [1.5, 1.9, 4.0])
    np.testing.assert_array_equal(x[0, 1], x[0, 0])
    assert x[2, 2, 1] > 0.1
    assert x[0, 2, 2] < 0.11
