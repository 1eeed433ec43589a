"""Which observations are held for disturbed: laws of motion, rates of false alarms, comebacks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.observation import Detections, Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import (
    ConvergenceCriteria,
    LearningOptions,
    ObservationStore,
    learn,
    learn_from_store,
)
from intuitive_physics_learner.assessment import assess_observations, reassessed
from intuitive_physics_learner.assessment.assessment import (
    LEAST_POINTS,
    clean_part,
    good_probabilities,
)
from intuitive_physics_learner.assessment.motion_laws import (
    flight_losses,
    flight_violation,
    jump_violation,
    rest_violation,
)
from intuitive_physics_learner.assessment.tracks import track_of
from intuitive_physics_learner.store.observation_entries import Assessment

from .cases import rerouted

NOISE = 0.02
TIMES = np.arange(90) / 30.0
G = np.array([0.0, 0.0, -9.81])
FLOOR = Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0)
WALL = Plane("wall", "floor", (-1.0, 0.0, 0.0), -5.0)
NOTABLE = -10.0


def observation_of(path, seed=0, shape=None, times=TIMES, noise=NOISE):
    """An observation of one object on this path (n, 3) m."""
    positions = path + np.random.default_rng(seed).normal(0.0, noise, path.shape)
    thing = SceneObject("thing", "wood", shape or Sphere(0.1))
    state = ObjectState(positions[0], covariance=1e-2 * np.eye(12))
    trajectory = Trajectory(times, positions)
    environment = Environment([FLOOR, WALL], gravity=G)
    return Observation(environment, (ObservedObject(thing, trajectory, state),), 0.0)


def track(path, seed=0, shape=None, noise=NOISE):
    whitening = np.broadcast_to(np.eye(3) / noise, (len(path), 3, 3))
    return track_of(observation_of(path, seed, shape, noise=noise), 0, whitening)


def flight(height=20.0):
    """A throw high up, for 3 s; the floor is not reached before 2.5 s."""
    return [-4.0, 0.0, height] + TIMES[:, None] * [0.5, 1.0, 3.0] + 0.5 * TIMES[:, None] ** 2 * G


def sliding(friction=0.3, speed=3.0, height=0.1):
    """A slide on the floor that friction ends."""
    moving = np.minimum(TIMES, speed / (friction * 9.81))
    way = speed * moving - 0.5 * friction * 9.81 * moving**2
    return np.stack([0.0 * way, way, np.full(len(way), height)], axis=1)


def bouncing(restitution=0.7):
    """A ball that bounces on the floor, in closed form."""
    path, start, up = np.empty((len(TIMES), 3)), 0.0, 4.0
    while start < TIMES[-1]:
        end = start + max(2.0 * up / 9.81, 1e-2)
        inside = (start <= TIMES) & (end >= TIMES)
        since = TIMES[inside] - start
        path[inside, 2] = 0.1 + np.maximum(up * since - 0.5 * 9.81 * since**2, 0.0)
        start, up = end, restitution * up
    path[:, 0], path[:, 1] = -3.0 + 1.5 * TIMES, 0.5 * TIMES
    return path


def least(violations):
    return min((violation.log_p for violation in violations if violation is not None), default=0.0)


def violations(track):
    return [law(track) for law in (flight_violation, jump_violation, rest_violation)]


@pytest.mark.parametrize("path", [flight(), sliding(), bouncing(), bouncing(0.3)])
def test_undisturbed_motions_violate_nothing(path):
    """Each p value is uniform or larger: 5 % of 20 seeds below 5 %, at most 5 by P < 0.3 %."""
    for noise in (NOISE, 0.001):
        all_violations = [violations(track(path, seed, noise=noise)) for seed in range(20)]
        assert sum(least(each) < np.log(0.05 / 7) for each in all_violations) <= 5


def test_a_flight_of_any_velocity_leaves_a_chi_squared_loss():
    clean = track(flight())
    starts = np.arange(0, 60, 12)
    losses = np.concatenate(
        [flight_losses(track(flight(), seed), starts, 12) for seed in range(100)]
    )
    # 30 degrees of freedom, less what accelerations within their prior and the choice of the worst
    # of 12 points take: at most 3 and about 6.
    assert 17.0 < losses.mean() < 30.0
    without = replace(clean, positions=clean.positions + TIMES[:, None] * [7.0, -3.0, 2.0] + 5.0)
    np.testing.assert_allclose(flight_losses(without, starts, 12), flight_losses(clean, starts, 12))


def test_one_outlier_of_any_size_changes_no_loss():
    """The loss without a point does not depend on where that point is."""
    clean = track(flight())
    starts = np.array([20])
    violations = []
    for size in (3.0, 300.0):
        positions = clean.positions.copy()
        positions[26] += size
        violations.append(flight_losses(replace(clean, positions=positions), starts, 12))
    np.testing.assert_allclose(violations[0], violations[1], rtol=1e-3)
    assert violations[0] < 60.0


@pytest.mark.parametrize("path", [flight(), sliding(), bouncing()])
def test_an_outlier_alone_is_no_disturbance(path):
    for place in (20, 40, 60):
        clean = track(path, place)
        positions = clean.positions.copy()
        positions[place] += [0.5, -0.5, 0.7]
        assert least(violations(replace(clean, positions=positions))) > NOTABLE


def test_kick_in_flight_is_located():
    kicked = flight() + np.maximum(TIMES - 1.0, 0.0)[:, None] * [1.5, -1.5, 0.5]
    violation = flight_violation(track(kicked))
    assert violation.log_p < NOTABLE
    assert 0.5 < violation.clean_until <= 1.0 < violation.time < 1.5


def test_a_tilted_vertical_and_drag_of_the_air_are_no_disturbance():
    off = 0.5 * TIMES[:, None] ** 2 * [0.5, 0.0, -0.5]
    assert flight_violation(track(flight() + off)).log_p > NOTABLE
    drag = replace(track(flight() + 10.0 * off), in_air=True)
    assert flight_violation(drag).log_p > NOTABLE


@pytest.mark.parametrize("path", [flight(), sliding(), bouncing()])
def test_jump_is_located(path):
    jumped = path + (TIMES > 1.01)[:, None] * [-0.6, 0.3, 0.3]
    violation = jump_violation(track(jumped))
    assert violation.log_p < NOTABLE
    assert violation.clean_until <= 1.01 < violation.time + 1e-9 < 1.1


def test_a_box_rests_on_its_faces_only():
    box = Box((0.2, 0.3, 0.5))
    for height in (0.1, 0.15, 0.25):
        resting = np.tile([0.0, 0.0, height], (len(TIMES), 1))
        assert rest_violation(track(resting, shape=box)).log_p > NOTABLE
    held = np.tile([0.0, 0.0, 0.4], (len(TIMES), 1))
    assert rest_violation(track(held, shape=box)).log_p < NOTABLE
    # Against a wall it may lean.
    leaning = held + [4.9, 0.0, 0.0]
    assert rest_violation(track(leaning, shape=box)) is None


def test_the_share_of_disturbed_ones_is_estimated():
    rng = np.random.default_rng(2)
    log_ps = np.log(np.append(rng.uniform(size=80), np.full(20, 1e-4)))
    good = good_probabilities(log_ps)
    assert (good[80:] < 0.1).all()
    assert (good[:80] < 0.5).mean() <= 0.05
    assert (good_probabilities(log_ps[:80]) > 0.5).mean() >= 0.97


def test_a_noise_that_is_wrong_for_all_is_no_fault_of_any():
    rng = np.random.default_rng(3)
    good = good_probabilities(30.0 * np.log(rng.uniform(size=100)))
    assert (good > 0.5).mean() >= 0.95


@given(st.lists(st.floats(-1e300, 0.0), max_size=30))
def test_probabilities_are_probabilities_and_fall_with_p(log_ps):
    probabilities = good_probabilities(np.array(log_ps))
    assert ((probabilities >= 0.0) & (probabilities <= 1.0)).all()
    assert (np.diff(probabilities[np.argsort(log_ps)]) >= 0.0).all()


def judged(misfits):
    used = [Assessment(str(i), 1.0) for i in range(len(misfits))]
    return [
        assessment.status == "doubtful"
        for assessment in reassessed(used, np.array(misfits), np.full(len(misfits), 1.0))
    ]


def test_a_fit_that_fails_is_doubtful_where_others_do_not_fail():
    tight = np.exp(np.random.default_rng(4).normal(0.5, 0.15, 30))
    assert judged([*tight, 20.0]) == [False] * 30 + [True]
    assert judged([*[np.nan] * 30, 20.0]) == [False] * 30 + [True]
    wide = np.exp(np.random.default_rng(5).normal(2.0, 1.0, 30))
    assert judged([*wide, 20.0]) == [False] * 31


@given(st.floats(-1.0, 4.0), st.integers(2, 40))
def test_a_clean_part_ends_in_time_and_keeps_a_few_points(until, count):
    whole = observation_of(flight()[:count], times=TIMES[:count])
    (ball,) = whole.objects
    track_of = ball.trajectory
    made = Detections(
        track_of.times, track_of.positions, np.tile(np.eye(3), (count, 1, 1)), np.eye(3)
    )
    whole = replace(whole, objects=(replace(ball, detections=made),))
    (part,) = clean_part(whole, until).objects
    kept = len(part.trajectory)
    # The first point is at the start.
    least_kept = min(1 + LEAST_POINTS, count)
    assert kept == len(part.detections) >= least_kept
    assert kept == least_kept or part.trajectory.times[-1] <= until
    np.testing.assert_array_equal(part.trajectory.positions, track_of.positions[:kept])
    assert kept == count or track_of.times[kept] > until


def test_disturbed_observation_is_cut_unless_trusted():
    observations = [observation_of(flight(), seed) for seed in range(6)]
    kick = np.maximum(TIMES - 1.0, 0.0)[:, None] * [2.0, 0.0, 1.0]
    observations[2] = observation_of(flight() + kick, 2)
    clean, assessments = assess_observations(observations)
    statuses = [assessment.status for assessment in assessments]
    assert statuses == ["used"] * 2 + ["doubtful"] + ["used"] * 3
    assert 0.2 < clean[2].objects[0].trajectory.times[-1] <= 1.0
    assert clean[:2] + clean[3:] == observations[:2] + observations[3:]
    clean, assessments = assess_observations(observations, [observations[2].id])
    assert clean == observations
    assert all(assessment.status == "used" for assessment in assessments)
    assert assess_observations([]) == ([], [])


def jumped(observation):
    jump = [0.4, -0.3, 0.2]
    return rerouted(
        observation, lambda times, positions: positions + (times > 0.45)[:, None] * jump
    )


def test_disturbed_observation_is_doubtful_until_included(tmp_path, event_driven, throws):
    observations = throws(12, 3, noise=0.003, state_noise=0.01, times=48)
    observations[4] = jumped(observations[4])
    with ObservationStore(tmp_path / "learned.sqlite3") as store:
        store.add_all(observations)
        options = LearningOptions(criteria=ConvergenceCriteria(300))
        result = learn_from_store(store, event_driven, options)
        weights = np.array([assessment.weight for assessment in result.assessments])
        np.testing.assert_array_equal(np.flatnonzero(weights < 0.5), [4])
        (entry,) = store.entries(statuses=["doubtful"])
        assert entry.id == observations[4].id
        assert entry.reason.startswith("mistracked at t = 0.4")
        # It is assessed again, and may come back.
        again = learn_from_store(store, event_driven, options)
        assert len(again.assessments) == 12
        store.include([observations[4].id])
        learn_from_store(store, event_driven, options)
        assert store.counts()["doubtful"] == 0


def test_learning_with_disturbed_observations_is_as_accurate(event_driven, throws, true_parameters):
    observations = throws(12, 3, noise=0.003, state_noise=0.01, times=48)
    disturbed = [jumped(each) for each in observations[:3]] + observations[3:]
    learned = learn(disturbed, event_driven, LearningOptions()).learned
    true = true_parameters.coefficients[3, 0, 1]
    assert abs(learned.parameters.coefficients[3, 0, 1] - true) < 0.02


def test_an_update_rule_assesses_none(event_driven, throws):
    options = LearningOptions(method="random")
    assert learn(throws(2, 0), event_driven, options).assessments == ()
