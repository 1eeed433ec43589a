"""Quantiles of normal distributions between two ends."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import truncnorm

from intuitive_physics_predictor.parameter_uncertainty import TruncatedNormal

SHARES = np.linspace(0.0, 1.0, 21)[:, None]
reach = st.floats(0.01, 5.0)
deviation = st.floats(1e-3, 1e3)


def one(*numbers: float) -> TruncatedNormal:
    return TruncatedNormal(*(np.array([number]) for number in numbers))


@given(st.floats(-10.0, 10.0), deviation, reach, reach)
def test_quantiles_are_those_of_scipy(mean, sigma, below, above):
    found = one(mean, sigma, mean - below, mean + above).quantiles(SHARES)
    truth = truncnorm.ppf(SHARES, -below / sigma, above / sigma, mean, sigma)
    np.testing.assert_allclose(found, truth, atol=1e-9 * (1.0 + sigma))


@given(st.floats(-10.0, 10.0), deviation, reach, reach, st.floats(-6.0, 6.0))
def test_one_more_end_cuts_off_what_is_above_it(mean, sigma, below, above, end):
    most = mean + end * min(sigma, 1.0)
    known = one(mean, sigma, mean - below, mean + above)
    found = known.quantiles_up_to(np.array([most]), SHARES)
    if most <= mean - below:
        np.testing.assert_array_equal(found, most)
        return
    last = min(above, most - mean)
    truth = truncnorm.ppf(SHARES, -below / sigma, last / sigma, mean, sigma)
    np.testing.assert_allclose(found, truth, atol=1e-7 * (1.0 + sigma))


@given(st.floats(-10.0, 10.0), reach, reach, reach)
def test_without_a_finite_deviation_all_between_the_ends_is_alike(mean, below, above, cut):
    known = one(mean, np.inf, mean - below, mean + above)
    width = below + above
    np.testing.assert_allclose(known.quantiles(SHARES), mean - below + SHARES * width, atol=1e-12)
    most = mean + above - cut
    upper = min(most, mean + above)
    lower = min(mean - below, upper)
    found = known.quantiles_up_to(np.array([most]), SHARES)
    np.testing.assert_allclose(found, lower + SHARES * (upper - lower), atol=1e-12)


@given(st.floats(-10.0, 10.0), reach, reach)
def test_what_is_known_exactly_is_the_mean(mean, below, above):
    known = one(mean, 0.0, mean - below, mean + above)
    np.testing.assert_allclose(known.quantiles(SHARES[1:-1]), mean, rtol=0.0, atol=1e-28)
