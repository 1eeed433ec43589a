"""Initial states fitted to free flights: exact ones are found, errors are as large as stated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.flight_fits import (
    LIKELY_SPIN,
    UNKNOWN_SPIN,
    AirFactors,
    fit_initial_state,
    fit_initial_state_in_air,
    fit_noisy_flight,
    flight_length,
)

GRAVITY = np.array([0.0, 0.0, -9.81])
MOTION = [0, 1, 2, 6, 7, 8]  # position and velocity in a state's covariance
TIMES = np.arange(10) / 30.0
FINE_TIMES = np.arange(90) / 180.0
# Of a table-tennis ball: ½ ρ C A / m = 0.13 1/m, ½ ρ A r C_M / m = 0.0056
DRAG, MAGNUS = 0.13, 0.0056
vectors = st.tuples(*[st.floats(-5.0, 5.0)] * 3).map(np.array)


def flight(position, velocity, times) -> np.ndarray:
    t = np.asarray(times)[:, None]
    return position + velocity * t + 0.5 * GRAVITY * t**2


def flight_in_air(position, velocity, spin, drag: float, magnus: float) -> np.ndarray:
    """Positions at `FINE_TIMES` under a = g - drag |v| v + magnus ω × v."""

    def change(_: float, state: np.ndarray) -> np.ndarray:
        v = state[3:]
        by_air = -drag * np.linalg.norm(v) * v + magnus * np.cross(spin, v)
        return np.concatenate([v, GRAVITY + by_air])

    start = np.concatenate([position, velocity])
    return solve_ivp(change, (0.0, 0.5), start, t_eval=FINE_TIMES, rtol=1e-10, atol=1e-12).y[:3].T


POSITION, VELOCITY = np.array([0.1, -0.2, 1.0]), np.array([1.0, 0.5, 2.0])
FLIGHT = flight(POSITION, VELOCITY, TIMES)


def test_squared_errors_have_the_mean_that_the_covariance_of_known_noise_says():
    # Points err differently in each direction, and by more and more.
    rng = np.random.default_rng(0)
    roots = 0.002 * rng.standard_normal((len(TIMES), 3, 3)) * (1.0 + TIMES)[:, None, None]
    noise = roots @ roots.swapaxes(1, 2) + 1e-8 * np.eye(3)
    roots = np.linalg.cholesky(noise)
    squares = []
    for _ in range(500):
        points = FLIGHT + np.einsum("nij,nj->ni", roots, rng.standard_normal((len(TIMES), 3)))
        position, velocity, covariance = fit_noisy_flight(TIMES, points, GRAVITY, noise)
        error = np.concatenate([position - POSITION, velocity - VELOCITY])
        squares.append(error @ np.linalg.solve(covariance[np.ix_(MOTION, MOTION)], error))
    # χ² of 6 has the variance 12: the mean of 500 is off by 0.15, five of which are allowed.
    assert np.mean(squares) == pytest.approx(6.0, abs=0.8)


@given(seed=st.integers(0, 2**32), deviation=st.floats(1e-4, 1.0))
def test_one_deviation_is_the_same_as_equal_covariances(seed, deviation):
    points = FLIGHT + deviation * np.random.default_rng(seed).standard_normal(FLIGHT.shape)
    alike = np.broadcast_to(deviation**2 * np.eye(3), (len(TIMES), 3, 3))
    by_deviation, by_covariance = (
        fit_noisy_flight(TIMES, points, GRAVITY, noise) for noise in (deviation, alike)
    )
    for a, b in zip(by_deviation, by_covariance, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)
    lengths = [flight_length(TIMES, points, GRAVITY, noise) for noise in (deviation, alike)]
    assert lengths[0] == lengths[1]


def test_a_surprise_is_judged_by_the_covariance_of_its_point():
    # 10 mm off along x at point 6: much for 1 mm of noise there, nothing for 20 mm.
    points = FLIGHT.copy()
    points[6:, 0] += 0.01
    precise = np.broadcast_to(1e-6 * np.eye(3), (len(TIMES), 3, 3)).copy()
    vague = precise.copy()
    vague[:, 0, 0] = 0.02**2
    assert flight_length(TIMES, points, GRAVITY, precise) == 5
    assert flight_length(TIMES, points, GRAVITY, vague) == len(TIMES)


@pytest.mark.parametrize("noise", [0.0, -1.0, np.nan, np.zeros((2, 3, 3)), -np.eye(3)])
def test_noise_that_is_none_is_refused(noise):
    with pytest.raises(InvalidInputError):
        fit_noisy_flight(TIMES, FLIGHT, GRAVITY, noise)


@given(position=vectors, velocity=vectors, count=st.integers(2, 60), start=st.floats(0.0, 100.0))
def test_an_exact_flight_is_found_exactly_without_its_spin(position, velocity, count, start):
    times = np.arange(count) * 0.01
    state = fit_initial_state(times + start, flight(position, velocity, times), GRAVITY)
    assert state.position == pytest.approx(position, abs=1e-6)
    assert state.linear_velocity == pytest.approx(velocity, abs=1e-5)
    assert not state.angular_velocity.any()
    assert np.diag(state.covariance)[9:] == pytest.approx(UNKNOWN_SPIN**2)


def test_the_covariance_from_residuals_is_that_of_the_errors():
    # Over many flights with known noise, squared errors have the mean that the covariance says.
    rng = np.random.default_rng(0)
    times = np.arange(30) / 180.0
    position, velocity = np.array([0.1, -0.2, 1.0]), np.array([4.0, 0.2, 2.0])
    scaled = []
    for _ in range(400):
        noisy = flight(position, velocity, times) + rng.normal(0.0, 0.003, (30, 3))
        state = fit_initial_state(times, noisy, GRAVITY)
        error = np.concatenate([state.position - position, state.linear_velocity - velocity])
        scaled.append(error**2 / np.diag(state.covariance)[MOTION])
    assert np.mean(scaled) == pytest.approx(1.0, abs=0.25)


def test_what_the_model_lacks_widens_the_covariance():
    # Air drag bends a flight; its residuals go together and must count for more than white ones.
    rng = np.random.default_rng(0)
    white = flight(np.zeros(3), np.array([4.0, 0.0, 2.0]), FINE_TIMES)
    noise = rng.normal(0.0, 0.002, white.shape)
    bent = white + np.array([-0.7, 0.0, 0.0]) * FINE_TIMES[:, None] ** 2
    deviations = [
        np.sqrt(fit_initial_state(FINE_TIMES, x + noise, GRAVITY).covariance[6, 6])
        for x in (white, bent)
    ]
    assert deviations[1] > 5.0 * deviations[0]


@settings(max_examples=20)
@given(position=vectors, velocity=vectors)
def test_a_flight_with_drag_is_found(position, velocity):
    points = flight_in_air(position, velocity, np.zeros(3), DRAG, 0.0)
    state = fit_initial_state_in_air(FINE_TIMES, points, GRAVITY, AirFactors(DRAG, 0.0))
    # An acceleration linear between points leaves h² a'' T² / 24, a'' below 400 m/s⁴: 0.15 mm.
    assert state.position == pytest.approx(position, abs=2e-4)
    assert state.linear_velocity == pytest.approx(velocity, abs=2e-3)
    assert not state.angular_velocity.any()
    assert np.diag(state.covariance)[9:] == pytest.approx(LIKELY_SPIN**2)


@settings(max_examples=20)
@given(position=vectors, spin=vectors.map(lambda v: 12.0 * v))
def test_spin_across_the_flight_is_found(position, spin):
    velocity = np.array([5.0, 0.0, 1.0])
    points = flight_in_air(position, velocity, spin, DRAG, MAGNUS)
    state = fit_initial_state_in_air(FINE_TIMES, points, GRAVITY, AirFactors(DRAG, MAGNUS))
    assert state.linear_velocity == pytest.approx(velocity, abs=0.05)
    # The velocity turns in the plane y = 0, so ω_y is across it all the time; the covariance says
    # how well it is known, which for points without noise is far better than so.
    deviation = np.sqrt(state.covariance[10, 10])
    assert deviation < 0.1 * LIKELY_SPIN
    assert abs(state.angular_velocity[1] - spin[1]) < 2.0 * deviation


@given(position=vectors, velocity=vectors)
def test_without_air_both_fits_are_the_same(position, velocity):
    noise = np.random.default_rng(0).normal(0.0, 0.002, (90, 3))
    points = flight_in_air(position, velocity, np.zeros(3), 0.0, 0.0) + noise
    plain = fit_initial_state(FINE_TIMES, points, GRAVITY)
    state = fit_initial_state_in_air(FINE_TIMES, points, GRAVITY, AirFactors(0.0, 0.0))
    assert state.position == pytest.approx(plain.position, abs=1e-9)
    assert state.linear_velocity == pytest.approx(plain.linear_velocity, abs=1e-9)
    # One divides by n - 2 and the other, which fits a spin too, by n - 3.
    deviations = [np.diag(state_fitted.covariance)[:9] for state_fitted in (state, plain)]
    assert deviations[0] == pytest.approx(deviations[1], rel=0.05)


def in_air(drag: float):
    return lambda *points: fit_initial_state_in_air(*points, AirFactors(drag, 0.0))


@pytest.mark.parametrize(
    ("fit", "times", "positions", "message"),
    [
        (fit_initial_state, [0.0], np.zeros((1, 3)), "at least 2"),
        (in_air(0.1), [0.0, 0.1], np.zeros((2, 3)), "at least 3"),
        (fit_initial_state, [0.0, 0.0], np.zeros((2, 3)), "strictly increase"),
        (in_air(0.1), [0.0, 0.1, 0.2], np.full((3, 3), np.inf), "not finite"),
        (in_air(3.0), FINE_TIMES, np.outer(FINE_TIMES, [40.0, 0.0, 0.0]), "does not converge"),
        (in_air(-0.1), [0.0, 0.1, 0.2], np.zeros((3, 3)), "drag factor"),
    ],
)
def test_points_that_cannot_be_fitted_are_refused(fit, times, positions, message):
    with pytest.raises(InvalidInputError, match=message):
        fit(times, positions, GRAVITY)
