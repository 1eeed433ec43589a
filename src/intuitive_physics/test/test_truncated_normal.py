"""Quantiles of normal distributions between two ends, and of those with a flat interval."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import truncexpon, truncnorm

from intuitive_physics.truncated_gaussian import (
    flat_interval_quantiles,
    truncated_normal_quantiles,
)

SHARES = np.linspace(0.0, 1.0, 21)
reach = st.floats(0.01, 5.0)
deviation = st.floats(1e-3, 1e3)


@given(st.floats(-10.0, 10.0), deviation, reach, reach)
@example(0.0, 0.125, 1.0, 1.0)
def test_quantiles_are_those_of_scipy(mean, sigma, below, above):
    found = truncated_normal_quantiles(SHARES, mean, sigma, mean - below, mean + above)
    truth = truncnorm.ppf(SHARES, -below / sigma, above / sigma, mean, sigma)
    np.testing.assert_allclose(found, truth, atol=1e-9 * (1.0 + sigma))


@given(st.floats(40.0, 1e6), st.booleans())
def test_far_out_a_tail_is_exponential(place, mirrored):
    # With t standard deviations to the nearer end, x above it has the density exp(-t x - x²/2).
    sign = -1.0 if mirrored else 1.0
    ends = sorted([sign * place, sign * (place + 20.0 / place)])
    found = sign * truncated_normal_quantiles(SHARES, 0.0, 1.0, *ends)
    truth = truncexpon.ppf(SHARES, 20.0) / place
    found = np.sort(found - place)
    # The square is at most 200 / t²; scipy's `ndtri_exp` is right within 1e-9.
    np.testing.assert_allclose(found, truth, atol=1e-9, rtol=300.0 / place**2)


@given(st.floats(-10.0, 10.0), st.sampled_from([np.inf, 1e8]), reach, reach)
def test_without_a_finite_deviation_all_between_the_ends_is_alike(mean, sigma, below, above):
    found = truncated_normal_quantiles(SHARES, mean, sigma, mean - below, mean + above)
    np.testing.assert_allclose(found, mean - below + SHARES * (below + above), atol=1e-12)


@given(
    st.floats(-30.0, 30.0),
    st.floats(0.1, 400.0),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.floats(0.01, 0.99),
)
def test_a_flat_interval_has_the_density_that_is_said(slope, precision, one, other, share):
    first, last = sorted([one, other])
    place = float(flat_interval_quantiles(share, slope, precision, (first, last), (0.0, 1.0)))

    def density(u):
        away = u - min(max(u, first), last)
        return np.exp(-0.5 * precision * away**2 - slope * away)

    parts = sorted({0.0, first, last, 1.0, place})
    masses = [quad(density, a, b)[0] for a, b in pairwise(parts)]
    below = sum(mass for mass, b in zip(masses, parts[1:], strict=True) if b <= place)
    np.testing.assert_allclose(below / sum(masses), share, atol=1e-7)


def test_without_information_an_interval_means_nothing():
    found = flat_interval_quantiles(SHARES, 0.0, 0.0, (0.4, 0.6), (0.0, 1.0))
    np.testing.assert_allclose(found, SHARES, atol=1e-12)
