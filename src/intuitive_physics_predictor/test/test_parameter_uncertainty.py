"""Draws of θ_s: as uncertain as learned, within bounds, and nothing unlearned looks sure."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, truncnorm

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_count, parameter_names
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.parameter_space import DEFAULT_BOUNDS, ParameterSpace, parameter_vector
from intuitive_physics_predictor.noise_scales import NoiseScales
from intuitive_physics_predictor.parameter_uncertainty import LARGEST_POOL, UncertainParameters

MATERIALS = ("ball", "floor")
SIZE = parameter_count(2)
NAMES = parameter_names(MATERIALS)
STATIC, DYNAMIC, ROLLING, RESTITUTION = range(4)


def learned(deviations=np.nan, identified=False, ends=None, **values) -> LearnedParameters:
    theta = StaticParameters.uniform(MATERIALS, **values)
    is_identified = np.broadcast_to(identified, SIZE)
    deviations = np.broadcast_to(deviations, SIZE)
    return LearnedParameters(theta, deviations, is_identified, 1, 0.1, 5, "cma_es", ends)


def with_deviation(sigma: float, *names: str, ends=(np.nan, np.nan), **values) -> LearnedParameters:
    """Only these parameters are identified, with this standard deviation or between these ends."""
    is_identified = np.array([name in names for name in NAMES])
    between = np.where(is_identified[:, None], ends, np.nan)
    return learned(np.where(is_identified, sigma, np.nan), is_identified, between, **values)


def draw(parameters, count=4000, seed=0, **options):
    density, coefficients = UncertainParameters(parameters, **options).draw(
        count, np.random.default_rng(seed)
    )
    return density, coefficients[:, :, 0, 1]


def test_identified_parameters_are_truncated_normal():
    name = "restitution[ball, floor]"
    _, values = draw(with_deviation(0.1, name, restitution=0.95))
    truth = truncnorm(-9.5, 0.5, 0.95, 0.1)
    # Kolmogorov-Smirnov: of right draws one in a thousand has a smaller p, and the seed is fixed.
    assert kstest(values[:, RESTITUTION], truth.cdf).pvalue > 1e-3


def test_scale_stretches_the_deviation_of_what_was_identified():
    name = "restitution[ball, floor]"
    spreads = [
        draw(with_deviation(0.02, name), scale=scale)[1][:, RESTITUTION].std()
        for scale in (0.0, 1.0, 3.0)
    ]
    # The standard deviation of n draws is off by 1 / sqrt(2 n) of itself, about 1 %.
    np.testing.assert_allclose(spreads, [0.0, 0.02, 0.06], rtol=0.04)


def test_logarithmic_parameters_spread_in_proportion():
    density, _ = draw(with_deviation(50.0, "density[ball]", density=1000.0))
    logarithms = np.log(density[:, 0])
    np.testing.assert_allclose(
        [logarithms.mean(), logarithms.std()], [np.log(1000.0), 0.05], rtol=0.04
    )


def test_unidentified_parameters_are_uniform_within_their_bounds():
    density, values = draw(learned())
    for column, kind in ((ROLLING, "rolling_friction"), (RESTITUTION, "restitution")):
        bounds = DEFAULT_BOUNDS[kind]
        ends = np.array([bounds.lower, bounds.upper])
        drawn = values[:, column]
        if bounds.scale == "logarithmic":
            drawn, ends = np.log(drawn), np.log(ends)
        assert kstest((drawn - ends[0]) / np.ptp(ends), "uniform").pvalue > 1e-3
    low, high = np.log(DEFAULT_BOUNDS["density"].lower), np.log(DEFAULT_BOUNDS["density"].upper)
    assert kstest((np.log(density[:, 1]) - low) / (high - low), "uniform").pvalue > 1e-3


def test_a_known_friction_keeps_its_distribution_beside_an_unknown_one():
    name = "dynamic_friction[ball, floor]"
    _, values = draw(with_deviation(0.01, name, static_friction=0.5, dynamic_friction=0.3))
    np.testing.assert_allclose(values[:, DYNAMIC].mean(), 0.3, atol=0.001)
    np.testing.assert_allclose(values[:, DYNAMIC].std(), 0.01, rtol=0.05)
    assert values[:, STATIC].min() >= 0.25
    assert values[:, STATIC].max() > 0.9


def test_a_friction_that_only_has_to_be_large_enough_is_anywhere_above():
    name = "dynamic_friction[ball, floor]"
    source = with_deviation(
        0.01, name, ends=(0.35, 1.0), static_friction=0.4, dynamic_friction=0.37
    )
    _, values = draw(source)
    check_flat_between(values[:, DYNAMIC], 0.35, 1.0, below=0.01, above=None)
    _, exact = draw(source, scale=0.0)
    np.testing.assert_allclose(exact[:, DYNAMIC], 0.37)
    density = with_deviation(50.0, "density[ball]", ends=(500.0, 2000.0), density=1000.0)
    logarithms = np.log(draw(density)[0][:, 0])
    check_flat_between(logarithms, np.log(500.0), np.log(2000.0), below=0.05, above=0.05)


def check_flat_between(drawn, low, high, *, below, above):
    """Uniform between both ends, and half a normal distribution outside of each."""
    inside = drawn[(drawn >= low) & (drawn <= high)]
    assert kstest((inside - low) / (high - low), "uniform").pvalue > 1e-3
    outside = np.sqrt(np.pi / 2.0) * np.array([deviation or 0.0 for deviation in (below, above)])
    expected = outside / (high - low + outside.sum())
    shares = [(drawn < low).mean(), (drawn > high).mean()]
    # Four standard errors of a share.
    np.testing.assert_allclose(shares, expected, atol=4.0 * np.sqrt(0.1 / drawn.size))
    assert kstest((low - drawn[drawn < low]) / below, "halfnorm").pvalue > 1e-3


def test_a_ratio_that_is_known_is_drawn_where_each_part_is_not():
    space = ParameterSpace(MATERIALS)
    theta = StaticParameters.uniform(MATERIALS).with_density("ball", 2000.0)
    row = np.zeros((1, SIZE))
    row[0, :2] = np.array([1.0, -1.0]) * np.log(160.0) / 0.02
    posterior = ParameterPosterior(MATERIALS, space.to_unit(theta), row)
    unknown = np.full(SIZE, np.nan), np.zeros(SIZE, bool)
    source = LearnedParameters(theta, *unknown, 1, 0.1, 5, "joint", posterior=posterior)
    for scale in (1.0, 3.0):
        density, _ = draw(source, scale=scale)
        ratios = np.log(density[:, 0] / density[:, 1])
        np.testing.assert_allclose(
            [ratios.mean(), ratios.std()], [np.log(4.0), 0.02 * scale], rtol=0.06
        )
        assert np.ptp(np.log(density[:, 1])) > 0.9 * np.log(160.0 / 4.0)


def test_unidentified_parameters_keep_the_given_share_of_their_bounds():
    source = with_deviation(0.2, "restitution[ball, floor]", restitution=0.5)
    for share in (0.0, 0.2):
        density, values = draw(source, unidentified=share)
        way = np.log(density[:, 0] / 500.0)
        bounds = DEFAULT_BOUNDS["density"]
        np.testing.assert_allclose(way.min(), share * np.log(bounds.lower / 500.0), atol=0.02)
        np.testing.assert_allclose(way.max(), share * np.log(bounds.upper / 500.0), atol=0.02)
        # What is known little is bounded by half as much.
        assert 0.5 < np.ptp(values[:, RESTITUTION]) < 0.8
    exact = with_deviation(0.02, "restitution[ball, floor]", restitution=0.5)
    spread = draw(exact, unidentified=0.0)[1][:, RESTITUTION].std()
    np.testing.assert_allclose(spread, 0.02, rtol=0.05)


def test_many_draws_take_each_of_the_pool_as_often_as_any_other():
    uncertain = UncertainParameters(learned())
    density, _ = uncertain.draw(3 * LARGEST_POOL, np.random.default_rng(0))
    _, counts = np.unique(density[:, 0], return_counts=True)
    np.testing.assert_array_equal(counts, 3)
    again, _ = uncertain.draw(3 * LARGEST_POOL, np.random.default_rng(0))
    np.testing.assert_array_equal(density, again)


@given(
    st.lists(st.floats(0.0, 1.0), min_size=SIZE, max_size=SIZE),
    st.lists(st.one_of(st.just(np.nan), st.floats(0.0, 2.0)), min_size=SIZE, max_size=SIZE),
    st.floats(0.0, 10.0),
    st.floats(0.0, 0.5),
    st.lists(st.booleans(), min_size=SIZE, max_size=SIZE),
    st.integers(0, 2**31),
)
@settings(max_examples=60, deadline=None)
def test_every_draw_is_a_valid_theta_within_bounds(unit, deviations, scale, contact, between, seed):
    space = ParameterSpace(MATERIALS)
    theta = space.to_parameters(unit)
    is_identified = ~np.isnan(deviations)
    # Ends from a tenth to ten times the value, be that within the bounds or not.
    ends = np.outer(parameter_vector(theta), [0.1, 10.0])
    ends[~np.array(between)] = np.nan
    source = LearnedParameters(theta, deviations, is_identified, 1, 0.1, 1, "cma_es", ends)
    density, coefficients = UncertainParameters(source, scale=scale, contact=contact).draw(
        7, np.random.default_rng(seed)
    )
    for rho, pairs in zip(density, coefficients, strict=True):
        StaticParameters(MATERIALS, rho, pairs)  # refuses what is no θ_s, μ_d > μ_s above all
    for values, kind in (
        (density, "density"),
        (coefficients[:, STATIC], "static_friction"),
        (coefficients[:, DYNAMIC], "dynamic_friction"),
        (coefficients[:, ROLLING], "rolling_friction"),
        (coefficients[:, RESTITUTION], "restitution"),
    ):
        bounds = DEFAULT_BOUNDS[kind]
        assert (values >= bounds.lower * (1 - 1e-12)).all()
        assert (values <= bounds.upper * (1 + 1e-12)).all()


def test_contact_noise_moves_what_acts_in_an_impact():
    _, values = draw(learned(0.0, True, restitution=0.5), contact=0.03)
    spread = values.std(axis=0)
    np.testing.assert_allclose(spread[RESTITUTION], 0.03, rtol=0.05)
    assert spread[STATIC] > 0.02
    assert spread[ROLLING] == pytest.approx(0.0, abs=1e-12)


def test_learned_values_outside_the_bounds_are_kept():
    parameters = learned(0.0, True, density=10_000.0)
    density, _ = draw(parameters, count=3)
    np.testing.assert_allclose(density, 10_000.0, rtol=1e-12)


@pytest.mark.parametrize("options", [{"scale": -1.0}, {"contact": np.nan}])
def test_scales_that_are_no_scales_are_refused(options):
    with pytest.raises(InvalidInputError, match="expected"):
        UncertainParameters(learned(), **options)


def test_pool_is_kept_for_the_same_parameters():
    source = with_deviation(0.1, "restitution[ball, floor]")
    first = NoiseScales().parameters(source)
    assert NoiseScales().parameters(source.extended(MATERIALS)) is first
    assert NoiseScales(contact=0.1).parameters(source) is not first
    assert NoiseScales().parameters(learned()) is not first


@pytest.mark.parametrize("unidentified", [1.0, 0.5])
def test_a_scene_may_need_fewer_materials_than_were_learned(unidentified):
    many = learned(restitution=0.7).extended(("box", *MATERIALS))
    some = UncertainParameters(many, unidentified=unidentified, materials=MATERIALS)
    density, coefficients = some.draw(100, np.random.default_rng(0))
    assert density.shape == (100, 2)
    assert coefficients.shape == (100, 4, 2, 2)
    # Friction at rest is never less than sliding friction: the elements are those of their kind.
    assert (coefficients[:, STATIC] >= coefficients[:, DYNAMIC]).all()
