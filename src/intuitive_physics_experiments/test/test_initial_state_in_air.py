from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.flight_fits import (
    LIKELY_SPIN,
    AirFactors,
    fit_initial_state,
    fit_initial_state_in_air,
)

GRAVITY = np.array([0.0, 0.0, -9.81])
TIMES = np.arange(90) / 180.0
# A table-tennis ball: ½ ρ C A / m = 0.13 1/m, ½ ρ A r C_M / m = 0.0056.
DRAG, MAGNUS = 0.13, 0.0056
component = st.floats(-5.0, 5.0)
vector = st.tuples(component, component, component).map(np.array)


def flight(position: Any, velocity: Any, spin: Any, drag: float, magnus: float) -> np.ndarray:
    """Positions at `TIMES` under a = g - drag |v| v + magnus ω × v."""

    def change(_: float, state: np.ndarray) -> np.ndarray:
        v = state[3:]
        by_air = -drag * np.linalg.norm(v) * v + magnus * np.cross(spin, v)
        return np.concatenate([v, GRAVITY + by_air])

    start = np.concatenate([position, velocity])
    return solve_ivp(change, (0.0, 0.5), start, t_eval=TIMES, rtol=1e-10, atol=1e-12).y[:3].T


@settings(max_examples=20)
@given(position=vector, velocity=vector)
def test_a_flight_with_drag_is_found(position, velocity):
    seen = flight(position, velocity, np.zeros(3), DRAG, 0.0)
    state = fit_initial_state_in_air(TIMES, seen, GRAVITY, AirFactors(DRAG, 0.0))
    # An acceleration linear between points leaves h² a'' T² / 24, a'' below 400 m/s⁴: 0.15 mm.
    assert state.position == pytest.approx(position, abs=2e-4)
    assert state.linear_velocity == pytest.approx(velocity, abs=2e-3)
    assert not state.angular_velocity.any()
    assert np.diag(state.covariance)[9:] == pytest.approx(LIKELY_SPIN**2)


@settings(max_examples=20)
@given(position=vector, spin=vector.map(lambda v: 12.0 * v))
def test_spin_across_the_flight_is_found(position, spin):
    velocity = np.array([5.0, 0.0, 1.0])
    seen = flight(position, velocity, spin, DRAG, MAGNUS)
    state = fit_initial_state_in_air(TIMES, seen, GRAVITY, AirFactors(DRAG, MAGNUS))
    assert state.linear_velocity == pytest.approx(velocity, abs=0.05)
    # The velocity turns in the plane y = 0, so ω_y is across it all the time; the covariance says
    # how well it is known, which for points without noise is far better than so.
    deviation = np.sqrt(state.covariance[10, 10])
    assert deviation < 0.1 * LIKELY_SPIN
    assert abs(state.angular_velocity[1] - spin[1]) < 2.0 * deviation


@given(position=vector, velocity=vector)
def test_without_air_it_is_the_other_fit(position, velocity):
    noise = np.random.default_rng(0).normal(0.0, 0.002, (90, 3))
    seen = flight(position, velocity, np.zeros(3), 0.0, 0.0) + noise
    plain = fit_initial_state(TIMES, seen, GRAVITY)
    state = fit_initial_state_in_air(TIMES, seen, GRAVITY, AirFactors(0.0, 0.0))
    assert state.position == pytest.approx(plain.position, abs=1e-9)
    assert state.linear_velocity == pytest.approx(plain.linear_velocity, abs=1e-9)
    # One divides by n - 2 and the other, which fits a spin too, by n - 3.
    known = slice(0, 9)
    assert np.diag(state.covariance)[known] == pytest.approx(
        np.diag(plain.covariance)[known], rel=0.05
    )


@pytest.mark.parametrize(
    ("times", "positions", "drag", "message"),
    [
        ([0.0, 0.1], np.zeros((2, 3)), 0.1, "at least 3"),
        ([0.0, 0.0, 0.1], np.zeros((3, 3)), 0.1, "strictly increase"),
        ([0.0, 0.1, 0.2], np.full((3, 3), np.inf), 0.1, "not finite"),
        (TIMES, np.outer(TIMES, [40.0, 0.0, 0.0]), 3.0, "does not converge"),
        ([0.0, 0.1, 0.2], np.zeros((3, 3)), -0.1, "drag factor"),
    ],
)
def test_what_cannot_be_fitted_is_refused(times, positions, drag, message):
    with pytest.raises(InvalidInputError, match=message):
        fit_initial_state_in_air(times, positions, GRAVITY, AirFactors(drag, 0.0))
