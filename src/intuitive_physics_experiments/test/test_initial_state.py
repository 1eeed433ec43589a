from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.flight_fits import (
    UNKNOWN_SPIN,
    fit_initial_state,
)

GRAVITY = np.array([0.0, 0.0, -9.81])
coordinate = st.floats(-5.0, 5.0)
vector = st.tuples(coordinate, coordinate, coordinate).map(np.array)


def flight(position: np.ndarray, velocity: np.ndarray, times: Any) -> np.ndarray:
    t = np.asarray(times)[:, None]
    return position + velocity * t + 0.5 * GRAVITY * t**2


@given(position=vector, velocity=vector, count=st.integers(2, 60), start=st.floats(0.0, 100.0))
def test_an_exact_flight_is_found_exactly(position, velocity, count, start):
    times = np.arange(count) * 0.01
    state = fit_initial_state(times + start, flight(position, velocity, times), GRAVITY)
    assert state.position == pytest.approx(position, abs=1e-6)
    assert state.linear_velocity == pytest.approx(velocity, abs=1e-5)


def test_the_covariance_is_that_of_the_errors():
    # Over many flights with known noise, squared errors have the mean that the covariance says.
    rng = np.random.default_rng(0)
    times = np.arange(30) / 180.0
    position, velocity = np.array([0.1, -0.2, 1.0]), np.array([4.0, 0.2, 2.0])
    scaled = []
    for _ in range(400):
        noisy = flight(position, velocity, times) + rng.normal(0.0, 0.003, (30, 3))
        state = fit_initial_state(times, noisy, GRAVITY)
        error = np.concatenate([state.position - position, state.linear_velocity - velocity])
        scaled.append(error**2 / np.diag(state.covariance)[[0, 1, 2, 6, 7, 8]])
    assert np.mean(scaled) == pytest.approx(1.0, abs=0.25)


def test_what_the_model_lacks_widens_the_covariance():
    # Air drag bends a flight; its residuals go together and must count for more than white ones.
    rng = np.random.default_rng(0)
    times = np.arange(90) / 180.0
    white = flight(np.zeros(3), np.array([4.0, 0.0, 2.0]), times)
    noise = rng.normal(0.0, 0.002, white.shape)
    bent = white + np.array([-0.7, 0.0, 0.0]) * times[:, None] ** 2
    deviations = [
        np.sqrt(fit_initial_state(times, x + noise, GRAVITY).covariance[6, 6])
        for x in (white, bent)
    ]
    assert deviations[1] > 5.0 * deviations[0]


def test_spin_is_unknown():
    state = fit_initial_state(
        [0.0, 0.1, 0.2], flight(np.zeros(3), np.ones(3), [0, 0.1, 0.2]), GRAVITY
    )
    assert not state.angular_velocity.any()
    assert np.diag(state.covariance)[9:] == pytest.approx(UNKNOWN_SPIN**2)


@pytest.mark.parametrize(
    ("times", "positions"),
    [
        ([0.0], np.zeros((1, 3))),
        ([0.0, 0.0], np.zeros((2, 3))),
        ([0.0, 1.0], np.full((2, 3), np.nan)),
    ],
)
def test_bad_points_are_refused(times, positions):
    with pytest.raises(InvalidInputError):
        fit_initial_state(times, positions, GRAVITY)
