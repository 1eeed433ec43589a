"""What part of the observations, or each of them, says widens uncertainties and mixes none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner.joint_estimation.widened_uncertainty import (
    agreed_deviations,
    deviations_by_value,
    information_about,
    jackknife_variances,
    off_the_middle,
    widened_information,
)
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood
from intuitive_physics_learner.search.search_space import ActiveSpace

from .cases import MATERIALS

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


@example(
    np.array([[8.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]),
    np.ones(3),
    np.full(3, 0.125),
)
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


FAMILIES = [np.array([0, 1]), np.array([2, 3])]


def half(unit, deviation=0.01):
    return Gaussian.about(np.array(unit), np.eye(4) * deviation**-2)


def test_a_half_that_agrees_widens_nothing_and_another_does():
    # Half of the data says 0.01, so all data say 0.01 / √2.
    unit, deviations = np.full(4, 0.5), np.full(4, 0.01 / np.sqrt(2.0))
    agreed = agreed_deviations(unit, deviations, half([0.503, 0.497, 0.502, 0.501]), FAMILIES)
    np.testing.assert_allclose(agreed, deviations)
    agreed = agreed_deviations(unit, deviations, half([0.7, 0.5, 0.502, 0.501]), FAMILIES)
    # 0.2 off itself; what is of the same family is doubted too.
    assert agreed[0] == pytest.approx(0.2)
    assert agreed[1] > agreed[2] >= deviations[2]


def test_no_sharper_than_two_halves_together():
    """Information adds up: 1/σ² = 2/σ_a²; where the half knows nothing that of its bounds."""
    unit, deviations = np.full(4, 0.5), np.full(4, 0.001)
    agreed = agreed_deviations(unit, deviations, half(unit), FAMILIES)
    np.testing.assert_allclose(agreed, 0.01 / np.sqrt(2.0))
    ignorant = half([0.1, 0.9, 0.5, 0.5], 12.0**-0.5)
    agreed = agreed_deviations(unit, deviations, ignorant, FAMILIES)
    np.testing.assert_allclose(agreed, 24.0**-0.5)


def test_a_smaller_part_is_expected_farther_away():
    # u is the mean of the part's h and what the rest says: a - u has the variance (1 - h) σ_a².
    unit, deviations = np.full(4, 0.5), np.full(4, 0.005)
    for share, chance in ((0.25, True), (0.9, False)):
        off = half(unit + 2.0 * np.sqrt(1.0 - 0.25) * 0.0099)
        agreed = agreed_deviations(unit, deviations, off, FAMILIES, share=share, balanced=False)
        assert bool((agreed < np.abs(off.mean - unit)).all()) == chance


def test_a_part_with_other_observations_bounds_nothing():
    # Where what came later says more, it is known better than by parts like the first.
    unit, deviations = np.full(4, 0.5), np.full(4, 0.001)
    agreed = agreed_deviations(unit, deviations, half(unit), FAMILIES, balanced=False)
    np.testing.assert_allclose(agreed, deviations)


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1))
def test_agreed_deviations_are_never_smaller(seed):
    rng = np.random.default_rng(seed)
    unit, deviations = rng.random(4), rng.uniform(1e-4, 0.28, 4)
    said = half(rng.random(4), rng.uniform(1e-4, 0.28))
    assert (agreed_deviations(unit, deviations, said, FAMILIES) >= deviations).all()


def test_jackknife_variance_of_a_mean():
    generator = np.random.default_rng(3)
    count, sharpness = 400, 1e4
    likelihoods = []
    for _ in range(count):
        about = np.array([0.5])
        best = about + generator.normal(0.0, sharpness**-0.5, 1)
        matrix = np.array([[sharpness]])
        likelihoods.append(
            LocalLikelihood(np.array([0]), about, matrix, matrix @ (about - best), 0.0)
        )
    information = Gaussian.nothing(1).plus(likelihoods)
    (variance,) = jackknife_variances(information, np.array([0.5]), likelihoods, np.ones(count))
    assert variance == pytest.approx(1.0 / (count * sharpness), rel=0.3)
    lone = LocalLikelihood(np.array([0]), np.array([0.6]), np.array([[1e9]]), np.zeros(1), 0.0)
    information = information.plus([lone])
    (variance,) = jackknife_variances(
        information, np.array([0.5]), [*likelihoods, lone], np.ones(count + 1)
    )
    assert np.sqrt(variance) == pytest.approx(0.1, rel=0.05)


@settings(deadline=None)
@given(
    arrays(float, 3, elements=st.floats(0.0, 1.0)),
    arrays(float, (4, 3), elements=st.floats(-20.0, 20.0)),
)
def test_the_start_pulls_as_far_as_posterior_means_differ(start, rows):
    """Those of N(start, 1/12) and N(1/2, 1/12) with the same likelihood, N(0.3, (rowsᵀ rows)⁻¹)."""
    observed = Gaussian.about(np.full(3, 0.3), rows.T @ rows)
    of_start, of_middle = (
        Gaussian.within_bounds(centre).joined(observed) for centre in (start, np.full(3, 0.5))
    )
    off = off_the_middle(of_start.covariance, start)
    np.testing.assert_allclose(off, of_middle.mean - of_start.mean, atol=1e-9)


@pytest.fixture(scope="module")
def axes():
    """An axis of rolling friction, which is logarithmic, and one of restitution."""
    space = ParameterSpace(MATERIALS)
    active = np.isin(space.names, ["rolling_friction[ball, floor]", "restitution[ball, floor]"])
    return ActiveSpace(space, active, StaticParameters.uniform(MATERIALS))


@settings(deadline=None)
@given(st.floats(0.02, 0.2), st.floats(0.3, 0.9))
def test_distributions_of_values_have_tails_on_a_logarithmic_axis(axes, deviation, place):
    """Their mean square is ∫ (u - û)² p du, p ∝ exp(-(ρ(u) - ρ(û))² / (2 (ρ'(û) σ)²)).

    With ρ ∝ r^u, (ρ(u) - ρ(û)) / ρ'(û) is (r^(u - û) - 1) / ln r. The sum over 101 places has an
    error of the order of the square of their distance over σ.
    """
    unit, deviations = np.full(2, place), np.full(2, deviation)
    wider = deviations_by_value(axes, unit, deviations)
    least, most = (axes.values(np.full(2, end))[0] for end in (0.0, 1.0))
    u, growth = np.linspace(0.0, 1.0, 20_001), np.log(most / least)
    lengths = (np.exp(growth * (u - place)) - 1.0) / growth / deviation
    expected = np.sqrt(np.average((u - place) ** 2, weights=np.exp(-0.5 * lengths**2)))
    assert wider[0] == pytest.approx(max(expected, deviation), rel=0.05)
    assert wider[1] == pytest.approx(deviation)


def test_what_is_known_well_has_no_tail(axes):
    deviations = np.full(2, 0.002)
    np.testing.assert_array_equal(
        deviations_by_value(axes, np.full(2, 0.4), deviations), deviations
    )
