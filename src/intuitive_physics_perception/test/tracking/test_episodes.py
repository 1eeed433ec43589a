"""Observations: initial states that are true, and rules of when they begin and end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.observation import Observation
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import EpisodeRecorder, observations_of
from intuitive_physics_perception.tracking.free_motion import FreeMotion
from intuitive_physics_perception.tracking.tracker import COAST_TIME, Tracker

from ..conftest import FLOOR, seen_record, seen_sphere

SETTINGS = PerceptionSettings()
STEP = 1.0 / 30.0
NOISE = 0.001
RADIUS = 0.05


def record(rng, times, path, name="ball"):
    noise = np.tile(NOISE**2 * np.eye(3), (len(path), 1, 1))
    return seen_record(rng, times, path, noise, name)


def state(ball, time):
    return FreeMotion(ball, FLOOR).state_at(time, SETTINGS)


def test_the_initial_state_is_least_squares_with_gravity_known(rng, bounce) -> None:
    times = 5.0 + np.arange(0, 0.8, STEP)
    velocity = np.array([1.2, -0.4, 1.0])
    path = bounce(times - 5.0, (0, 0, 0.5), velocity, RADIUS)
    ratios = []
    for _ in range(60):
        estimate = state(record(rng, times, path), 5.0)
        error = np.concatenate([estimate.position - path[0], estimate.linear_velocity - velocity])
        places = np.r_[0:3, 6:9]
        ratios.append(
            error @ np.linalg.solve(estimate.covariance[np.ix_(places, places)], error) / 6.0
        )
        assert np.linalg.norm(error[3:]) < 0.05
    # An honest covariance: squared errors in variances are one on average.
    assert 0.7 < np.mean(ratios) < 1.5
    assert np.diag(estimate.covariance)[9:] == pytest.approx(100.0)
    assert np.diag(estimate.covariance)[3:6] == pytest.approx(0.0)


@pytest.mark.parametrize("points", [3, 4, 5])
def test_the_stretch_ends_before_the_bounce(rng, bounce, points) -> None:
    # The ball meets the floor between the last point of the stretch and the next one.
    fall = (points - 0.6) * STEP
    times = np.arange(0, 0.8, STEP)
    velocity = np.array([1.0, 0.0, -1.0])
    start = np.array([0, 0, RADIUS + fall + 0.5 * 9.81 * fall**2])
    errors = []
    for _ in range(20):
        estimate = state(record(rng, times, bounce(times, start, velocity, RADIUS)), 0.0)
        errors.append(estimate.linear_velocity - velocity)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.05


def test_a_ball_that_rolls_has_no_falling_state(rng) -> None:
    times = np.arange(0, 1.0, STEP)
    path = np.column_stack([0.8 * times, 0 * times, np.full(times.size, RADIUS)])
    estimate = state(record(rng, times, path), 0.0)
    assert estimate.linear_velocity == pytest.approx([0.8, 0, 0], abs=0.02)


def test_an_episode_is_cut_where_a_ball_appears(rng, bounce) -> None:
    early = np.arange(0, 1.5, STEP)
    late = early[early > 0.7]
    first = record(rng, early, bounce(early, (0, 0, 0.5), (0.8, 0, 1.0), RADIUS), "first")
    second = record(rng, late, bounce(late - late[0], (0, 1, 0.9), (1, 0, 0), RADIUS), "second")
    alone, together = observations_of([second, first], FLOOR, SETTINGS)
    assert [item.object.id for item in alone.objects] == ["first"]
    assert alone.objects[0].trajectory.times[-1] < late[0]
    assert {item.object.id for item in together.objects} == {"first", "second"}
    assert late[0] <= together.start_time < late[0] + 4 * STEP
    # All initial states hold at the start.
    for item in together.objects:
        assert item.initial_state.position == pytest.approx(item.trajectory.positions[0], abs=0.006)
        assert item.trajectory.times[0] == together.start_time


def test_what_hardly_moves_is_not_worth_an_observation(rng) -> None:
    times = np.arange(0, 2.0, STEP)
    still = np.tile([0.3, 0.2, RADIUS], (times.size, 1))
    assert observations_of([record(rng, times, still)], FLOOR, SETTINGS) == []
    short = np.column_stack([3.0 * times[:4], 0 * times[:4], np.ones(4)])
    assert observations_of([record(rng, times[:4], short)], FLOOR, SETTINGS) == []


def run(rng, paths, times, settings=SETTINGS) -> list[tuple[float, Observation]]:
    """Observations with the time at which they were closed."""
    tracker, recorder = Tracker(FLOOR, settings), EpisodeRecorder(FLOOR, settings)
    closed = []
    for k, time in enumerate(times):
        spheres = [
            seen_sphere(rng, path[k], RADIUS) for path in paths if np.isfinite(path[k]).all()
        ]
        ended = tracker.update(float(time), spheres)
        for episode in recorder.update(float(time), tracker.tracks, ended):
            closed += [(time, found) for found in episode.observations()]
    return closed


def test_an_observation_is_closed_when_the_ball_leaves(rng, bounce) -> None:
    times = np.arange(0, 2.0, STEP)
    path = bounce(times, (0, 0, 0.5), (1.0, 0, 1.0), RADIUS)
    path[times > 1.0] = np.nan
    ((closed, observation),) = run(rng, [path], times)
    assert closed == pytest.approx(1.0 + COAST_TIME, abs=2 * STEP)
    assert observation.start_time == 0.0
    assert len(observation.objects[0].trajectory) == int((times <= 1.0).sum())


def test_an_observation_is_closed_when_the_ball_rests(rng, bounce) -> None:
    times = np.arange(0, 4.0, STEP)
    path = bounce(times, (0, 0, 0.4), (0.5, 0, 0.0), RADIUS, 0.3)
    path[times > 1.5] = path[times > 1.5][0]
    ((closed, observation),) = run(rng, [path], times)
    assert 1.5 < closed < 1.5 + 2 * SETTINGS.rest_time
    assert observation.objects[0].object.id == "sphere_1"


def test_an_observation_is_closed_when_time_is_out(rng, bounce) -> None:
    times = np.arange(0, 2.5, STEP)
    path = bounce(times, (0, 0, 0.5), (0.5, 0, 0.0), RADIUS, 1.0)
    settings = replace(SETTINGS, max_duration=1.0)
    closed = run(rng, [path], times, settings)
    assert [time for time, _ in closed] == pytest.approx([1.0, 2.0], abs=2 * STEP)
    first, second = (found.objects[0].trajectory for _, found in closed)
    assert first.times[-1] <= second.times[0]


def test_a_ball_on_a_chair_has_states_but_no_observation(rng) -> None:
    times = np.arange(0, 3.0, STEP)
    assert run(rng, [np.tile([0.3, 0.2, 0.5], (times.size, 1))], times) == []


@pytest.mark.parametrize("deviation", [0.1, 0.2])
def test_what_may_be_anywhere_touches_nothing(rng, deviation) -> None:
    """A part of an arm a hand's breadth over the floor, of which one frame shows only that it is
    somewhere along the arm, moves uniformly; that is no rolling."""
    times = STEP * np.arange(4)
    path = [0.0, 0.0, 0.25] + np.outer(times, [0.3, 1.0, 0.0])
    noise = np.tile(NOISE**2 * np.eye(3), (len(path), 1, 1))
    noise[0] = np.diag([NOISE**2, NOISE**2, deviation**2])
    held = seen_record(rng, times, path, noise)
    held.positions[0] = path[0]
    assert FreeMotion(held, FLOOR).stretch_at(0.1) is None
