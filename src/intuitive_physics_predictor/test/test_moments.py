"""Mean and covariance of weighted samples, against NumPy and their laws."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics_predictor.moments import weighted_moments


def drawn(seed, samples, shape, offset=0.0):
    rng = np.random.default_rng(seed)
    weights = rng.random(samples) + 0.01
    return offset + rng.normal(size=(samples, *shape, 3)), weights / weights.sum()


@given(st.integers(0, 2**31), st.integers(1, 30), st.integers(1, 3), st.integers(1, 150))
@settings(max_examples=40)
def test_they_are_those_of_numpy(seed, samples, objects, times):
    # Any number of points, so that blocks are whole and not.
    points, weights = drawn(seed, samples, (objects, times))
    mean, covariance = weighted_moments(points, weights)
    np.testing.assert_allclose(mean, np.average(points, axis=0, weights=weights), atol=1e-13)
    apart = points - mean
    expected = np.einsum("s,soti,sotj->otij", weights, apart, apart)
    np.testing.assert_allclose(covariance, expected, atol=1e-13)


def test_a_place_far_from_the_origin_costs_no_digits():
    # At 1e6 m a double holds 1e-10 m, so that a variance of 1 m² is good to about 1e-10.
    points, weights = drawn(0, 50, (4,))
    near = weighted_moments(points, weights)[1]
    far = weighted_moments(points + 1e6, weights)[1]
    np.testing.assert_allclose(far, near, atol=1e-8)


def test_what_cannot_be_written_to_is_taken_too():
    points, weights = drawn(1, 5, (2,))
    points.setflags(write=False)
    mean, _ = weighted_moments(points[:, ::-1], weights)
    np.testing.assert_allclose(mean, np.average(points[:, ::-1], axis=0, weights=weights))
