"""Steps of initial states alone, and that a damped step ends on the floor of a curved valley."""

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics_learner.joint_estimation import joint_fit
from intuitive_physics_learner.joint_estimation.joint_fit import FIXED_HORIZONS, JointFit
from intuitive_physics_learner.joint_estimation.linearisation import residuals_at
from intuitive_physics_learner.joint_estimation.observation_blocks import observation_blocks
from intuitive_physics_learner.joint_estimation.state_steps import StateSteps

NOISE, DEVIATION = 0.5, 0.02


@pytest.fixture
def fit(gliding_task):
    """A fit of x(t) = x(0) + e³ v t with uncertain x(0) and points of much noise."""
    task = gliding_task([0.8, 0.8], lambda e: e**3, DEVIATION, 0.01).fit_task
    (block,) = observation_blocks(task.cost.observations, task.influence)
    whitening = np.broadcast_to(np.eye(3) / NOISE, block.whitening.shape)
    return JointFit(task, FIXED_HORIZONS, [replace(block, whitening=whitening)])


def ridge_regression(fit, e):
    # r(t) = x₀ + s + e³ v t - x(t) is least with s = -Σ r₀(t) / (n + σ² / p²), r₀ being r at s = 0.
    ((block, part),) = fit.model.parts(fit.estimate)
    states = []
    for w, observation in enumerate(fit.model.cost.observations):
        (ball,) = observation.objects
        fitted = ball.trajectory.times <= part.horizons[w]
        reach = e**3 * ball.trajectory.times[fitted, None] * ball.initial_state.linear_velocity
        left = ball.initial_state.position + reach - ball.trajectory.positions[fitted]
        prior = block.prior_deviations[w, 0]
        states.append(-left.sum(axis=0) / (fitted.sum() + NOISE**2 / prior**2))
    return np.array(states)


@pytest.mark.parametrize("e", [0.3, 0.5, 0.9])
def test_initial_states_suit_a_parameter_wherever_they_begin(fit, e):
    # Residuals are linear in s, so one step is exact from anywhere, whatever e³ does.
    model, estimate = fit.model, fit.estimate
    ((block, part),) = model.parts(estimate)
    (linear,) = linearised = model.linearised(estimate)
    (equations,) = model.equations(estimate, linearised)
    unit = estimate.unit.copy()
    unit[-1] = e
    begun = np.random.default_rng(0).normal(0.0, 0.1, (3, *part.estimate.shape))
    index = np.zeros((3, 1), dtype=np.int64)
    candidates = [model.space.to_parameters(unit)]
    residuals = residuals_at(model.cost, block, begun, candidates, index, part.horizons)
    stepped = StateSteps.of(block, part, linear, equations).stepped(begun, residuals)
    expected = np.broadcast_to(ridge_regression(fit, e), begun.shape)
    np.testing.assert_allclose(stepped, expected, atol=1e-9)


def test_a_damped_step_ends_with_the_initial_states_of_its_parameters(fit, monkeypatch):
    # Where the straight step ends, s suits e³ as it was extrapolated from the slope at e = 0.5.
    monkeypatch.setattr(joint_fit, "STRAIGHT_STEPS", 0)
    before = fit.unit[-1]
    fit.step()
    assert abs(fit.unit[-1] - before) > 0.05
    ((_, part),) = fit.model.parts(fit.estimate)
    np.testing.assert_allclose(part.estimate, ridge_regression(fit, fit.unit[-1]), atol=1e-9)
