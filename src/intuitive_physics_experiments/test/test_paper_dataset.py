"""The synthetic set is what Sec. IV-B says: its numbers, its noise, its initial states."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.materials import parameter_count
from intuitive_physics.scene import SceneObject
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import LINEAR_VELOCITY, POSITION
from intuitive_physics_experiments.paper.paper_dataset import (
    POSITION_NOISE,
    make_paper_dataset,
)
from intuitive_physics_experiments.paper.paper_room import (
    DIMENSIONS,
    HALF_ROOM,
    dataset_parameters,
    draw_initial_states,
    draw_pool,
    paper_room,
)
from intuitive_physics_learner.cost.cost_function import TrajectoryCost

OBJECTS, SAMPLES = 4, 10


@pytest.fixture(scope="module")
def dataset():
    return make_paper_dataset(OBJECTS, SAMPLES, np.random.default_rng(3))


def test_each_object_has_just_so_many_trajectories(dataset):
    runs = [*dataset.training, *dataset.test]
    ids = [thing.id for run in runs for thing in run.scene.objects]
    assert sorted(ids) == sorted([thing.id for thing in dataset.pool] * SAMPLES)
    assert len(dataset.training) == round(0.8 * len(runs))
    assert len({run.observation.id for run in runs}) == len(runs)


@pytest.mark.parametrize(("objects", "parameters"), [(1, 14), (10, 275), (20, 945)])
def test_one_material_each_and_one_of_the_room(objects, parameters):
    # |θ_s| = m + 4 ψ (Eq. 3) with m = objects + 1, as Sec. V has it.
    rng = np.random.default_rng(0)
    theta = dataset_parameters("auto", draw_pool(objects, rng), rng)
    assert parameter_count(len(theta.materials)) == parameters


def test_dimensions_are_in_range():
    pool = draw_pool(300, np.random.default_rng(0))
    sizes = []
    for thing in pool:
        match thing.shape:
            case Sphere(radius=radius):
                sizes.append(2.0 * radius)
            case Box(edge_lengths=edges):
                sizes += edges
            case Capsule(radius=radius, length=length):
                sizes += [2.0 * radius, length]
    low, high = DIMENSIONS
    assert low <= min(sizes) < low + 0.02
    assert high - 0.02 < max(sizes) <= high
    # A third each; the standard deviation of a share of 300 is 2.7 %.
    kinds = [thing.shape.kind for thing in pool]
    assert all(kinds.count(kind) / 300 == pytest.approx(1 / 3, abs=0.11) for kind in set(kinds))


def test_starts_are_in_the_room_and_apart():
    rng = np.random.default_rng(1)
    pool = draw_pool(6, rng)
    for _ in range(50):
        states = draw_initial_states(pool, rng)
        for i, (thing, state) in enumerate(zip(pool, states, strict=True)):
            reach = thing.shape.bounding_radius
            distances = [p.signed_distances(state.position) for p in paper_room().planes]
            assert min(distances) > reach
            for k in range(i):
                gap = np.linalg.norm(state.position - states[k].position)
                assert gap > reach + pool[k].shape.bounding_radius


def test_first_velocities_point_to_the_circle_center():
    # Eq. 10: ẋ + x has the mean c; its deviation is 1, that of the mean of 400 is 0.05.
    rng = np.random.default_rng(2)
    pool = draw_pool(1, rng)
    states = [draw_initial_states(pool, rng)[0] for _ in range(400)]
    centers = np.mean([state.position + state.linear_velocity for state in states], axis=0)
    assert centers == pytest.approx([0.0, 0.0, 2.0], abs=0.2)


def test_too_many_objects_for_the_room_are_refused():
    pool = [SceneObject(f"ball_{i}", f"material_{i}", Sphere(1.0)) for i in range(100)]
    with pytest.raises(InvalidInputError, match="no free place"):
        draw_initial_states(pool, np.random.default_rng(0))


def test_points_are_noisy_and_the_truth_explains_them(dataset):
    runs = [*dataset.training, *dataset.test]
    noise = np.concatenate(
        [
            (observed.trajectory.positions - truth).ravel()
            for run in runs
            for observed, truth in zip(run.observation.objects, run.positions, strict=True)
        ]
    )
    assert noise.std() == pytest.approx(POSITION_NOISE, rel=0.02)
    truly = dataset.with_initial_states("true").training_observations
    cost = TrajectoryCost(truly, make_simulator("auto"), dataset.parameters.materials)
    # The mean length of three normal components is σ √(8/π).
    expected = POSITION_NOISE * np.sqrt(8.0 / np.pi)
    assert cost.costs([dataset.parameters])[0] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("source", ["three_points", "flight"])
def test_initial_states_are_off_as_far_as_they_say(dataset, source):
    # (x̂ - x)ᵀ P⁻¹ (x̂ - x) has the mean 6 where the covariance P is right.
    runs = [*dataset.training, *dataset.test]
    inside = np.r_[POSITION, LINEAR_VELOCITY]
    squares = []
    for run in runs:
        for observed, truth in zip(
            run.with_initial_states(source).observation.objects, run.scene.states, strict=True
        ):
            state = observed.initial_state
            error = np.append(
                state.position - truth.position, state.linear_velocity - truth.linear_velocity
            )
            covariance = state.covariance[np.ix_(inside, inside)]
            squares.append(error @ np.linalg.solve(covariance, error))
    # Median of 40: a bounce within the points, which no covariance counts, is rare.
    assert 4.0 < np.median(squares) < 7.5


def test_more_points_know_the_velocity_better(dataset):
    def error(source: str) -> float:
        pairs = [
            (observed.initial_state.linear_velocity, truth.linear_velocity)
            for run in dataset.with_initial_states(source).training
            for observed, truth in zip(run.observation.objects, run.scene.states, strict=True)
        ]
        return float(np.median([np.linalg.norm(a - b) for a, b in pairs]))

    # Of three points a velocity is known to σ f / √2 = 0.42 m/s on each axis.
    expected = np.sqrt(2.366) * POSITION_NOISE * 30.0 / np.sqrt(2.0)
    assert error("three_points") == pytest.approx(expected, rel=0.3)
    assert error("flight") < 0.3 * error("three_points")


def test_a_single_run_is_one_to_train_on():
    single = make_paper_dataset(1, 1, np.random.default_rng(0))
    assert (len(single.training), len(single.test)) == (1, 0)


def test_same_seed_same_set():
    first, second = (make_paper_dataset(2, 3, np.random.default_rng(7)) for _ in range(2))
    assert [a.to_json() for a in first.training_observations] == [
        b.to_json() for b in second.training_observations
    ]


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_other_engines_make_the_set_of_parameters_they_can_express(engine):
    made = make_paper_dataset(3, 3, np.random.default_rng(5), engine=engine)
    static, dynamic, _, _ = made.parameters.coefficients
    assert np.array_equal(static, dynamic)
    for run in (*made.training, *made.test):
        assert run.positions[..., 2].min() > 0.0
        assert np.abs(run.positions[..., :2]).max() < HALF_ROOM


def test_what_cannot_be_made_is_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidInputError, match="at least 1"):
        make_paper_dataset(0, 10, rng)
    with pytest.raises(InvalidInputError, match="at least 1"):
        make_paper_dataset(1, 0, rng)
    with pytest.raises(UnknownNameError, match="auto, stepped, bullet, mujoco"):
        make_paper_dataset(1, 10, rng, engine="havok")
    with pytest.raises(UnknownNameError, match="three_points"):
        make_paper_dataset(1, 10, rng, initial_states="oracle")
