"""Gaussian knowledge in information form, against the same by covariances and by slopes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics_learner.online.encoding import decoded, encoded
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood


def random_precision(generator, size, scale=100.0):
    slopes = generator.normal(size=(size + 1, size))
    return scale * slopes.T @ slopes


def likelihood(generator, parameters, best, scale=100.0):
    information = random_precision(generator, len(parameters), scale)
    about = best + 0.1 * generator.normal(size=len(parameters))
    return LocalLikelihood(
        np.array(parameters), about, information, information @ (about - best), 0.0
    )


def test_one_that_is_held_leaves_the_others_as_given_it():
    # p(u₀, u₂ | u₁): mean m + P_{·1} (u₁ - m₁) / P₁₁, precision of the others as it was.
    generator = np.random.default_rng(1)
    known = Gaussian.about(generator.random(3), random_precision(generator, 3))
    held = known.held_at(1, 0.3, 1e12)
    across = known.covariance[:, 1] / known.covariance[1, 1]
    np.testing.assert_allclose(held.mean, known.mean + across * (0.3 - known.mean[1]), rtol=1e-6)
    rest = np.ix_([0, 2], [0, 2])
    np.testing.assert_allclose(
        held.covariance[rest], np.linalg.inv(known.precision[rest]), rtol=1e-6
    )


def test_rises_are_differences_of_the_loss():
    generator = np.random.default_rng(2)
    known = Gaussian.about(generator.random(3), random_precision(generator, 3))
    unit, away = generator.random(3), generator.normal(size=(3, 4))
    moved = unit + away[..., None] * np.eye(3)[:, None]
    expected = known.losses(moved.reshape(-1, 3)).reshape(3, 4) - known.losses(unit[None])
    np.testing.assert_allclose(known.rises(unit, away), expected, rtol=1e-9, atol=1e-9)


def test_observations_add_up_to_the_product_of_their_likelihoods():
    generator = np.random.default_rng(0)
    centre = np.array([0.3, 0.5, 0.6])
    summand = likelihood(generator, [0, 2], np.array([0.2, 0.7]))
    other = likelihood(generator, [1, 2], np.array([0.4, 0.8]))
    information = Gaussian.nothing(3).plus([summand, other], [1.0, 0.5])
    prior = information.bounded(centre)

    def slope(unit):
        total = UNIFORM_PRECISION * (unit - centre)
        for each, weight in ((summand, 1.0), (other, 0.5)):
            parameters = each.parameters
            total[parameters] += weight * (
                each.scores + each.information @ (unit[parameters] - each.estimate)
            )
        return total

    assert slope(prior.mean) == pytest.approx(np.zeros(3), abs=1e-9)
    step = np.eye(3) * 1e-3
    curvature = [(slope(prior.mean + s) - slope(prior.mean - s)) / 2e-3 for s in step]
    assert prior.precision == pytest.approx(np.array(curvature))


def test_nothing_known_is_the_centre_within_the_bounds():
    prior = Gaussian.nothing(2).bounded(np.array([0.2, 0.9]))
    assert prior.mean == pytest.approx([0.2, 0.9])
    assert prior.deviations == pytest.approx(np.full(2, 12.0**-0.5))


def test_forgetting_parameters_leaves_the_marginal_of_the_others():
    generator = np.random.default_rng(1)
    matrix = random_precision(generator, 4)
    mean = generator.uniform(size=4)
    information = Gaussian.about(mean, matrix).without(np.array([1, 3]))
    expected = Gaussian.about(mean, matrix).marginal(np.array([0, 2]))
    assert information.precision[np.ix_([0, 2], [0, 2])] == pytest.approx(expected.precision)
    left = np.linalg.solve(information.precision[np.ix_([0, 2], [0, 2])], information.pull[[0, 2]])
    assert left == pytest.approx(mean[[0, 2]])
    assert not information.precision[[1, 3]].any()
    assert not information.pull[[1, 3]].any()


def test_widening_adds_variances_and_keeps_correlations():
    # Cov(u + e) = P + D for independent errors e ~ N(0, D).
    generator = np.random.default_rng(2)
    known = Gaussian.about(generator.uniform(size=3), random_precision(generator, 3))
    deviations = np.array([0.0, 0.1, 0.3])
    wider = known.widened(deviations)
    np.testing.assert_allclose(wider.covariance, known.covariance + np.diag(deviations**2))
    np.testing.assert_array_equal(wider.mean, known.mean)
    nothing = Gaussian.about(np.full(3, 0.5), np.zeros((3, 3)))
    assert not nothing.widened(deviations).precision.any()


def test_a_weight_of_minus_one_takes_away_what_was_added():
    generator = np.random.default_rng(4)
    before = Gaussian.about(generator.uniform(size=3), random_precision(generator, 3))
    summand = likelihood(generator, [0, 2], np.array([0.2, 0.7]))
    after = before.plus([summand], [0.5]).plus([summand], [-0.5])
    np.testing.assert_allclose(after.precision, before.precision)
    np.testing.assert_allclose(after.mean, before.mean)


@given(arrays(np.float64, st.tuples(st.integers(0, 4), st.integers(0, 4))))
def test_arrays_survive_to_their_last_bit(array):
    back = decoded(encoded(array), {})
    assert back.shape == array.shape
    assert back.tobytes() == array.tobytes()
