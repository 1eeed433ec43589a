"""Each parameter is moved to its places, with the initial states that fit each place best."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_learner import TrajectoryCost
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
from intuitive_physics_learner.joint_estimation.profile_rises import (
    fitted_losses,
    moved_candidates,
    profile_rises,
    tried_parameters,
)

from .cases import task_of

PLACES = np.array([0.1, 0.5, 0.9])


def candidates_of(task):
    influence = task.influence[:, task.active]
    places = np.tile(PLACES, (task.begin.size, 1))
    return moved_candidates(task.begin, separate_groups(influence), task.searched, places)


def test_each_candidate_moves_one_parameter(gliding_task):
    task = gliding_task([0.5, 0.7])
    candidates, index = candidates_of(task)
    # All four parameters share both observations: no two move together.
    assert len(candidates) == 4 * PLACES.size
    for parameter in range(4):
        for k, place in enumerate(PLACES):
            moved = task.searched.to_unit(candidates[index[parameter, k]])
            assert moved[parameter] == pytest.approx(place)
            if parameter != 3:
                assert moved[3] == task.begin[3]


def test_losses_are_those_of_the_ridge_regression_at_each_place(gliding_task):
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
    losses = fitted_losses(task.cost, block, fits, linear, candidates, index, until)
    losses = losses.reshape(4, PLACES.size, 2)
    prior = PRIOR_WIDENING * deviation
    for w, observation in enumerate(task.cost.observations):
        (ball,) = observation.objects
        times = ball.trajectory.times
        fitted = times <= fits.horizons[w]
        n = np.count_nonzero(fitted)
        velocity = ball.initial_state.linear_velocity
        for k, e in enumerate(PLACES):
            moved = ball.initial_state.position + e * times[:, None] * velocity
            here = (moved - ball.trajectory.positions)[fitted]
            best = -here.sum(axis=0) / (n + noise**2 / prior**2)
            left, away = (here + best) / noise, best / prior
            assert losses[3, k, w] == pytest.approx(0.5 * (np.sum(left**2) + np.sum(away**2)))


def test_a_step_of_initial_states_that_explains_less_is_not_taken(event_driven, throws):
    # At other θ_s balls bounce elsewhere, where slopes at the estimate say nothing.
    cost = TrajectoryCost(throws(8, 0, noise=0.003, state_noise=0.01, times=24), event_driven)
    fit = JointFit(task_of(cost).fit_task)
    for _ in range(20):
        fit.step()
    model, estimate = fit.model, fit.estimate
    stepped = stayed = 0
    for (block, part), linear in zip(
        model.parts(estimate), model.linearised(estimate), strict=True
    ):
        places = np.broadcast_to(PLACES, (estimate.unit.size, PLACES.size))
        candidates, index = moved_candidates(estimate.unit, model.groups, model.space, places)
        index = index[block.parameters].reshape(len(block.members), -1).T
        losses = fitted_losses(cost, block, part, linear, candidates, index, part.horizons)
        present = np.broadcast_to(part.estimate, (len(index), *part.estimate.shape))
        residuals = residuals_at(cost, block, present, candidates, index, part.horizons)
        before = part.losses(block, present, residuals)
        assert (losses <= before).all()
        stepped += np.count_nonzero(losses < before)
        stayed += np.count_nonzero(losses == before)
    assert stepped > 0
    assert stayed > 0


def test_what_is_asked_rises_as_where_all_are(gliding_task):
    task = gliding_task([0.6, 0.3, 0.5], position_deviation=0.02)
    fit = JointFit(task.fit_task, FIXED_HORIZONS)
    linear, places = fit.model.linearised(fit.estimate), np.tile(PLACES, (4, 1))
    fit.model.simulations = 0.0
    every = np.ones(4, dtype=bool)
    rises = profile_rises(fit.model, fit.estimate, linear, places, fit.weights, every)
    simulated, fit.model.simulations = fit.model.simulations, 0.0
    asked = np.array([False, True, False, True])
    some = profile_rises(fit.model, fit.estimate, linear, places, fit.weights, asked)
    np.testing.assert_array_equal(some[asked], rises[asked])
    # Two fits of initial states for each place of each parameter that is asked for.
    assert fit.model.simulations == pytest.approx(simulated / 2)


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
