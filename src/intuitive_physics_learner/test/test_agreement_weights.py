"""Observations count less where they contradict all others, whatever they claim to know."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings, JointFit
from intuitive_physics_learner.joint_estimation.normal_equations import (
    AGREEMENT_FREEDOM,
    Elimination,
    agreement_weights,
    joint_posterior,
)
from intuitive_physics_learner.search.gaussian import Gaussian

PRIOR = 1e-6


def weigh(information, estimates, at, weights):
    """Weights of observations (W, q, q) whose own estimates (W, q) lie about a point (q,)."""
    count, q = estimates.shape
    scores = np.einsum("wij,wj->wi", information, at - estimates)
    nothing = np.zeros((count, 0, q)), np.zeros((count, 0))
    everything = np.tile(np.arange(q), (count, 1))
    part = Elimination(np.arange(count), everything, *nothing, information, scores)
    # Where the prior has its mean, it does not pull.
    prior = Gaussian.about(at, PRIOR * np.eye(q))
    agreement = agreement_weights(prior, at, [part], weights)
    return agreement, joint_posterior(prior, at, [part], weights).mean


def settled(information, estimates, at):
    """Repeat until the weights change no more."""
    weights = np.ones(len(estimates))
    for _ in range(50):
        weights, at = weigh(information, estimates, at, weights)
    return weights, at


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), factor=st.floats(1.0, 100.0))
def test_a_wrong_observation_holds_nothing_however_sure_it_is(seed, factor):
    """Twenty estimates with N(0, Λ⁻¹) about the truth, and one 100 of its own σ beside it."""
    rng = np.random.default_rng(seed)
    truth = np.array([0.3, 0.6])
    roots = rng.normal(size=(21, 2, 2)) + 2.0 * np.eye(2)
    information = 1e4 * roots @ roots.transpose(0, 2, 1)
    information[-1] *= factor
    lower = np.linalg.cholesky(np.linalg.inv(information))
    estimates = truth + np.einsum("wij,wj->wi", lower, rng.normal(size=(21, 2)))
    estimates[-1] = truth + lower[-1] @ [100.0, 0.0] + 0.2
    weights, agreement = settled(information, estimates, truth)
    assert weights[-1] < 0.05
    _, least_squares = weigh(information, estimates, truth, np.ones(21))
    spread = np.linalg.inv(information[:-1].sum(axis=0))
    # What is left beside the chance of the good ones is a small part of what it would hold.
    left = 5.0 * np.sqrt(np.diag(spread)) + 0.1 * np.abs(least_squares - truth)
    assert (np.abs(agreement - truth) < left).all()


def test_observations_that_agree_keep_their_weight():
    """T has the mean of its degrees of freedom: Student's weight is about one for all."""
    rng = np.random.default_rng(0)
    information = np.tile(1e4 * np.eye(2), (200, 1, 1))
    estimates = 0.5 + 0.01 * rng.normal(size=(200, 2))
    weights, agreement = settled(information, estimates, np.full(2, 0.4))
    assert np.mean(weights) == pytest.approx(1.0, abs=0.15)
    np.testing.assert_allclose(agreement, 0.5, atol=5.0 * 0.01 / np.sqrt(200))


def test_without_an_observation_the_others_alone_decide():
    """For n estimates x of N(u, σ²), T_i = (x_i - mean of the others)² / (σ² n / (n - 1))."""
    values = np.array([0.1, 0.2, 0.3, 0.9])[:, None]
    sigma = 0.05
    information = np.full((4, 1, 1), sigma**-2)
    weights, _ = weigh(information, values, np.array([0.37]), np.ones(4))
    others = (values.sum() - values[:, 0]) / 3.0
    squares = (values[:, 0] - others) ** 2 / (sigma**2 * 4.0 / 3.0)
    typical = max(np.median(squares), 1.0)
    expected = np.minimum((AGREEMENT_FREEDOM + 1.0) / (AGREEMENT_FREEDOM + squares / typical), 1.0)
    np.testing.assert_allclose(weights, expected, rtol=1e-3)


def test_likelihood_of_an_observation_does_not_depend_on_its_weight(gliding_task):
    task = gliding_task([0.6, 0.6, 0.6], position_deviation=0.02, count=60)
    fit = JointFit(task.fit_task, JointEstimationSettings())
    for _ in range(3):
        fit.step()
    before = fit.likelihoods()
    state = fit.state()
    fit.load_state({**state, "weights": [0.25, 0.25, 0.25]})
    for likelihood, other in zip(before, fit.likelihoods(), strict=True):
        np.testing.assert_array_equal(likelihood.information, other.information)
        np.testing.assert_array_equal(likelihood.scores, other.scores)
        assert likelihood.loss == other.loss
