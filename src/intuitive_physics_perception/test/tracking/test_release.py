"""Observations begin when a hand lets a ball go, at any frame rate: simulated detections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import observations_of
from intuitive_physics_perception.tracking.free_motion import SURE_EVIDENCE, FreeMotion
from intuitive_physics_perception.tracking.motion_fits import (
    CONTACT_GATE,
    HAND_ACCELERATION,
    SeenPath,
    free_evidence,
    noise_factor,
    shows_acceleration,
    spoilt_points,
)

from ..conftest import FLOOR, seen_record

UP = np.array([0.0, 0.0, 1.0])
SETTINGS = PerceptionSettings()
RADIUS = 0.05
IN_TIME = 0.034
"""s: one frame at 30 Hz."""


def errors_of_detection(count, noise, rng):
    """Covariances (count, 3, 3) as of a depth camera that looks along some line: three times as
    far off along it as across."""
    along = rng.normal(size=3)
    along /= np.linalg.norm(along)
    covariance = noise**2 * (np.eye(3) + 8.0 * np.outer(along, along)) / 3.0
    return np.tile(covariance, (count, 1, 1))


class Throw:
    """A ball at rest in a hand, swung along a polynomial of the fifth degree and let go."""

    def __init__(self, rng, *, rest=None) -> None:
        lasts = rng.uniform(0.18, 0.45)
        self.swing_start = rng.uniform(0.1, 0.6) if rest is None else rest
        self.release = self.swing_start + lasts
        self.velocity = np.append(rng.uniform(-1.5, 1.5, size=2), rng.uniform(0.5, 2.0))
        acceleration = rng.uniform(0.0, 1.5) / lasts * self.velocity + rng.normal(0, 2.0, size=3)
        way = rng.uniform(0.3, 0.6) * lasts * self.velocity
        ends = np.array([[1.0, 1, 1], [3, 4, 5], [6, 12, 20]])
        wanted = np.stack([way, self.velocity * lasts, acceleration * lasts**2])
        self._coefficients = np.linalg.solve(ends, wanted)
        self._start = np.array([0.0, 0.0, 0.9]) - way
        self.meets_floor = (
            self.velocity[2] + np.sqrt(self.velocity[2] ** 2 + 2 * 9.81 * (0.9 - RADIUS))
        ) / 9.81

    def places(self, times):
        swung = np.clip((times - self.swing_start) / (self.release - self.swing_start), 0, 1)
        held = self._start + np.stack([swung**3, swung**4, swung**5], axis=1) @ self._coefficients
        since = np.maximum(times - self.release, 0.0)[:, None]
        return held + since * self.velocity + 0.5 * since**2 * FLOOR.gravity


def observation_of(throw, rate, noise, rng, flight=0.45):
    """The observation of a throw, whose frames have a random phase; None where there is none."""
    times = np.arange(rng.random() / rate, throw.release + flight, 1.0 / rate)
    ball = seen_record(rng, times, throw.places(times), errors_of_detection(len(times), noise, rng))
    observations = observations_of([ball], FLOOR, SETTINGS)
    return observations[0] if observations else None


@pytest.mark.parametrize("rate", [30, 60, 90])
@pytest.mark.parametrize("noise", [0.001, 0.003])
def test_observations_begin_at_the_release_at_every_frame_rate(rate, noise) -> None:
    rng = np.random.default_rng([rate, round(1e6 * noise)])
    errors = []
    for _ in range(40):
        throw = Throw(rng)
        errors.append(observation_of(throw, rate, noise, rng).start_time - throw.release)
    # 95 % within a frame at 30 Hz; of 40 draws 5 or more miss with a chance of 5 %.
    assert np.sum(np.abs(errors) > IN_TIME) <= 4, sorted(errors)
    assert np.abs(errors).max() < 3 * IN_TIME


@pytest.mark.parametrize("rate", [60, 90])
@pytest.mark.parametrize("after", [-1, 0])
def test_a_point_drawn_off_beside_the_hand_does_not_move_the_release(rate, after) -> None:
    """The last frame in the hand or the first after it shows the ball ten standard deviations off,
    as where hand and ball pass for one thing: a frame less, so a frame more until it is shown."""
    rng, errors = np.random.default_rng([rate, after + 1]), []
    for _ in range(40):
        throw, noise = Throw(rng), rng.uniform(0.0005, 0.0015)
        times = np.arange(rng.random() / rate, throw.release + 0.45, 1.0 / rate)
        seen = errors_of_detection(len(times), noise, rng)
        ball = seen_record(rng, times, throw.places(times), seen)
        k = int(np.searchsorted(times, throw.release)) + after
        off = rng.normal(size=3)
        ball.positions[k] += 10.0 * np.linalg.cholesky(seen[k]) @ off / np.linalg.norm(off)
        (observation, *_) = observations_of([ball], FLOOR, SETTINGS)
        errors.append(observation.start_time - throw.release)
    assert np.sum(np.abs(errors) > IN_TIME + 1.0 / rate) <= 4, sorted(errors)


def test_a_swing_a_release_and_a_bounce_spoil_no_point() -> None:
    """Noise alone passes for a spoilt point as often as the gate lets it."""
    rng, spoilt, total = np.random.default_rng(12), 0, 0
    for _ in range(150):
        throw, rate, noise = Throw(rng), rng.uniform(15.0, 90.0), rng.uniform(0.0003, 0.003)
        times = np.arange(0.0, throw.release + throw.meets_floor + 0.3, 1.0 / rate)
        places = throw.places(times)
        since = np.maximum(times - throw.release - throw.meets_floor, 0.0)
        kick = 1.7 * (9.81 * throw.meets_floor - throw.velocity[2])
        places[:, 2] += kick * since
        ball = seen_record(rng, times, places, errors_of_detection(len(times), noise, rng))
        found = spoilt_points(SeenPath(times, ball.positions, ball.covariances))
        spoilt += int(found.sum())
        total += len(times)
    expected = chi2.sf(CONTACT_GATE, 3) * total
    assert spoilt <= expected + 3.0 * np.sqrt(expected)


@pytest.mark.parametrize("count", [3, 5, 6, 9])
def test_one_point_far_off_is_spoilt_where_the_others_can_be_seen_to_agree(count) -> None:
    times = np.arange(count) / 60.0
    places = np.outer(times, [1.0, 2.0, 0.0]) + 0.5 * np.outer(times**2, FLOOR.gravity)
    places[2] += 0.05
    path = SeenPath(times, places, np.tile(0.001**2 * np.eye(3), (count, 1, 1)))
    assert np.flatnonzero(spoilt_points(path)).tolist() == ([2] if count > 5 else [])


@pytest.mark.parametrize("seed", range(10))
def test_scatter_about_the_edge_of_a_hand_is_never_free(seed) -> None:
    """What passes for a ball is found to and fro along a forearm, 10 cm and more from frame to
    frame; three points of 22 ms are then on a fall to the floor by chance."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 1.0, 1.0 / 90.0)
    places = np.array([0.0, 0.0, 0.32]) + np.outer(rng.uniform(-0.22, 0.22, times.size), UP)
    ball = seen_record(rng, times, places, errors_of_detection(len(times), 0.002, rng))
    free = FreeMotion(ball, FLOOR)
    assert all(free.stretch_at(float(time)) is None for time in times)


def test_more_frames_make_a_better_first_velocity() -> None:
    """The variance of least squares over the same time falls with the number of points: three times
    as many make the error 0.58 times as large; a tenth is left to the release's uncertainty."""
    rms = []
    for rate in (30, 90):
        rng = np.random.default_rng(5)
        squares = []
        for _ in range(40):
            throw = Throw(rng)
            observation = observation_of(throw, rate, 0.001, rng)
            since = max(observation.start_time - throw.release, 0.0)
            off = observation.objects[0].initial_state.linear_velocity - throw.velocity
            squares.append(np.sum((off - since * FLOOR.gravity) ** 2))
        rms.append(np.sqrt(np.median(squares)))
    assert rms[1] < 0.68 * rms[0]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate=st.floats(15.0, 90.0),
    noise=st.floats(0.0003, 0.003),
    rest=st.floats(0.05, 1.5),
)
def test_no_observation_begins_in_the_hand(seed, rate, noise, rest) -> None:
    """Whatever the rate and the noise: earlier than two frames or 60 ms, hand and flight differ by
    several millimetres and more."""
    rng = np.random.default_rng(seed)
    throw = Throw(rng, rest=rest)
    observation = observation_of(throw, rate, noise, rng)
    if observation is not None:
        assert observation.start_time - throw.release > -max(2.0 / rate, 0.06)
        assert observation.start_time - throw.release < max(3.0 / rate, 0.1)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rate=st.floats(15.0, 90.0), noise=st.floats(0.0003, 0.003))
def test_what_a_hand_holds_all_the_time_is_never_free(seed, rate, noise) -> None:
    """A hand that swings to and fro, down at half of gravity at most."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, 2.0, 1.0 / rate)
    frequency, phase = rng.uniform(2.0, 8.0, size=3), rng.uniform(0.0, 6.3, size=3)
    reach = rng.uniform(0.0, 5.0, size=3) / frequency**2
    places = np.array([0, 0, 1.2]) + reach * np.sin(np.outer(times, frequency) + phase)
    ball = seen_record(rng, times, places, errors_of_detection(len(times), noise, rng))
    free = FreeMotion(ball, FLOOR)
    assert all(free.stretch_at(float(time)) is None for time in times)


def test_a_ball_that_comes_into_view_in_flight_is_free_from_its_first_frames() -> None:
    """All points but those at which noise passes for a contact, as often as the gate lets it: it
    then leaves out the point before."""
    rng, missing, total = np.random.default_rng(9), 0, 0
    for _ in range(250):
        rate, noise = rng.uniform(15.0, 90.0), rng.uniform(0.0003, 0.003)
        times = np.arange(0.0, rng.uniform(0.25, 0.8), 1.0 / rate)
        velocity = rng.uniform(-2.0, 2.0, size=3)
        places = [0, 0, 6.0] + np.outer(times, velocity) + 0.5 * np.outer(times**2, FLOOR.gravity)
        ball = seen_record(rng, times, places, errors_of_detection(len(times), noise, rng))
        free = FreeMotion(ball, FLOOR)
        later = [time for time in times[:-2] if time > 0.034 + 2.0 / rate]
        missing += sum(free.stretch_at(float(time)) is None for time in later)
        total += len(later)
    expected = chi2.sf(CONTACT_GATE, 3) * total
    assert missing <= expected + 3.0 * np.sqrt(expected)


def test_a_bias_that_all_frames_share_is_in_the_position_and_not_in_the_velocity() -> None:
    rng, times = np.random.default_rng(4), np.arange(0.0, 0.3, 1.0 / 60.0)
    places = [0, 0, 3.0] + 0.5 * np.outer(times**2, FLOOR.gravity)
    ball = seen_record(rng, times, places, errors_of_detection(len(times), 0.001, rng))
    biased = replace(ball, bias=np.diag([1e-4, 4e-4, 9e-4]))
    without, with_it = (FreeMotion(b, FLOOR).stretch_at(0.0).covariance for b in (ball, biased))
    assert with_it[:3, :3] - without[:3, :3] == pytest.approx(biased.bias)
    assert with_it[3:, 3:] == pytest.approx(without[3:, 3:])


def test_points_that_cannot_tell_gravity_from_none_are_no_evidence() -> None:
    """Three points of a ball at rest fit gravity where noise is large, and are evidence of nothing;
    the longer it lies still, the clearer it does not fall."""
    rng, evidence = np.random.default_rng(6), []
    for count in (3, 6, 12, 24):
        times = np.arange(count) / 90.0
        errors = errors_of_detection(count, 0.002, rng)
        ball = seen_record(rng, times, np.zeros((count, 3)), errors)
        evidence.append(free_evidence(SeenPath(times, ball.positions, errors), FLOOR.gravity))
    assert evidence[0] < 2.0
    assert evidence[-1] < -50.0
    assert evidence[-1] < evidence[-2] < evidence[0]
    fallen = seen_record(rng, times, 0.5 * np.outer(times**2, FLOOR.gravity), errors)
    assert free_evidence(SeenPath(times, fallen.positions, errors), FLOOR.gravity) > SURE_EVIDENCE


@given(rate=st.floats(15.0, 120.0), noise=st.floats(0.0003, 0.02), count=st.integers(3, 20))
def test_points_show_an_acceleration_where_its_error_is_less_than_a_hand_gives(
    rate, noise, count
) -> None:
    """Least squares has it to σ / |q|, with q what is left of t² / 2 by a straight line."""
    times = np.arange(count) / rate
    errors = np.tile(noise**2 * np.eye(3), (count, 1, 1))
    path = SeenPath(times, np.zeros((count, 3)), errors)
    quadratic = 0.5 * (times - times.mean()) ** 2
    deviation = noise / np.linalg.norm(quadratic - quadratic.mean())
    assert shows_acceleration(path) == (deviation < HAND_ACCELERATION)


@pytest.mark.parametrize("rate", [30, 90])
@pytest.mark.parametrize("factor", [1.0, 4.0])
def test_the_noise_is_measured_whatever_the_covariances_say(rate, factor) -> None:
    rng = np.random.default_rng(8)
    throw = Throw(rng)
    times = np.arange(0.0, throw.release + 0.4, 1.0 / rate)
    errors = errors_of_detection(len(times), 0.001, rng)
    ball = seen_record(rng, times, throw.places(times), factor * errors)
    estimate = noise_factor(SeenPath(times, ball.positions, errors))
    assert estimate == pytest.approx(factor, rel=0.6)
