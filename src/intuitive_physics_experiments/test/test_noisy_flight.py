"""Flights fitted to noisy points: errors have the covariance stated, and bounces end a flight."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.flight_fits import fit_noisy_flight, flight_length

GRAVITY = np.array([0.0, 0.0, -9.81])
TIMES = np.arange(10) / 30.0
POSITION, VELOCITY = np.array([0.1, -0.2, 1.0]), np.array([1.0, 0.5, 2.0])
FLIGHT = POSITION + TIMES[:, None] * VELOCITY + 0.5 * TIMES[:, None] ** 2 * GRAVITY
PARTS = np.array([0, 1, 2, 6, 7, 8])


def covariances(rng: np.random.Generator) -> np.ndarray:
    """Of points that err differently in each direction, and by more and more."""
    roots = 0.002 * rng.standard_normal((len(TIMES), 3, 3)) * (1.0 + TIMES)[:, None, None]
    return roots @ roots.swapaxes(1, 2) + 1e-8 * np.eye(3)


def test_squared_errors_have_the_mean_that_the_covariance_says():
    rng = np.random.default_rng(0)
    noise = covariances(rng)
    roots = np.linalg.cholesky(noise)
    squares = []
    for _ in range(500):
        points = FLIGHT + np.einsum("nij,nj->ni", roots, rng.standard_normal((len(TIMES), 3)))
        position, velocity, covariance = fit_noisy_flight(TIMES, points, GRAVITY, noise)
        error = np.concatenate([position - POSITION, velocity - VELOCITY])
        squares.append(error @ np.linalg.solve(covariance[np.ix_(PARTS, PARTS)], error))
    # χ² of 6 has the variance 12: the mean of 500 is off by 0.15, five of which are allowed.
    assert np.mean(squares) == pytest.approx(6.0, abs=0.8)


@given(seed=st.integers(0, 2**32), deviation=st.floats(1e-4, 1.0))
def test_one_deviation_is_the_same_as_equal_covariances(seed, deviation):
    points = FLIGHT + deviation * np.random.default_rng(seed).standard_normal(FLIGHT.shape)
    alike = np.broadcast_to(deviation**2 * np.eye(3), (len(TIMES), 3, 3))
    for one, other in zip(
        fit_noisy_flight(TIMES, points, GRAVITY, deviation),
        fit_noisy_flight(TIMES, points, GRAVITY, alike),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    assert flight_length(TIMES, points, GRAVITY, deviation) == flight_length(
        TIMES, points, GRAVITY, alike
    )


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
