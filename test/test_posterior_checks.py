"""Posteriors checked as an outsider would: ranks of the truth, and a sampler of others."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from benchmarks.learning import posterior_ranks, posterior_sampler
from benchmarks.learning.posterior_ranks import BINS, DRAWS, Ranks, complaints, draw_world
from benchmarks.learning.posterior_sampler import FitDensity, Way, sample
from benchmarks.results.markdown import tables_text

from intuitive_physics.materials import PAIR_COEFFICIENTS, StaticParameters
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings, JointFit
from intuitive_physics_learner.search.learning_task import LearningTask

WORLDS = 2000  # of a toy
TOY_NOISE = 0.5  # standard deviation of its observation, beside a prior of N(0, 1)


def toy_ranks(widening: float, shift: float = 0.0) -> Ranks:
    """Ranks in a linear-Gaussian toy: x from N(0, 1), y from N(x, TOY_NOISE²).

    The posterior of x is N(y / (1 + TOY_NOISE²), TOY_NOISE² / (1 + TOY_NOISE²)); that which is
    drawn from is `widening` times as wide, and `shift` of its standard deviations away.
    """
    rng = np.random.default_rng(3)
    truth = rng.standard_normal(WORLDS)
    seen = truth + TOY_NOISE * rng.standard_normal(WORLDS)
    deviation = TOY_NOISE / np.sqrt(1.0 + TOY_NOISE**2)
    mean = seen / (1.0 + TOY_NOISE**2) + shift * deviation
    draws = mean + widening * deviation * rng.standard_normal((DRAWS, WORLDS))
    return Ranks("toy", (draws < truth).sum(axis=0))


def test_ranks_of_a_right_posterior_are_uniform():
    right = toy_ranks(1.0)
    assert right.counts.sum() == WORLDS
    assert right.counts.size == BINS
    assert right.test[1] > 0.01
    # Four standard errors of a share of one half, and of the mean of uniform ranks.
    assert right.middle == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(WORLDS))
    assert right.ranks.mean() == pytest.approx(DRAWS / 2, abs=4 * 29 / np.sqrt(WORLDS))
    assert complaints([right]) == []


@pytest.mark.parametrize(("widening", "shift"), [(0.7, 0.0), (1.5, 0.0), (1.0, 0.3)])
def test_ranks_of_a_wrong_posterior_are_complained_about(widening, shift):
    wrong = toy_ranks(widening, shift)
    assert len(complaints([toy_ranks(1.0), wrong])) == 1
    assert (wrong.middle > 0.55) == (widening > 1.0)
    assert (wrong.middle < 0.45) == (widening < 1.0)


def test_few_ranks_are_shown_and_not_tested():
    few = Ranks("toy", np.array([0, DRAWS, 42]))
    assert few.counts.tolist() == [1, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    assert few.test is None
    assert complaints([few]) == []


def test_worlds_are_of_the_prior_of_learned_posteriors():
    worlds = [draw_world(np.random.default_rng(seed)) for seed in range(30)]
    assert len({world.observations[0].id for world in worlds}) == 30
    truth = np.array([world.truth[world.places] for world in worlds])
    assert truth.shape == (30, len(PAIR_COEFFICIENTS))
    # Five standard errors of the mean of uniform numbers.
    np.testing.assert_allclose(truth.mean(axis=0), 0.5, atol=5 * np.sqrt(1 / 12 / 30))


def test_small_run_of_the_ranks():
    outcome = posterior_ranks.measure(True, 40)
    assert outcome.key_figures == {"rank_chi2": dict.fromkeys(["density", *PAIR_COEFFICIENTS])}
    assert [row[0] for row in outcome.tables[0].rows] == list(PAIR_COEFFICIENTS)
    assert "1" in outcome.tables[0].rows[0][1]


@pytest.mark.needs("emcee")
def test_sampler_agrees_with_a_gaussian_in_closed_form():
    rng = np.random.default_rng(1)
    root = np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0], [0.0, 0.3, 0.2]])
    covariance, mean = root @ root.T, np.array([0.3, -1.0, 2.0])
    precision = np.linalg.inv(covariance)

    def density(points):
        off = points - mean
        return -0.5 * np.einsum("ci,ij,cj->c", off, precision, off)

    chains = sample(density, mean + rng.standard_normal((40, 3)), 2000, 3, 5)
    found = Way.of("emcee", chains.points.reshape(-1, 3))
    deviation = np.sqrt(np.diag(covariance))
    # Five standard errors of a mean; τ is that of the slowest coordinate.
    error = 5.0 / np.sqrt(1000 * 40 / chains.autocorrelation_time)
    np.testing.assert_allclose(found.mean, mean, atol=error * deviation.max())
    np.testing.assert_allclose(found.deviation, deviation, rtol=error)
    assert found.correlation == pytest.approx(0.8, abs=error)


def test_density_is_the_loss_of_the_fit():
    world = draw_world(np.random.default_rng(102))
    materials = world.space.materials
    task = LearningTask(
        TrajectoryCost(world.observations, make_simulator("auto"), materials),
        world.space,
        parameter_influence(world.observations, materials),
        StaticParameters.uniform(materials),
    )
    fit = JointFit(task.fit_task, JointEstimationSettings(scan_steps=()))
    for _ in range(6):
        fit.step()
    n, density = fit.unit.size, FitDensity(fit)
    states = np.concatenate([part.estimate.ravel() for part in fit.estimate.fits])
    here = np.concatenate([fit.unit, states])
    outside = np.where(np.arange(here.size) == 0, 1.01, here)
    moved = here.copy()
    moved[n] += 0.01  # m, the position of the first throw
    found = density(np.array([here, outside, moved]))
    assert found[0] > found[2] > found[1] == -np.inf
    losses = fit.prior.losses(fit.unit[None])[0]
    for (block, part), linear in zip(
        fit.model.parts(fit.estimate), fit.model.linearised(fit.estimate), strict=True
    ):
        each = part.losses(block, part.estimate[None], linear.residuals[None])[0]
        losses += fit.weights[block.members] @ each
    assert found[0] == pytest.approx(-losses, rel=1e-9)


def test_weights_turn_the_moments_into_those_of_another_prior():
    draws = np.random.default_rng(2).standard_normal((200_000, 2))
    # N(0, 1) times exp(x) is N(1, 1).
    moved = Way.of("moved", draws, draws[:, 0])
    np.testing.assert_allclose(moved.mean, [1.0, 0.0], atol=0.02)
    np.testing.assert_allclose(moved.deviation, [1.0, 1.0], atol=0.02)


@pytest.mark.needs("emcee")
def test_small_run_of_the_sampler():
    outcome = posterior_sampler.measure(True, 102)
    parameters, cost = outcome.tables
    assert [row[0] for row in parameters.rows] == list(PAIR_COEFFICIENTS)
    assert [row[0] for row in cost.rows] == ["learned", "emcee", "emcee, uniform prior"]
    assert "restitution" in tables_text("", outcome.tables)


def test_missing_sampler_is_said_by_a_word(monkeypatch):
    monkeypatch.setitem(sys.modules, "emcee", None)
    outcome = posterior_sampler.measure(True, 102)
    assert outcome.valid
    assert outcome.complaints == [
        "sampler left out: emcee is missing; `tools/bench_packages.sh emcee`"
    ]
