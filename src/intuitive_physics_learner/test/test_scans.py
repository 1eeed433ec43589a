"""A scan tries each parameter over its range, with the initial states that fit each value best."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.joint_estimation import JointEstimationSettings
from intuitive_physics_learner.joint_estimation.fit_horizons import TrajectoryFits
from intuitive_physics_learner.joint_estimation.joint_fit import FIXED_HORIZONS, JointFit
from intuitive_physics_learner.joint_estimation.linearisation import (
    ParameterSteps,
    linearise,
    residuals_at,
    separate_groups,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    PRIOR_WIDENING,
    observation_blocks,
)
from intuitive_physics_learner.joint_estimation.scans import (
    SMALLEST_SCAN_GAIN,
    compatible_moves,
    scan_candidates,
    scanned,
    scanned_states,
    tried_parameters,
)

from .cases import task_of

LEVELS = np.array([0.1, 0.5, 0.9])


def candidates_of(task):
    influence = task.influence[:, task.active]
    levels = np.tile(LEVELS, (task.begin.size, 1))
    return scan_candidates(task.begin, separate_groups(influence), task.searched, levels)


def test_each_candidate_moves_one_parameter(gliding_task):
    task = gliding_task([0.5, 0.7])
    candidates, index = candidates_of(task)
    # All four parameters share both observations: no two move together.
    assert len(candidates) == 4 * LEVELS.size
    for parameter in range(4):
        for k, level in enumerate(LEVELS):
            moved = task.searched.to_unit(candidates[index[parameter, k]])
            assert moved[parameter] == pytest.approx(level)
            if parameter != 3:
                assert moved[3] == task.begin[3]


def test_initial_states_are_the_ridge_regression_of_each_level(gliding_task):
    # x(t) = x₀ + s + e v t with s free: s = -Σ r / (n + σ²/p²), r being the residuals at s = 0.
    noise, deviation = 0.5, 0.02
    task = gliding_task([0.6, 0.3], position_deviation=deviation, noise=0.01)
    influence = task.influence[:, task.active]
    (block,) = observation_blocks(task.cost.observations, influence)
    block = replace(block, whitening=np.broadcast_to(np.eye(3) / noise, block.whitening.shape))
    fits = TrajectoryFits.initial(block)
    steps = ParameterSteps(
        task.begin, np.full(4, 0.1), separate_groups(influence), task.searched.to_parameters
    )
    until = fits.horizons
    linear = linearise(task.cost, block, fits.estimate, fits.deviations, steps, until)
    candidates, index = candidates_of(task)
    index = index[block.parameters].reshape(2, -1).T
    estimates, losses = scanned_states(
        task.cost, block, fits, linear, candidates, index, fits.horizons
    )
    estimates = estimates.reshape(4, LEVELS.size, 2, 3)
    losses = losses.reshape(4, LEVELS.size, 2)
    prior = PRIOR_WIDENING * deviation
    for w, observation in enumerate(task.cost.observations):
        (ball,) = observation.objects
        times = ball.trajectory.times
        fitted = times <= fits.horizons[w]
        n = np.count_nonzero(fitted)
        velocity = ball.initial_state.linear_velocity
        for k, e in enumerate(LEVELS):
            moved = ball.initial_state.position + e * times[:, None] * velocity
            here = (moved - ball.trajectory.positions)[fitted]
            expected = -here.sum(axis=0) / (n + noise**2 / prior**2)
            np.testing.assert_allclose(estimates[3, k, w], expected, atol=1e-9)
            left, away = (here + expected) / noise, expected / prior
            assert losses[3, k, w] == pytest.approx(0.5 * (np.sum(left**2) + np.sum(away**2)))


def test_a_step_of_initial_states_that_explains_less_is_not_taken(event_driven, throws):
    # At other θ_s balls bounce elsewhere, where slopes at the estimate say nothing.
    cost = TrajectoryCost(throws(8, 0, noise=0.003, state_noise=0.01, times=24), event_driven)
    fit = JointFit(task_of(cost).fit_task, JointEstimationSettings(scan_steps=()))
    for _ in range(20):
        fit.step()
    model, estimate = fit.model, fit.estimate
    stepped = 0
    for (block, part), linear in zip(
        model.parts(estimate), model.linearised(estimate), strict=True
    ):
        levels = np.broadcast_to(LEVELS, (estimate.unit.size, LEVELS.size))
        candidates, index = scan_candidates(estimate.unit, model.groups, model.space, levels)
        index = index[block.parameters].reshape(len(block.members), -1).T
        estimates, losses = scanned_states(
            cost, block, part, linear, candidates, index, part.horizons, True
        )
        present = np.broadcast_to(part.estimate, estimates.shape)
        residuals = residuals_at(cost, block, present, candidates, index, part.horizons)
        assert (losses <= part.losses(block, present, residuals)).all()
        stepped += np.count_nonzero((estimates != present).any(axis=2))
    assert stepped > 0


@given(st.integers(0, 2**32 - 1))
def test_moves_share_no_observation_and_none_that_gains_most_is_left_out(seed):
    rng = np.random.default_rng(seed)
    influence = rng.random((6, 8)) < 0.3
    gains = 2.0 * SMALLEST_SCAN_GAIN * rng.normal(size=8)
    moves = compatible_moves(gains, influence)
    assert (gains[moves] >= SMALLEST_SCAN_GAIN).all()
    assert (influence[:, moves].sum(axis=1) <= 1).all()
    for parameter in set(np.flatnonzero(gains >= SMALLEST_SCAN_GAIN)) - set(moves):
        rivals = [m for m in moves if (influence[:, m] & influence[:, parameter]).any()]
        assert max(gains[rivals]) >= gains[parameter]


def test_a_scan_leaves_a_local_optimum(gliding_task):
    # f(e) is lowest at 0.6: from 0.5 the fit to f(0.95) = 0.245 climbs to f(0) = 0.072.
    def valley(e):
        return np.where(e < 0.6, 0.2, 2.0) * (e - 0.6) ** 2

    task = gliding_task([0.95, 0.95], effect=valley, noise=0.002)

    def fitted(settings):
        fit = JointFit(task.fit_task, settings)
        for _ in range(12):
            fit.step()
        return fit.unit[3]

    assert fitted(JointEstimationSettings()) == pytest.approx(0.95, abs=0.01)
    assert fitted(JointEstimationSettings(scan_steps=())) < 0.1


def test_what_is_asked_rises_as_where_all_are_tried(gliding_task):
    task = gliding_task([0.6, 0.3, 0.5], position_deviation=0.02)
    fit = JointFit(task.fit_task, FIXED_HORIZONS)
    linear = fit.model.linearised(fit.estimate)
    rises, _ = scanned(fit.model, fit.estimate, linear, LEVELS, fit.weights)
    fit.model.simulations = 0.0
    asked = np.array([False, True, False, True])
    some, _ = scanned(fit.model, fit.estimate, linear, LEVELS, fit.weights, asked)
    np.testing.assert_array_equal(some[asked], rises[asked])
    # Two fits of initial states for each level of each parameter that is asked for.
    simulated = fit.model.simulations
    fit.model.simulations = 0.0
    scanned(fit.model, fit.estimate, linear, LEVELS, fit.weights)
    assert simulated == pytest.approx(fit.model.simulations / 2)


@given(data=st.data())
def test_tried_parameters_are_those_asked_for_each_once(data):
    n = data.draw(st.integers(1, 6))
    each = st.permutations(range(n)).map(lambda order: order[: (n + 1) // 2])
    parameters = np.array(data.draw(st.lists(each, min_size=1, max_size=4)))
    asked = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    tried, counts = tried_parameters(parameters, asked)
    for own, chosen, counted in zip(parameters, tried, counts, strict=True):
        assert sorted(chosen[counted]) == sorted(own[asked[own]])
    assert tried.shape[1] == max(1, asked[parameters].sum(axis=1).max())
