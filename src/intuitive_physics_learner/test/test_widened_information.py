"""Information that is less certain keeps what is known of combinations apart."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics_learner.joint_estimation.widened_uncertainty import (
    information_about,
    widened_information,
)

ONES = np.ones(3)
ANY = np.zeros(3)


def deviations(information):
    bounds = UNIFORM_PRECISION * np.eye(len(information))
    return np.sqrt(np.diag(np.linalg.inv(information + bounds)))


def test_of_independent_parameters_each_has_its_factor():
    information = np.diag([1e4, 1e6, 0.0])
    wider = widened_information(information, np.array([2.0, 3.0, 5.0]), ANY)
    np.testing.assert_allclose(wider, np.diag([1e4 / 4.0, 1e6 / 9.0, 0.0]), atol=1e-6)


def test_a_ratio_stays_one_whatever_the_factors_of_its_parts():
    ratio = np.array([1.0, -1.0, 0.0])
    information = 1e6 * np.outer(ratio, ratio)
    wider = widened_information(information, np.array([1.0, 2.0, 7.0]), ANY)
    # Its factor is the root mean square of both, and along it nothing is known.
    np.testing.assert_allclose(wider, information / 2.5, rtol=1e-9)
    np.testing.assert_allclose(wider @ [1.0, 1.0, 0.0], 0.0, atol=1e-6)


def test_identified_parameters_have_at_least_their_deviation():
    information = np.diag([1e4, 1e6, 1.0])
    least = np.array([0.05, 1e-4, 0.28])
    wider = widened_information(information, ONES, least)
    widened, before = deviations(wider), deviations(information)
    np.testing.assert_allclose(widened, [0.05, before[1], before[2]], rtol=1e-6)


def test_about_a_point_beside_the_mean_the_distance_counts():
    rows = np.random.default_rng(0).normal(0.0, 10.0, (5, 3))
    apart = np.array([0.02, 0.0, -0.01])
    bounds = UNIFORM_PRECISION * np.eye(3)
    covariance = np.linalg.inv(rows.T @ rows + bounds)
    about = np.linalg.inv(information_about(rows.T @ rows, apart) + bounds)
    np.testing.assert_allclose(about, covariance + np.outer(apart, apart), rtol=1e-9)


@given(
    arrays(float, (4, 3), elements=st.floats(-100.0, 100.0)),
    arrays(float, 3, elements=st.floats(1.0, 5.0)),
    arrays(float, 3, elements=st.floats(0.0, 0.14)),
)
def test_nothing_gets_more_certain(rows, factors, least):
    information = rows.T @ rows
    wider = widened_information(information, factors, least)
    scale = max(np.abs(information).max(), 1.0)
    assert np.linalg.eigvalsh(wider)[0] > -1e-8 * scale
    combinations = np.random.default_rng(0).normal(size=(20, 3))
    for each in combinations:
        assert each @ wider @ each <= each @ information @ each + 1e-7 * scale
