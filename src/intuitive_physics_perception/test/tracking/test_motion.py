"""Prediction obeys the laws of flight, support and impact."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics_perception.tracking.motion import (
    BOUNCE_RESTITUTION,
    SIZE,
    Prediction,
    predicted,
)

from ..conftest import FLOOR

CORNER = Environment([*FLOOR.planes, Plane("wall", "m", (-1, 0, 0), -1.0)])
TABLE = Plane(
    "table", "m", (0, 0, 1), 0.7, [(-1, -1, 0.7), (1, -1, 0.7), (1, 1, 0.7), (-1, 1, 0.7)]
)
TABLE_AND_FLOOR = Environment([TABLE, *FLOOR.planes])
RADIUS = 0.05
COVARIANCE = np.diag([1e-6] * 3 + [1e-2] * 3 + [1e-8])


def ball(position, velocity):
    return np.array([*position, *velocity, RADIUS])


def predict(mean, duration, environment=FLOOR, *, noise=0.0, covariance=COVARIANCE, **more):
    return predicted(mean, covariance, duration, environment, acceleration_noise=noise, **more)


def test_flight_is_a_parabola() -> None:
    # x = x₀ + v t + g t² / 2
    found = predict(ball((0, 0, 1), (1, -2, 0.5)), 0.2)
    assert found.mean[:3] == pytest.approx([0.2, -0.4, 1 + 0.1 - 0.5 * 9.81 * 0.04])
    assert found.mean[3:6] == pytest.approx([1, -2, 0.5 - 9.81 * 0.2])
    # Var(x + v t) = Var(x) + t² Var(v)
    assert np.diag(found.covariance)[:3] == pytest.approx(1e-6 + 0.04 * 1e-2)


def test_a_dropped_ball_comes_back_to_e_squared_of_its_height() -> None:
    height, e = 0.8, BOUNCE_RESTITUTION
    fall = np.sqrt(2 * height / 9.81)
    up = e * np.sqrt(2 * 9.81 * height) / 9.81
    found = predict(ball((0, 0, RADIUS + height), (0, 0, 0)), fall + up)
    assert found.mean[2] == pytest.approx(RADIUS + e**2 * height)
    assert found.mean[5] == pytest.approx(0.0, abs=1e-9)
    # What an impact does to the velocity is in doubt.
    assert found.covariance[5, 5] > COVARIANCE[5, 5]


def test_a_wall_turns_the_normal_velocity_only() -> None:
    mean = predict(ball((0.9, 0, 1), (2.0, 1.0, 0.0)), 0.05, CORNER).mean
    # It meets the wall after 0.05 m at 2 m/s and goes back at a part of the speed.
    back = BOUNCE_RESTITUTION * 2.0
    assert mean[0] == pytest.approx(0.95 - back * 0.025)
    assert mean[3:5] == pytest.approx([-back, 1.0])


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_ball_rolls_on_a_box_and_falls_beyond_its_edge(turn) -> None:
    axis = np.array([np.cos(turn), np.sin(turn), 0.0])
    turned = (0.0, 0.0, np.sin(turn / 2.0), np.cos(turn / 2.0))
    box = StaticBox("box", "m", (0, 0, 0.2), turned, (1.0, 0.6, 0.4))
    world = Environment(FLOOR.planes, [box])
    on = predict(ball([*(0.1 * axis[:2]), 0.4 + RADIUS], 0.8 * axis), 0.25, world).mean
    assert on[:3] == pytest.approx([*(0.3 * axis[:2]), 0.4 + RADIUS])
    assert on[3:6] == pytest.approx(0.8 * axis)
    # The centre is beyond the edge after 0.1 s, then it falls freely for 0.1 s.
    off = predict(ball([*(0.42 * axis[:2]), 0.4 + RADIUS], 0.8 * axis), 0.2, world).mean
    assert off[:3] == pytest.approx([*(0.58 * axis[:2]), 0.4 + RADIUS - 0.5 * 9.81 * 0.01])
    assert off[5] == pytest.approx(-9.81 * 0.1)
    # The side turns it back.
    hit = predict(ball([*(-0.65 * axis[:2]), 0.2], 2.0 * axis), 0.1, world).mean
    assert hit[3:5] @ axis[:2] == pytest.approx(-2.0 * BOUNCE_RESTITUTION)


@pytest.mark.parametrize("degrees", [0.0, 2.0, 8.0, 15.0, 30.0])
def test_down_a_ramp_a_ball_gains_what_rolling_leaves_of_gravity(degrees) -> None:
    # a = g sin α / (1 + κ) of what rolls, g sin α of what slides.
    angle = np.radians(degrees)
    normal, down = [np.sin(angle), 0, np.cos(angle)], np.array([np.cos(angle), 0, -np.sin(angle)])
    ramp = Environment([Plane("ramp", "m", normal, 0.0)])
    start = RADIUS * np.array(normal)
    for rolls, kappa in ((True, 0.4), (False, 0.0)):
        found = predict(ball(start, 0.3 * down), 0.4, ramp, rolls=rolls).mean
        gain = 9.81 * np.sin(angle) / (1.0 + kappa)
        assert found[:3] == pytest.approx(start + (0.3 * 0.4 + 0.5 * gain * 0.16) * down)
        assert found[3:6] == pytest.approx((0.3 + 0.4 * gain) * down)


def test_a_ball_flies_past_a_table_and_bounces_below_it() -> None:
    past = predict(ball((0.95, 0, 0.8), (5, 0, -1)), 0.1, TABLE_AND_FLOOR).mean
    assert past[5] == pytest.approx(-1 - 9.81 * 0.1)
    below = predict(ball((0, 0, 0.3), (0, 0, -1)), 0.1, TABLE_AND_FLOOR).mean
    assert below[5] == pytest.approx(-1 - 9.81 * 0.1)


def test_an_unknown_acceleration_widens_the_covariance() -> None:
    # White noise: ∫ (T - t)² q dt of the place, with q of a constant acceleration over 1/30 s.
    covariance = predict(ball((0, 0, 1), (0, 0, 0)), 0.1, noise=2.0).covariance
    assert covariance[0, 0] == pytest.approx(1e-6 + 1e-4 + 2.0**2 / 30 * 0.1**3 / 3)
    assert covariance[3, 3] == pytest.approx(1e-2 + 2.0**2 / 30 * 0.1)


@pytest.mark.parametrize("steps", [2, 3, 6])
def test_short_steps_add_up_to_a_long_one(steps) -> None:
    """What is known of a ball does not depend on how often it is looked at."""
    start = ball((0, 0, 3), (1, -2, 0.5))
    whole = predict(start, 0.1, noise=2.0)
    part = Prediction(start, COVARIANCE, np.eye(SIZE))
    for _ in range(steps):
        part = predict(part.mean, 0.1 / steps, noise=2.0, covariance=part.covariance)
    assert part.mean == pytest.approx(whole.mean)
    assert part.covariance == pytest.approx(whole.covariance, abs=1e-12)


@given(
    st.lists(st.floats(-2, 2), min_size=3, max_size=3),
    st.lists(st.floats(-10, 10), min_size=3, max_size=3),
    st.floats(0, 2),
)
def test_any_prediction_is_finite_and_its_covariance_positive(position, velocity, duration) -> None:
    found = predict(ball(position, velocity), duration, CORNER, noise=1.0)
    mean = found.mean
    assert mean.shape == (SIZE,)
    assert np.isfinite(mean).all()
    assert np.linalg.eigvalsh(found.covariance)[0] > -1e-9
    if position[2] > RADIUS:
        # Energy never grows: e < 1, and gravity does the work it does.
        before = 0.5 * np.dot(velocity, velocity) + 9.81 * position[2]
        after = 0.5 * mean[3:6] @ mean[3:6] + 9.81 * mean[2]
        assert after <= before + 1e-6


def test_the_transition_is_the_derivative_of_the_prediction() -> None:
    # In flight it is exact.
    start, step = ball((0.9, 0, 0.3), (2.0, 0.5, -1.0)), 1e-6
    first = predict(start, 0.02)
    for k in range(SIZE - 1):
        other = predict(start + step * np.eye(SIZE)[k], 0.02)
        assert (other.mean - first.mean) / step == pytest.approx(first.transition[:, k], abs=1e-6)
