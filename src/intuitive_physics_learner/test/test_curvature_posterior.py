"""The posterior at an estimate is that of linear least squares, and moves end with its parabola."""

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics_learner.joint_estimation import JointEstimationSettings, normal_equations
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.normal_equations import (
    NormalEquations,
    joint_posterior,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    PRIOR_WIDENING,
    observation_blocks,
)
from intuitive_physics_learner.joint_estimation.profiles import (
    LARGEST_MOVE_RISE,
    MOVE_TOLERANCE,
    ONE_SIDED_DEVIATIONS,
    curvature_posterior,
    curvature_simulations,
    move_simulations,
    plausible_moves,
)
from intuitive_physics_learner.search.gaussian import Gaussian

PRIOR_DEVIATION = UNIFORM_PRECISION**-0.5
E = 3
"""Index of the only parameter that has an effect."""


@pytest.fixture(autouse=True)
def least_squares(monkeypatch):
    """Let nothing be an outlier."""
    monkeypatch.setattr(normal_equations, "OUTLIER_LENGTH", 100.0)


def fit_of(task):
    return JointFit(task.fit_task, JointEstimationSettings())


def information_of(task, model, horizons, slope=1.0):
    """Information on e of balls x(t) = x₀ + s + slope · e v t with free s, s eliminated."""
    total, noises = 0.0, model.blocks[0].noise[:, 0]
    for observation, horizon, noise in zip(task.cost.observations, horizons, noises, strict=True):
        (ball,) = observation.objects
        times = ball.trajectory.times[ball.trajectory.times <= horizon]
        speed2 = slope**2 * np.sum(ball.initial_state.linear_velocity**2)
        prior = PRIOR_WIDENING * np.sqrt(ball.initial_state.covariance[0, 0])
        curvature = times.size / noise**2 + prior**-2
        total += speed2 * (times**2).sum() / noise**2
        total -= speed2 * times.sum() ** 2 / noise**4 / curvature
    return total


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_a_linear_problem_has_the_posterior_of_least_squares(gliding_task, noise):
    task = gliding_task([0.5, 0.5, 0.5], position_deviation=0.01, noise=noise)
    fit = fit_of(task)
    model, estimate = fit.model, fit.estimate
    posterior = curvature_posterior(fit)
    information = information_of(task, model, estimate.fits[0].horizons) + UNIFORM_PRECISION
    assert posterior.deviations[E] == pytest.approx(information**-0.5, rel=1e-6)
    # What has no effect keeps its prior, and no correlation with e.
    np.testing.assert_allclose(posterior.deviations[:E], PRIOR_DEVIATION)
    np.testing.assert_allclose(posterior.covariance[E, :E], 0.0, atol=1e-12)


def test_counts_its_simulations(gliding_task):
    task = gliding_task([0.5, 0.5, 0.6], position_deviation=0.01)
    fit = fit_of(task)
    curvature_posterior(fit)
    assert fit.model.simulations == pytest.approx(curvature_simulations(fit))


def test_moves_end_where_the_loss_of_least_squares_is_no_longer_plausible(gliding_task):
    # f(e) = min(e, ½) at e = ½: a rise of ½ (move / σ)² downwards, none upwards until worlds fail.
    task = gliding_task([0.5, 0.5], effect=lambda e: np.minimum(e, 0.5), position_deviation=0.01)
    fit = fit_of(task)
    model, estimate = fit.model, fit.estimate
    information = information_of(task, model, estimate.fits[0].horizons)
    expected = np.sqrt(2.0 * LARGEST_MOVE_RISE / information)
    moves = plausible_moves(fit, np.full(4, 2.0 * expected))
    assert expected / (1.0 + MOVE_TOLERANCE) <= moves[E, 0] <= expected * (1.0 + 1e-6)
    assert moves[E, 1] > 0.45
    # What has no effect can be moved to its bounds.
    unit = estimate.unit[:E]
    np.testing.assert_allclose(moves[:E], np.stack([unit, 1.0 - unit], axis=1))


def test_the_loss_rises_as_least_squares_say_where_a_parameter_is_held(gliding_task):
    # f(e) = e: ½ Λ δ² at a distance δ from the optimum, initial positions fitted along.
    task = gliding_task([0.5, 0.5, 0.5], position_deviation=0.01)
    fit = fit_of(task)
    information = information_of(task, fit.model, fit.estimate.fits[0].horizons) + UNIFORM_PRECISION
    before = fit.unit.copy()
    deviations = np.array([-3.0, 0.5, 2.0])
    moves = [(E, place) for place in (before[E] + deviations * information**-0.5).tolist()]
    np.testing.assert_allclose(fit.rises_at(moves), 0.5 * deviations**2, rtol=1e-3)
    np.testing.assert_array_equal(fit.unit, before)


def test_what_may_be_moved_to_its_bounds_is_moved_all_the_way(gliding_task):
    fit = fit_of(gliding_task([0.5, 0.5], position_deviation=0.01))
    unit = fit.estimate.unit
    room = np.stack([unit, 1.0 - unit], axis=1)
    # The first move ends nearer to the bounds than the end is looked for.
    moves = plausible_moves(fit, (1.0 - 0.5 * MOVE_TOLERANCE) * room.max(axis=1))
    np.testing.assert_array_equal(moves[:E], room[:E])


def test_no_move_where_the_loss_is_a_parabola(gliding_task):
    task = gliding_task([0.5, 0.5, 0.5], position_deviation=0.01)
    fit = fit_of(task)
    posterior = curvature_posterior(fit)
    first = ONE_SIDED_DEVIATIONS * np.sqrt(3.0) * posterior.deviations
    fit.model.simulations = 0.0
    assert (plausible_moves(fit, first)[E] == 0.0).all()
    assert 0.0 < fit.model.simulations <= move_simulations(fit)


def test_eliminating_initial_states_is_the_inverse_of_the_whole_matrix(gliding_task):
    # The posterior of (s, θ) has the covariance H⁻¹; its parts are what elimination gives.
    task = gliding_task([0.5], position_deviation=0.01)
    (block,) = observation_blocks(task.cost.observations, task.influence[:, task.active])
    block = replace(block, whitening=np.broadcast_to(np.eye(3), block.whitening.shape))
    generator = np.random.default_rng(0)
    points = block.times.shape[1]
    slopes = generator.normal(size=(1, 3 + 4, points, 3))
    residuals = generator.normal(size=(1, points, 3))
    valid = np.ones((1, points), dtype=bool)
    linear = Linearisation(residuals, slopes, valid, np.zeros((1, points)), 0.0 * slopes)
    estimate = np.zeros((1, 3))
    equations = NormalEquations.of(block, estimate, linear, block.durations)
    eliminated = equations.eliminated()
    whole = equations.hessian[0].copy()
    whole[3:, 3:] += UNIFORM_PRECISION * np.eye(4)
    inverse = np.linalg.inv(whole)
    prior = Gaussian.within_bounds(np.full(4, 0.5))
    posterior = joint_posterior(prior, prior.mean, [eliminated], np.ones(1))
    np.testing.assert_allclose(posterior.covariance, inverse[3:, 3:], rtol=1e-9, atol=1e-12)
    got = equations.state_covariances(eliminated, posterior)[0]
    np.testing.assert_allclose(got, inverse[:3, :3], rtol=1e-9, atol=1e-12)
    jacobian = slopes[0].reshape(7, -1)
    variances = np.einsum("ip,ij,jp->p", jacobian, inverse, jacobian).reshape(points, 3)
    spreads = equations.spreads(linear, eliminated, posterior)[0]
    np.testing.assert_allclose(spreads, np.sqrt(variances.sum(axis=1)), rtol=1e-9)
