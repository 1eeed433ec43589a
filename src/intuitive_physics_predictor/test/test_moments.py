"""Mean and covariance of weighted samples, against NumPy and their laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics_predictor.moments import weighted_moments


def drawn(seed, samples, shape, offset=0.0):
    rng = np.random.default_rng(seed)
    weights = rng.random(samples) + 0.01
    return offset + rng.normal(size=(samples, *shape, 3)), weights / weights.sum()


@given(st.integers(0, 2**31), st.integers(1, 30), st.integers(1, 3), st.integers(1, 150))
@settings(max_examples=40)
def test_moments_are_those_of_numpy(seed, samples, objects, times):
    # Any number of points, so that blocks are whole and not.
    points, weights = drawn(seed, samples, (objects, times))
    mean, covariance = weighted_moments(points, weights)
    np.testing.assert_allclose(mean, np.average(points, axis=0, weights=weights), atol=1e-13)
    if samples == 1:
        assert (covariance == 0.0).all()
        return
    for o in range(objects):
        expected = np.cov(points[:, o, 0].T, aweights=weights)
        np.testing.assert_allclose(covariance[o, 0], expected, rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("weighted", [False, True])
def test_covariance_has_no_bias(weighted):
    # 20,000 sets of 5 samples of N(0, Σ): their mean covariance is Σ within four standard errors,
    # each entry of one set having a variance of at most 2 Σ_ii Σ_jj / (n_eff - 1).
    rng = np.random.default_rng(2)
    root = np.array([[1.0, 0.0, 0.0], [0.5, 2.0, 0.0], [0.0, -0.3, 0.5]])
    sets, weights = 20_000, np.array([1.0, 2.0, 3.0, 4.0, 5.0]) if weighted else np.ones(5)
    weights = weights / weights.sum()
    true = root @ root.T
    _, covariance = weighted_moments(rng.normal(size=(5, sets, 3)) @ root.T, weights)
    largest = np.sqrt(np.outer(np.diag(true), np.diag(true)))
    error = largest * np.sqrt(2.0 / (1.0 / (weights**2).sum() - 1.0) / sets)
    assert (np.abs(covariance.mean(axis=0) - true) < 4.0 * error).all()
    # Divided by n it would be a fifth and more too small.
    assert (np.diag(true) * (weights**2).sum() > 8.0 * np.diag(error)).all()


def test_a_place_far_from_the_origin_costs_no_digits():
    # At 1e6 m a double holds 1e-10 m, so that a variance of 1 m² is good to about 1e-10.
    points, weights = drawn(0, 50, (4,))
    near = weighted_moments(points, weights)[1]
    far = weighted_moments(points + 1e6, weights)[1]
    np.testing.assert_allclose(far, near, atol=1e-8)


def test_moments_of_read_only_and_strided_arrays():
    points, weights = drawn(1, 5, (2,))
    points.setflags(write=False)
    mean, _ = weighted_moments(points[:, ::-1], weights)
    np.testing.assert_allclose(mean, np.average(points[:, ::-1], axis=0, weights=weights))
