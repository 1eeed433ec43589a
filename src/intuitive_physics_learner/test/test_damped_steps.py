"""Damped steps that are tried from one estimate."""

import numpy as np
import pytest

from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.joint_estimation.damped_steps import DampedSteps
from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings, JointFit
from intuitive_physics_learner.joint_estimation.linearisation import residuals_at

from .cases import MATERIALS, task_of


@pytest.fixture
def fit(event_driven, throws):
    task = task_of(TrajectoryCost(throws(8, 5, 0.005, 0.02), event_driven, MATERIALS))
    fit = JointFit(task.fit_task, JointEstimationSettings())
    for _ in range(4):
        fit.step()
    return fit


def steps_from(fit, *, restepped=False):
    linear = fit.model.linearised(fit.estimate)
    equations = fit.model.equations(fit.estimate, linear)
    return DampedSteps(fit.model, fit.estimate, linear, equations, fit.weights, restepped=restepped)


def test_the_present_loss_is_that_of_a_simulation(fit):
    """What the slopes were taken about is not simulated again."""
    before = fit.model.simulations
    expected = fit.model.prior.losses(fit.unit[None])[0]
    for block, part in fit.model.parts(fit.estimate):
        states, index = part.estimate[None], np.zeros((1, 1), dtype=np.int64)
        candidates = [fit.model.space.to_parameters(fit.unit)]
        residuals = residuals_at(fit.model.cost, block, states, candidates, index, part.horizons)
        expected += fit.weights[block.members] @ part.losses(block, states, residuals)[0]
    steps = steps_from(fit)
    assert steps.losses == pytest.approx([expected])
    assert fit.model.simulations - before == pytest.approx(
        fit.model.simulations_of(fit.estimate, 2)
    )


def test_a_step_goes_to_zero_as_its_damping_grows(fit):
    """δu = -(S + λ diag S)⁻¹ b → 0 for λ → ∞, and the loss to that of the estimate."""
    steps = steps_from(fit)
    steps.try_steps(np.array([1e3, 1e9]))
    far, near = np.abs(steps.units[1:] - fit.unit).max(axis=1)
    assert near < 1e-5 * max(far, 1e-9) or near < 1e-12
    assert steps.losses[2] == pytest.approx(steps.losses[0], rel=1e-6)


def test_the_best_states_leave_the_loss_that_is_stated(fit):
    steps = steps_from(fit, restepped=True)
    steps.try_steps(np.array([0.01, 1.0]))
    chosen = int(np.argmin(steps.losses))
    expected = fit.model.prior.losses(steps.units)[chosen]
    for (block, part), (states, residuals) in zip(
        fit.model.parts(fit.estimate), steps.best_states(chosen), strict=True
    ):
        losses = part.losses(block, states[None], residuals[None])[0]
        expected += fit.weights[block.members] @ losses
    assert steps.losses[chosen] == pytest.approx(expected)


def test_more_initial_states_never_explain_less(fit):
    plain, restepped = steps_from(fit), steps_from(fit, restepped=True)
    for steps in (plain, restepped):
        steps.try_steps(np.array([0.01, 1.0]))
    np.testing.assert_array_equal(plain.units, restepped.units)
    assert (restepped.losses <= plain.losses + 1e-9).all()
