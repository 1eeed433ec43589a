"""J, D̄ and D̂ are what Eqs. 5 to 9 say."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.simulation import pack_worlds
from intuitive_physics.trajectory import DISTANCES, LARGEST_DISTANCE, MEAN_DISTANCE, Trajectory
from intuitive_physics_learner import NoObservationsError, TrajectoryCost
from intuitive_physics_learner.cost import cost_function as cost_module
from intuitive_physics_learner.cost.cost_function import FAILED_DISTANCE
from intuitive_physics_learner.cost.trials import Trials


def parameters(e, materials=("ball", "floor")):
    return StaticParameters.uniform(materials, restitution=e)


def observed_distances(observation, simulator, theta, distance):
    """Eqs. 6 and 7 to the letter: simulate, synchronise (Eq. 5), take the mean or the largest."""
    distances = []
    for j, thing in enumerate(observation.objects):
        times = thing.trajectory.times - observation.start_time
        times = np.unique(np.concatenate([[0.0], times[times > 0.0]]))
        rollout = simulator.rollout_batch(pack_worlds([observation.scene()], theta), times)
        simulated = Trajectory(times, rollout.positions[0, j])
        shifted = Trajectory(
            thing.trajectory.times - observation.start_time, thing.trajectory.positions
        )
        distances.append(DISTANCES[distance](shifted, simulated))
    return distances


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    counts=st.lists(st.lists(st.integers(1, 40), min_size=1, max_size=3), min_size=1, max_size=6),
    e=st.floats(0.0, 0.98),
    seen=st.floats(0.0, 1.0),
    distance=st.sampled_from(list(DISTANCES)),
)
def test_agrees_with_the_definition(glide, glides, seed, counts, e, seen, distance):
    generator = np.random.default_rng(seed)
    observations = [
        glides(generator, seen, c, ["ball", "stone", "ball"][: len(c)], start=5.0) for c in counts
    ]
    materials = ("ball", "stone", "floor")
    theta = parameters(e, materials)
    cost = TrajectoryCost(observations, glide, materials, distance)
    expected = [observed_distances(y, glide, theta, distance) for y in observations]
    flat = [d for distances in expected for d in distances]
    np.testing.assert_allclose(cost.distances([theta])[0], flat, rtol=1e-9, atol=1e-9)
    # Eqs. 8 and 9: the mean over all trajectories of all observations.
    np.testing.assert_allclose(cost.costs([theta])[0], np.mean(flat), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        cost.observation_costs([theta])[0],
        [np.mean(distances) for distances in expected],
        rtol=1e-9,
        atol=1e-9,
    )


@pytest.mark.parametrize(("distance", "of"), [(MEAN_DISTANCE, np.mean), (LARGEST_DISTANCE, np.max)])
def test_distances_in_closed_form(glide, glides, distance, of):
    # x(t) = x(0) + e v t moves apart all the time: D̄ = |e - e'| |v| mean(t), D̂ with the last t.
    observation = glides(np.random.default_rng(0), 0.8, start=100.0)
    (ball,) = observation.objects
    speed = np.linalg.norm(ball.initial_state.linear_velocity)
    expected = 0.3 * speed * of(ball.trajectory.times - 100.0)
    cost = TrajectoryCost([observation], glide, ("ball", "floor"), distance)
    np.testing.assert_allclose(cost.costs([parameters(0.5)]), [expected], rtol=1e-9)


def test_point_at_the_start_counts_and_points_before_do_not(glide, glides):
    track = glides(np.random.default_rng(0), 0.8).objects[0]
    speed = np.linalg.norm(track.initial_state.linear_velocity)
    times = np.array([-0.2, -1e-9, 0.1])
    positions = track.initial_state.position + 0.8 * times[:, None] * (
        track.initial_state.linear_velocity
    )
    thing = ObservedObject(track.object, Trajectory(1000.0 + times, positions), track.initial_state)
    environment = glides(np.random.default_rng(0), 0.8).environment
    cost = TrajectoryCost([Observation(environment, (thing,), 1000.0)], glide, ("ball", "floor"))
    # Two points: one at the start, where the distance is 0, one at 0.1 s.
    np.testing.assert_allclose(cost.costs([parameters(0.5)]), 0.3 * speed * 0.1 / 2, rtol=1e-6)


def test_batches_equal_single_candidates(event_driven, throws, true_parameters, monkeypatch):
    observations = throws(3, 0, noise=0.01) + throws(3, 1, times=20)
    cost = TrajectoryCost(observations, event_driven)
    some = [true_parameters.with_pair("ball", "floor", restitution=e) for e in (0.2, 0.5, 0.9)]
    together = cost.distances(some)
    assert (together == np.concatenate([cost.distances([theta]) for theta in some])).all()
    residuals = cost.trial_residuals(Trials.crossed(some, 6))
    monkeypatch.setattr(cost_module, "LARGEST_CHUNK", 1)
    assert (together == cost.distances(some)).all()
    again = cost.trial_residuals(Trials.crossed(some, 6))
    np.testing.assert_array_equal(residuals, again)


def test_residuals_have_the_distances_as_their_lengths(event_driven, throws, true_parameters):
    cost = TrajectoryCost(throws(2, 0, noise=0.01) + throws(2, 1, times=20), event_driven)
    lengths = np.linalg.norm(cost.trial_residuals(Trials.crossed([true_parameters], 4)), axis=2)
    assert np.isfinite(lengths).sum(axis=1).tolist() == [60, 60, 20, 20]
    distances = cost.distances([true_parameters])[0]
    np.testing.assert_allclose(np.nanmean(lengths, axis=1), distances, rtol=1e-12)


@pytest.mark.parametrize("until", [None, [0.3, 0.9, 0.3, 0.9]])
def test_residuals_of_some_points_are_those_among_all(event_driven, throws, true_parameters, until):
    cost = TrajectoryCost(throws(2, 0, noise=0.01) + throws(2, 1, times=20), event_driven)
    trials = Trials.crossed([true_parameters], 4)
    if until is not None:
        trials = replace(trials, until=np.array(until))
    every = cost.trial_residuals(trials)
    columns = np.array([0, 3, 19, 20, 59])
    some = cost.trial_residuals(replace(trials, columns=columns))
    assert np.isfinite(every).any()
    np.testing.assert_array_equal(some, every[:, columns])


def test_nothing_is_left_at_the_true_parameters(event_driven, throws, true_parameters):
    cost = TrajectoryCost(throws(6, 0), event_driven)
    assert cost.costs([true_parameters])[0] < 1e-9


@pytest.mark.parametrize("distance", DISTANCES)
def test_failed_worlds_cost_a_finite_fortune_and_harm_no_other(glide, glides, distance):
    generator = np.random.default_rng(0)
    observations = [glides(generator, 0.5), glides(generator, 0.5, materials=("stone",))]
    materials = ("ball", "stone", "floor")
    theta = parameters(0.5, materials).with_pair("ball", "floor", restitution=1.0)
    cost = TrajectoryCost(observations, glide, materials, distance)
    distances = cost.distances([theta])[0]
    assert distances[0] == FAILED_DISTANCE
    assert distances[1] < 1e-12
    failed, other = cost.trial_residuals(Trials.crossed([theta], 2))
    assert np.isnan(failed).all()
    assert np.isfinite(other).any()


@pytest.mark.parametrize("distance", DISTANCES)
def test_worlds_far_away_cost_no_more_than_failed_ones(glide, glides, distance):
    observation = glides(np.random.default_rng(0), 1e9)
    cost = TrajectoryCost([observation], glide, ("ball", "floor"), distance)
    assert cost.costs([parameters(0.0)])[0] == FAILED_DISTANCE


def test_unknown_distance(glide, glides):
    observation = glides(np.random.default_rng(0), 0.5)
    with pytest.raises(UnknownNameError, match="'median'; expected one of mean, max"):
        TrajectoryCost([observation], glide, ("ball", "floor"), "median")


def test_no_observations():
    with pytest.raises(NoObservationsError, match="no observations"):
        TrajectoryCost([], None)


def test_unknown_material(glide, glides):
    with pytest.raises(UnknownNameError, match="'ball'"):
        TrajectoryCost([glides(np.random.default_rng(0), 0.5)], glide, ("stone", "floor"))
