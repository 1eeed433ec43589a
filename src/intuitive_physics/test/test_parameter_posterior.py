"""The posterior of θ_s: draws follow its law, marginals are those of the law, files keep it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import ks_2samp, kstest, truncnorm

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_count, parameter_names
from intuitive_physics.parameter_posterior import LARGEST_DEVIATION, ParameterPosterior
from intuitive_physics.parameter_space import Bounds, ParameterSpace, parameter_vector

MATERIALS = ("ball", "floor")
SIZE = parameter_count(2)
NAMES = parameter_names(MATERIALS)
UNIFORM = 12**-0.5
LEAST_P = 1e-3
"""Smallest p in a test of Kolmogorov and Smirnov: one in a thousand right draws has a smaller one;
seeds are fixed."""


def posterior(rows, mean=0.5, intervals=None) -> ParameterPosterior:
    """The posterior of rows of F, of which the first columns are given; ends by column."""
    factor = np.zeros((len(rows), SIZE))
    for row, values in zip(factor, rows, strict=True):
        row[: len(values)] = values
    ends = np.full((SIZE, 2), np.nan)
    for column, both in (intervals or {}).items():
        ends[column] = both
    center = np.full(SIZE, 0.5)
    center[: np.size(mean)] = mean
    return ParameterPosterior(MATERIALS, center, factor, intervals=ends)


def draw(given, count=4000, seed=0):
    return given.draw(count, np.random.default_rng(seed))


def on_grid(given, places=600):
    """Distribution functions of the first two coordinates, which alone are correlated."""
    x = (np.arange(places) + 0.5) / places
    points = np.stack(np.meshgrid(x, x, indexing="ij"))
    distances = points - given.mean[:2, None, None]
    for k in (0, 1):
        low, high = given.intervals[k]
        if not np.isnan(low):
            distances[k] = points[k] - np.clip(points[k], low, high)
    whitened = np.tensordot(given.factor[:, :2], distances, axes=1)
    density = np.exp(-0.5 * np.square(whitened).sum(axis=0))
    edges = np.arange(places + 1) / places
    for axis in (1, 0):
        total = np.concatenate([[0.0], np.cumsum(density.sum(axis=axis))])
        yield lambda v, total=total: np.interp(v, edges, total / total[-1])


@pytest.mark.parametrize("mean", [0.5, 0.95, 1.0, 0.0])
@pytest.mark.parametrize("deviation", [0.05, 0.3, 2.0])
def test_one_parameter_is_truncated_normal(mean, deviation):
    drawn = draw(posterior([[1.0 / deviation]], mean))
    truth = truncnorm(-mean / deviation, (1.0 - mean) / deviation, mean, deviation)
    assert kstest(drawn[:, 0], truth.cdf).pvalue > LEAST_P


def test_what_nothing_is_known_of_is_uniform():
    drawn = draw(posterior([[100.0]]))
    assert min(kstest(drawn[:, k], "uniform").pvalue for k in range(1, SIZE)) > LEAST_P


def test_far_from_the_bounds_draws_have_the_covariance_of_the_information():
    rng = np.random.default_rng(1)
    factor = rng.normal(size=(SIZE, SIZE)) * 60.0 + 200.0 * np.eye(SIZE)
    given = ParameterPosterior(MATERIALS, np.full(SIZE, 0.5), factor)
    truth = np.linalg.inv(factor.T @ factor)
    np.testing.assert_allclose(given.covariance(), truth, rtol=1e-6, atol=1e-9 * truth.max())
    whitened = (draw(given) - 0.5) @ factor.T
    # Of 4000 draws a variance is off by 2.2 %, a covariance of independent numbers by 1.6 %.
    np.testing.assert_allclose(np.cov(whitened.T), np.eye(SIZE), atol=0.1)
    assert kstest(whitened.ravel(), "norm").pvalue > LEAST_P


def test_of_a_ratio_that_is_known_each_part_may_be_anywhere():
    width = np.log(8000.0 / 50.0)
    apart = np.log(4.0) / width
    given = posterior([[width / 0.01, -width / 0.01]], [0.5 + apart, 0.5])
    drawn = draw(given)
    values = given.space.to_values(drawn)
    ratios = np.log(values[:, 0] / values[:, 1])
    # A standard deviation of 4000 draws is off by 1.1 % of itself.
    np.testing.assert_allclose(ratios.std(), 0.01, rtol=0.05)
    np.testing.assert_allclose(ratios.mean(), np.log(4.0), atol=0.001)
    assert kstest((drawn[:, 1]) / (1.0 - apart), "uniform").pvalue > LEAST_P
    assert not given.identified[:2].any()


@pytest.mark.parametrize(
    ("rows", "mean", "intervals"),
    [
        ([[3.0, -2.0], [0.0, 4.0]], [0.9, 0.1], {}),
        ([[20.0, 18.0], [0.0, 3.0]], [1.0, 0.0], {}),
        ([[8.0, 8.0]], [1.0, 1.0], {}),
        ([[30.0, -10.0]], [0.0, 0.7], {}),
        ([[10.0, 4.0], [0.0, 5.0]], [0.6, 0.5], {0: (0.4, 1.0)}),
        ([[10.0, 8.0], [0.0, 6.0]], [0.5, 0.5], {0: (0.4, 0.9), 1: (0.0, 0.3)}),
        ([[0.5, 0.4]], [0.3, 0.3], {}),
        ([[12.0, 0.0], [0.0, 7.0]], [0.8, 0.5], {0: (0.75, 0.95)}),
    ],
)
def test_two_parameters_follow_their_density(rows, mean, intervals):
    given = posterior(rows, mean, intervals)
    drawn = draw(given)
    for k, distribution in enumerate(on_grid(given)):
        assert kstest(drawn[:, k], distribution).pvalue > LEAST_P
    # Sums and differences too, by draws of the grid's law through rejection.
    rng = np.random.default_rng(5)
    points = rng.random((400_000, 2))
    distances = points - given.mean[:2]
    for k, (low, high) in (intervals or {}).items():
        distances[:, k] = points[:, k] - np.clip(points[:, k], low, high)
    density = np.exp(-0.5 * np.square(distances @ given.factor[:, :2].T).sum(axis=1))
    truth = points[rng.random(len(points)) * density.max() < density]
    for sign in (1.0, -1.0):
        found = ks_2samp(drawn[:, 0] + sign * drawn[:, 1], truth[:, 0] + sign * truth[:, 1])
        assert found.pvalue > LEAST_P


@pytest.mark.parametrize("total", [1.5, 2.9, 0.2])
def test_a_sum_that_is_known_leaves_a_slice_of_the_cube(total):
    deviation = 0.01
    given = posterior([[1.0 / deviation] * 3], [total / 3.0] * 3)
    drawn = draw(given)
    rng = np.random.default_rng(3)
    points = rng.random((2_000_000, 3))
    points[:, 2] = total + deviation * rng.normal(size=len(points)) - points[:, :2].sum(axis=1)
    truth = points[(points[:, 2] >= 0.0) & (points[:, 2] <= 1.0)]
    for k in range(3):
        assert ks_2samp(drawn[:, k], truth[:20_000, k]).pvalue > LEAST_P
    corners = ks_2samp(drawn[:, :3].max(axis=1), truth[:20_000].max(axis=1))
    assert corners.pvalue > LEAST_P


def test_many_rank_deficient_combinations_keep_what_is_known():
    rng = np.random.default_rng(2)
    factor = rng.normal(size=(6, SIZE)) * 100.0
    drawn = draw(ParameterPosterior(MATERIALS, np.full(SIZE, 0.4), factor))
    whitened = (drawn - 0.4) @ factor.T
    np.testing.assert_allclose(whitened.std(axis=0), 1.0, rtol=0.08)
    assert (drawn.std(axis=0) > 0.05).any()


@given(
    arrays(
        np.float64, (5, SIZE), elements=st.sampled_from([0.0, 0.0, 0.01, 1.0, -30.0, 1e4, -1e6])
    ),
    arrays(
        np.float64, SIZE, elements=st.sampled_from([0.0, 1.0, 0.5, 1e-12]) | st.floats(0.0, 1.0)
    ),
    arrays(np.bool_, SIZE),
    st.integers(0, 2**31),
)
@settings(max_examples=25)
def test_every_draw_is_within_the_cube_and_repeats_by_its_seed(factor, mean, sided, seed):
    ends = np.where(sided[:, None], np.stack([mean * 0.5, 0.5 + 0.5 * mean], axis=1), np.nan)
    given = ParameterPosterior(MATERIALS, mean, factor, intervals=ends)
    drawn = draw(given, 5, seed)
    assert np.isfinite(drawn).all()
    assert drawn.min() >= 0.0
    assert drawn.max() <= 1.0
    np.testing.assert_array_equal(drawn, draw(given, 5, seed))
    for point in drawn:
        given.space.to_parameters(point)  # refuses what is no θ_s
    box = np.stack([mean, np.maximum(mean, 0.7)], axis=1)
    boxed = given.draw(3, np.random.default_rng(seed), box)
    assert (boxed >= box[:, 0]).all()
    assert (boxed <= box[:, 1]).all()


@given(arrays(np.float64, (30, SIZE), elements=st.floats(-1e3, 1e3)))
def test_an_information_matrix_is_kept_in_its_rank(rows):
    information = rows.T @ rows
    given = ParameterPosterior.from_information(MATERIALS, np.full(SIZE, 0.5), information)
    assert len(given.factor) <= SIZE
    scale = max(np.abs(information).max(), 1.0)
    np.testing.assert_allclose(given.information, information, atol=1e-6 + 1e-12 * scale)


def test_marginals_are_those_of_what_is_cut_off():
    given = posterior([[1.0 / 0.3], [0.0, 50.0]], [1.0, 0.5])
    truth = truncnorm(-1.0 / 0.3, 0.0, 1.0, 0.3).std()
    deviations = given.standard_deviations()
    np.testing.assert_allclose(deviations[:2], [truth, 0.02], rtol=2e-3)
    np.testing.assert_allclose(deviations[2:], UNIFORM, rtol=1e-4)
    # As wide as half of a uniform number is not identified any more.
    assert given.identified.tolist()[:3] == [truth < LARGEST_DEVIATION, True, False]
    ridge = posterior([[40.0, -40.0]], [0.5, 0.5])
    drawn = draw(ridge, 20_000)
    np.testing.assert_allclose(ridge.covariance(), np.cov(drawn.T), atol=0.004)


def test_scaling_is_a_factor_on_standard_deviations():
    rng = np.random.default_rng(4)
    factor = rng.normal(size=(4, SIZE)) * 100.0
    given = ParameterPosterior(MATERIALS, np.full(SIZE, 0.5), factor)
    np.testing.assert_allclose(given.scaled(3.0).information, given.information / 9.0, atol=1e-6)
    exact = draw(given.scaled(0.0), 50)
    np.testing.assert_allclose((exact - 0.5) @ np.linalg.svd(factor)[2][:4].T, 0.0, atol=1e-5)
    sided = posterior([[10.0]], 0.4, {0: (0.3, 1.0)})
    np.testing.assert_array_equal(draw(sided.scaled(0.0), 9)[:, 0], 0.4)


def test_other_materials_keep_what_is_known_of_shared_ones():
    given = posterior([[300.0, -300.0], [0.0, 0.0, 20.0]], [0.6, 0.4])
    more = given.extended(("floor", "stone", "ball"))
    at = [
        parameter_names(more.materials).index(name) for name in ("density[ball]", "density[floor]")
    ]
    np.testing.assert_allclose(more.information[np.ix_(at, at)], given.information[:2, :2])
    np.testing.assert_allclose(np.trace(more.information), np.trace(given.information))
    np.testing.assert_allclose(more.mean[at], [0.6, 0.4])
    back = more.extended(MATERIALS)
    np.testing.assert_allclose(back.information, given.information, atol=1e-6)
    np.testing.assert_allclose(back.mean, given.mean)


def test_a_material_that_is_left_out_is_integrated_over():
    given = posterior([[40.0, -40.0], [0.0, 100.0]])
    # σ² of the density of the ball: that of the other one, and that of their difference; that the
    # other one is within the cube adds almost nothing to what is known of it.
    (variance,) = np.linalg.inv(given.extended(("ball",)).information[:1, :1]).ravel()
    np.testing.assert_allclose(variance, 100.0**-2 + 40.0**-2, rtol=5e-3)
    loose = posterior([[40.0, -40.0]]).extended(("ball",))
    np.testing.assert_allclose(loose.standard_deviations()[0], UNIFORM, rtol=0.35)


def learned(deviations, identified, ends=None, given=None, **values) -> LearnedParameters:
    theta = StaticParameters.uniform(MATERIALS, **values)
    return LearnedParameters(theta, deviations, identified, 3, 0.1, 5, "cma_es", ends, given)


def test_marginals_give_each_parameter_its_standard_deviation():
    deviations = 0.01 * parameter_vector(StaticParameters.uniform(MATERIALS))
    source = learned(deviations, np.ones(SIZE, dtype=bool))
    given = ParameterPosterior.from_marginals(
        source.parameters, deviations, source.identified, source.intervals
    )
    values = given.space.to_values(draw(given))
    np.testing.assert_allclose(values.std(axis=0), deviations, rtol=0.06)
    np.testing.assert_allclose(values.mean(axis=0), parameter_vector(source.parameters), rtol=0.002)


def test_bounds_are_widened_to_hold_what_was_given():
    theta = StaticParameters.uniform(MATERIALS, density=10_000.0)
    none = np.full(SIZE, np.nan)
    given = ParameterPosterior.from_marginals(
        theta, none, np.zeros(SIZE, dtype=bool), np.full((SIZE, 2), np.nan)
    )
    assert given.bounds["density"] == Bounds(50.0, 10_000.0, "logarithmic")
    np.testing.assert_allclose(given.space.to_values(given.mean[None])[0, :2], 10_000.0)


def test_slopes_are_those_of_finite_differences():
    unit = np.random.default_rng(6).uniform(0.1, 0.9, SIZE)
    for bounds in (
        {},
        {
            "static_friction": Bounds(0.05, 1.0, "logarithmic"),
            "dynamic_friction": Bounds(0.02, 0.9, "logarithmic"),
        },
    ):
        space = ParameterSpace(MATERIALS, bounds)
        steps = 1e-6 * np.eye(SIZE)
        found = (space.to_values(unit + steps) - space.to_values(unit - steps)).T / 2e-6
        np.testing.assert_allclose(space.slopes(unit), found, rtol=1e-5, atol=1e-6)


def test_files_keep_the_posterior():
    given = posterior([[300.0, -300.0]], [0.6, 0.4], {3: (0.3, 1.0)})
    source = learned(np.full(SIZE, np.nan), np.zeros(SIZE, dtype=bool), given=given)
    read = LearnedParameters.from_dict(source.to_dict()).posterior
    np.testing.assert_array_equal(read.factor, given.factor)
    np.testing.assert_array_equal(read.mean, given.mean)
    np.testing.assert_array_equal(read.intervals, given.intervals)
    assert read.bounds == given.bounds
    assert source.extended(("floor", "ball", "stone")).posterior.factor.shape == (1, 27)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mean": [2.0] * SIZE}, "0 to 1"),
        ({"mean": [0.5]}, "shape"),
        ({"factor": [[0.0] * SIZE] * (SIZE + 1)}, "rows"),
        ({"factor": [[np.inf] * SIZE]}, "finite"),
        ({"intervals": {"density[ball]": [0.5, 0.4]}}, "the lower one first"),
        ({"intervals": {"density[stone]": [0.5, 0.6]}}, "density.stone"),
        ({"bounds": {"colour": [0.0, 1.0, "linear"]}}, "colour"),
        ({"bounds": None}, "cannot be read"),
        ({"factor": [[1.0, 2.0]]}, "cannot be read"),
    ],
)
def test_what_is_no_posterior_is_refused(change, said):
    data = {**posterior([[1.0]]).to_dict(), **change}
    with pytest.raises((InvalidInputError, KeyError), match=said):
        ParameterPosterior.from_dict(data)


def test_a_posterior_of_other_materials_is_refused():
    given = posterior([[1.0]]).extended(("floor", "ball"))
    with pytest.raises(InvalidInputError, match="materials"):
        learned(np.full(SIZE, np.nan), np.zeros(SIZE, dtype=bool), given=given)
