"""Proper scores and highest-density regions against what theory says of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import erf

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_predictor.scores.highest_density import coverage, highest_density_levels
from intuitive_physics_predictor.scores.proper_scores import crps, energy_scores


def test_crps_of_a_normal_prediction():
    # Gneiting, Raftery 2007, Eq. 21: σ (z (2Φ(z) - 1) + 2φ(z) - 1/√π), z = (y - μ) / σ.
    rng = np.random.default_rng(0)
    outcome = np.array([0.3, -1.0, 2.0])
    samples = rng.normal(0.0, 1.0, (20_000, 3))
    z = outcome
    truth = z * erf(z / np.sqrt(2)) + 2 * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
    truth -= 1 / np.sqrt(np.pi)
    # Each mean over n draws is off by about 1/√n = 0.007.
    np.testing.assert_allclose(crps(samples, outcome), truth, atol=0.02)


def test_energy_score_of_what_is_certain_is_the_distance():
    outcome = np.array([[0.0, 3.0, 4.0], [1.0, 0.0, 0.0]])
    for count in (1, 2, 7):
        np.testing.assert_allclose(
            energy_scores(np.zeros((count, 2, 3)), outcome), [5.0, 1.0], atol=1e-12
        )


@given(st.integers(0, 2**31), st.integers(2, 6))
@settings(max_examples=20, deadline=None)
def test_energy_score_is_its_definition(seed, count):
    rng = np.random.default_rng(seed)
    samples, outcome = rng.normal(size=(count, 3)), rng.normal(size=3)
    between = np.linalg.norm(samples[:, None] - samples, axis=-1).sum() / (count * (count - 1))
    truth = np.linalg.norm(samples - outcome, axis=-1).mean() - 0.5 * between
    np.testing.assert_allclose(energy_scores(samples, outcome), truth, atol=1e-12)


def test_the_true_distribution_has_the_best_energy_score():
    rng = np.random.default_rng(1)
    outcomes = rng.normal(size=(4000, 3))
    means = [
        energy_scores(scale * rng.normal(size=(30, 4000, 3)), outcomes).mean()
        for scale in (0.5, 1.0, 2.0)
    ]
    assert means[1] < min(means[0], means[2])


def test_unknown_outcomes_have_no_score():
    outcome = np.array([[np.nan, 0.0, 0.0], [0.0, 0.0, 0.0]])
    scores = energy_scores(np.random.default_rng(0).normal(size=(5, 2, 3)), outcome)
    np.testing.assert_array_equal(np.isnan(scores), [True, False])


def two_modes(rng, shape):
    """A third of the draws about -5, the others about +5 along x."""
    drawn = rng.normal(size=(*shape, 3)) * 0.3
    drawn[..., 0] += np.where(rng.random(shape) < 1 / 3, -5.0, 5.0)
    return drawn


@pytest.mark.parametrize("draw", [lambda rng, shape: rng.normal(size=(*shape, 3)), two_modes])
def test_levels_of_true_predictions_are_uniform(draw):
    # Of n outcomes the share inside a region of probability p is p ± sqrt(p (1 - p) / n).
    rng = np.random.default_rng(2)
    n = 2000
    pairs = zip(draw(rng, (n, 40)), draw(rng, (n,)), strict=True)
    levels = [highest_density_levels(samples, outcome) for samples, outcome in pairs]
    for p in (0.1, 0.5, 0.9):
        assert coverage(levels, p) == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / n))


def test_between_two_modes_is_outside():
    samples = two_modes(np.random.default_rng(3), (300,))
    assert highest_density_levels(samples, (0.0, 0.0, 0.0))[0] > 0.99
    assert highest_density_levels(samples, (5.0, 0.0, 0.0))[1] < 0.9


@pytest.mark.parametrize(("scale", "sign"), [(0.5, -1), (2.0, 1)])
def test_predictions_too_sure_cover_too_little(scale, sign):
    rng = np.random.default_rng(4)
    levels = [
        highest_density_levels(scale * rng.normal(size=(40, 3)), rng.normal(size=3))
        for _ in range(500)
    ]
    assert sign * (coverage(levels, 0.5) - 0.5) > 0.15


@given(st.integers(2, 30), st.integers(0, 2**31))
@settings(max_examples=30, deadline=None)
def test_levels_are_probabilities_in_order(count, seed):
    rng = np.random.default_rng(seed)
    below, at = highest_density_levels(rng.integers(0, 3, (count, 3)), rng.integers(0, 3, 3))
    assert 0.0 <= below < at <= 1.0


def test_samples_all_alike_tell_all_or_nothing():
    alike = np.ones((9, 3))
    assert highest_density_levels(alike, np.ones(3)) == (0.0, 1.0)
    assert highest_density_levels(alike, np.zeros(3)) == (0.9, 1.0)


def test_invalid_samples_have_no_score():
    with pytest.raises(InvalidInputError, match="samples have shape"):
        energy_scores(np.zeros((4, 3)), np.zeros((2, 3)))
    with pytest.raises(InvalidInputError, match="1 samples"):
        highest_density_levels(np.zeros((1, 3)), np.zeros(3))
