"""What supports objects where a wall is larger, and what flights tell where nothing does."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.environment.gravity import FlightGravity, degrees_between
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.motion_fits import SeenPath

SETTINGS = PerceptionSettings(environment_frames=4)
GRAVITY = np.array([0.0, 0.0, -9.81])
STEP = 1.0 / 30.0


def frames_of(room, count, balls=(), extra=()):
    return [room.points(balls, extra) for _ in range(count)]


@pytest.mark.parametrize("height", [0.7, 0.9])
def test_a_wall_is_no_support_where_a_floor_is_seen(make_small_room, height) -> None:
    """A level camera 2 m before a wall: the wall fills most of the image."""
    room = make_small_room(tilt=0.0, height=height, walls=[((-1.0, 0.0, 0.0), -2.5)])
    frames = frames_of(room, 4)
    model = model_environment(frames, SETTINGS, np.random.default_rng(0))
    assert len(model.detected) == 2
    assert model.detected[0].support < model.detected[1].support
    assert degrees_between(model.rotation @ room.rotation.T @ [0, 0, 1], [0, 0, 1]) < 1.0
    assert model.translation[2] == pytest.approx(height, abs=0.01)
    assert not model.gravity_doubt
    largest = replace(SETTINGS, camera_upright=False)
    wall_first = model_environment(frames, largest, np.random.default_rng(0))
    assert degrees_between(wall_first.detected[0].normal, [0, 0, -1]) < 1.0


def test_a_camera_that_looks_down_has_its_floor_and_says_that_it_may_be_a_wall(
    make_small_room,
) -> None:
    room = make_small_room(tilt=85.0, height=1.2, walls=[])
    model = model_environment(frames_of(room, 4), SETTINGS, np.random.default_rng(0))
    assert degrees_between(model.rotation @ room.rotation.T @ [0, 0, 1], [0, 0, 1]) < 1.0
    assert "if it is a wall" in model.gravity_doubt


def play(pipeline, room, seconds, start, ball=None, extra=()):
    results = []
    for k in range(round(seconds / STEP)):
        balls = [] if ball is None else [ball(k * STEP)]
        (points,) = frames_of(room, 1, balls, extra)
        results.append(pipeline.process(points, start + k * STEP))
    return results


def throw(start, velocity):
    def at(time):
        return np.array(start) + time * np.array(velocity) + 0.5 * time**2 * GRAVITY, 0.06

    return at


@pytest.mark.parametrize("tilt", [-20.0, -30.0], ids=["before a wall", "before a globe"])
def test_flights_tell_gravity_where_no_floor_is_seen(
    make_small_room, shapes, tilt, pipeline
) -> None:
    """A camera that looks up sees no floor. After two throws states are those of flight."""
    walls = [((-1.0, 0.0, 0.0), -3.2)] if tilt == -20.0 else []
    globe = [] if walls else [shapes["ball"]((3.0, 1.2, 2.3), 0.6)]
    room = make_small_room(tilt=tilt, height=0.8, walls=walls)
    watch = partial(play, pipeline, room, extra=globe)
    first = watch(0.4, 0.0)[-1].model
    assert first is not None
    assert len(first.detected) == len(walls)
    assert first.gravity_doubt
    up = room.rotation.T @ [0.0, 0.0, 1.0]
    thrown = throw((1.8, -0.6, 1.1), (0.3, 1.4, 2.5))
    reasons = []
    for n in range(3):
        reasons += [result.moved for result in watch(0.7, 1.0 + 2 * n, thrown) if result.moved]
        reasons += [result.moved for result in watch(0.9, 1.7 + 2 * n) if result.moved]
    assert len(reasons) == 1
    assert "gravity" in reasons[0]
    assert pipeline.model is not None
    assert degrees_between(pipeline.model.rotation[2], up) < 2.0
    assert not pipeline.model.gravity_doubt
    last = watch(0.5, 8.0, thrown)[-1]
    (result,) = last.objects
    velocity = np.array([0.3, 1.4, 2.5]) + (0.5 - STEP) * GRAVITY
    expected = pipeline.model.rotation @ room.rotation.T @ velocity
    deviation = np.sqrt(np.diag(result.state.covariance)[6:9])
    assert np.abs(result.state.linear_velocity - expected).max() < max(4.0 * deviation.max(), 0.1)


def motion(rng, duration: float, rate: float, acceleration, noise: float = 0.002) -> SeenPath:
    """p = v t + ½ a t² with a random velocity, read with some noise, m."""
    times = np.arange(0.0, duration, 1.0 / rate)
    places = np.outer(times, rng.normal(size=3)) + np.outer(0.5 * times**2, acceleration)
    places += noise * rng.normal(size=places.shape)
    return SeenPath(times, places, np.tile(noise**2 * np.eye(3), (len(times), 1, 1)))


directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(directions, st.integers(0, 1000), st.sampled_from([15.0, 30.0, 90.0]))
def test_flights_in_any_direction_tell_it_within_their_deviation(direction, seed, rate) -> None:
    """Five flights."""
    rng = np.random.default_rng(seed)
    up = np.array(direction) / np.linalg.norm(direction)
    flights = FlightGravity(9.81)
    for _ in range(5):
        flights.take(motion(rng, 0.5, rate, -9.81 * up))
    estimate = flights.up()
    assert estimate is not None
    # Five deviations: one in a million examples is beyond.
    assert degrees_between(estimate[0], up) < 5.0 * estimate[1] * np.sqrt(2.0)


def test_the_newest_flights_count() -> None:
    # A thousand that agreed are outvoted by thirty that do, and take no time any more.
    rng = np.random.default_rng(0)
    flights = FlightGravity(9.81)
    for direction, count in (((0.0, 0.0, 1.0), 1000), ((0.0, 0.6, 0.8), 30)):
        up = np.array(direction)
        for _ in range(count):
            flights.take(motion(rng, 0.5, 30.0, -9.81 * up))
        estimate = flights.up()
        assert estimate is not None
        assert degrees_between(estimate[0], up) < 5.0 * estimate[1] * np.sqrt(2.0)


@given(st.integers(0, 1000), st.floats(0.0, 6.0))
def test_what_does_not_fall_tells_nothing(seed, acceleration) -> None:
    """Rolling, sliding and being carried: constant accelerations below gravity's."""
    rng = np.random.default_rng(seed)
    flights = FlightGravity(9.81)
    for _ in range(5):
        direction = rng.normal(size=3)
        direction *= acceleration / np.linalg.norm(direction)
        flights.take(motion(rng, 1.0, 30.0, direction, noise=0.001))
    assert flights.up() is None
