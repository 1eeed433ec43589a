"""Joint estimation finds θ_s in spite of noisy initial states, and says truly how well."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.materials import parameter_names
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import ConvergenceCriteria, LearningOptions, TrajectoryCost, learn
from intuitive_physics_learner.cost.point_noise import position_noise
from intuitive_physics_learner.joint_estimation.linearisation import separate_groups
from intuitive_physics_learner.joint_estimation.normal_equations import bounded_step
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    PRIOR_WIDENING,
    InitialStateDeviations,
    InitialStates,
)
from intuitive_physics_learner.joint_estimation.several_starts import durations
from intuitive_physics_learner.joint_search import JointSearch
from intuitive_physics_learner.joint_search.identifiability import (
    balanced_half,
    identifiability_by_fit,
)
from intuitive_physics_learner.joint_search.joint_search import EVALUATED_SHARE
from intuitive_physics_learner.joint_search.staged_fit import StagedFit
from intuitive_physics_learner.methods import JOINT_METHOD

from .cases import MATERIALS, task_of

NOISE, STATE_NOISE = 0.005, 0.02
"""m, and m of initial states, whose velocities err by five times that in m/s."""


def joint_search(observed, simulator):
    task = task_of(TrajectoryCost(observed, simulator, MATERIALS))
    return JointSearch(task, np.random.default_rng(0))


def blown_aside(observed, acceleration):
    """Add an effect that no simulator knows: all objects are accelerated along x."""
    blown = []
    for observation in observed:
        (ball,) = observation.objects
        times, positions = ball.trajectory.times, ball.trajectory.positions.copy()
        positions[:, 0] += 0.5 * acceleration * (times - observation.start_time) ** 2
        changed = replace(ball, trajectory=Trajectory(times, positions))
        blown.append(replace(observation, objects=(changed,)))
    return blown


def test_noisy_initial_states_do_not_bias(event_driven, throws, true_parameters):
    observed = throws(8, 5, NOISE, STATE_NOISE)
    options = LearningOptions(JOINT_METHOD, ConvergenceCriteria(1000))
    learned = learn(observed, event_driven, options).learned
    got, true = (theta.pair(*MATERIALS) for theta in (learned.parameters, true_parameters))
    # Velocities err by 0.1 m/s of 3 m/s: taken as they are, restitution would err by some per cent.
    assert got["restitution"] == pytest.approx(true["restitution"], abs=0.005)
    assert got["dynamic_friction"] == pytest.approx(true["dynamic_friction"], abs=0.01)
    assert got["rolling_friction"] == pytest.approx(true["rolling_friction"], rel=0.05)
    names = np.array(parameter_names(MATERIALS))
    assert "restitution[ball, floor]" in names[learned.identified]
    assert not learned.identified[names == "density[ball]"].any()
    assert not learned.identified[names == "restitution[ball, ball]"].any()


def test_j_is_evaluated_for_a_share_of_the_simulations(event_driven, throws):
    """And at the end, where it is that of the result."""
    observed = throws(8, 5, NOISE, STATE_NOISE)
    search = joint_search(observed, event_driven)
    cost = TrajectoryCost(observed, event_driven, MATERIALS)
    for _ in range(12):
        before = search._staged.simulations
        search.step(1000)
        assert np.isfinite(search.best_cost)
    later = (search._evaluations - 1) * len(observed)
    assert 0 < later <= EVALUATED_SHARE * before + len(observed)
    search.conclude()
    assert search.best_cost == pytest.approx(cost.costs([search.best_parameters])[0])


def test_short_search_keeps_a_better_start(event_driven, throws, true_parameters):
    observed = throws(8, 5, NOISE, STATE_NOISE)
    search = joint_search(observed, event_driven)
    fit = search.fit
    while not fit.settled:
        fit.step()
    good, start = fit.unit.copy(), fit.prior.mean.copy()
    assert not fit.return_if_better(start)
    np.testing.assert_array_equal(fit.unit, good)
    fit.begin_at(start, fit.prior.deviations, fit.observation_fits())
    assert fit.return_if_better(good)
    np.testing.assert_array_equal(fit.unit, good)
    # One step from the first short horizons says less than many from long ones.
    options = LearningOptions(JOINT_METHOD, ConvergenceCriteria(1000))
    learned = learn(observed, event_driven, options).learned
    short = replace(options, criteria=ConvergenceCriteria(20))
    again = learn(observed, event_driven, short, previous=learned).learned
    truth = true_parameters.pair(*MATERIALS)["restitution"]
    errors = [
        abs(each.parameters.pair(*MATERIALS)["restitution"] - truth) for each in (learned, again)
    ]
    # Both are estimates: a part of what is stated as unknown is between them.
    name = f"restitution[{', '.join(MATERIALS)}]"
    names = parameter_names(learned.materials)
    deviation = learned.standard_deviations[names.index(name)]
    assert errors[1] <= errors[0] + 0.5 * deviation


def test_stated_deviations_cover_the_truth(event_driven, throws, true_parameters):
    scores = []
    for seed in range(10):
        observed = throws(8, 20 + seed, NOISE, STATE_NOISE)
        options = LearningOptions(JOINT_METHOD, ConvergenceCriteria(700))
        learned = learn(observed, event_driven, options).learned
        errors = parameter_vector(learned.parameters) - parameter_vector(true_parameters)
        scores += (errors / learned.standard_deviations)[learned.identified].tolist()
    scores = np.abs(scores)
    assert scores.size >= 25
    # Of 30 honest ones 20 ± 2.6 are below one and 28.6 ± 1.2 below two; what was widened by the
    # halves is wider than it need be.
    assert np.mean(scores < 1.0) > 0.5
    assert np.mean(scores < 2.0) > 0.9


@pytest.mark.parametrize(("acceleration", "steps"), [(0.0, 6), (1.0, 40)])
def test_resumes_exactly(event_driven, throws, acceleration, steps):
    observed = blown_aside(throws(4, 0, NOISE, STATE_NOISE), acceleration)
    whole = joint_search(observed, event_driven)
    for step in range(steps):
        if step == steps - 3:
            state = json.loads(json.dumps(whole.state(), allow_nan=False))
        whole.step(20)
    assert whole.lowers_cost == (acceleration > 0.0)
    resumed = joint_search(observed, event_driven)
    resumed.load_state(state)
    for _ in range(3):
        resumed.step(20)
    assert resumed.state() == whole.state()


def test_lowers_cost_where_the_simulation_lacks_an_effect(event_driven, throws):
    observed = blown_aside(throws(8, 0, NOISE), 1.0)
    search = joint_search(observed, event_driven)
    cost = TrajectoryCost(observed, event_driven, MATERIALS)
    while search.step(50):
        if search.lowers_cost:
            (lowest,) = cost.costs([search.best_parameters])
            assert search.best_cost == pytest.approx(lowest, rel=1e-12)
    assert search.lowers_cost
    # An optimum of J along each axis, to what a gain is taken to be.
    theta = search.best_parameters
    pair = theta.pair(*MATERIALS)
    for name, value in pair.items():
        for factor in (0.9, 0.97, 1.03, 1.1):
            frictions = {"static_friction": 1.2} if name == "dynamic_friction" else {}
            least = pair["dynamic_friction"] if name == "static_friction" else 0.0
            there = max(least, min(value * factor, 1.0))
            moved = theta.with_pair(*MATERIALS, **{**frictions, name: there})
            assert cost.costs([moved])[0] > search.best_cost * (1.0 - 0.01)


@settings(max_examples=50)
@given(seed=st.integers(0, 1000), observations=st.integers(1, 12), parameters=st.integers(1, 20))
def test_groups_share_no_observation_and_leave_none_out(seed, observations, parameters):
    influence = np.random.default_rng(seed).random((observations, parameters)) < 0.3
    groups = separate_groups(influence)
    for group in groups:
        assert (influence[:, group].sum(axis=1) <= 1).all()
    members = np.concatenate(groups) if groups else np.empty(0, dtype=int)
    assert sorted(members) == np.flatnonzero(influence.any(axis=0)).tolist()


@settings(max_examples=50)
@given(seed=st.integers(0, 1000), size=st.integers(1, 6))
def test_bounded_steps_stay_in_the_cube_and_go_downhill(seed, size):
    generator = np.random.default_rng(seed)
    root = generator.normal(size=(size, size))
    information = root @ root.T + 0.1 * np.eye(size)
    scores = generator.normal(size=size)
    unit = np.clip(generator.uniform(-0.5, 1.5, size), 0.0, 1.0)
    step = bounded_step(unit, information, scores, 0.0)
    assert ((unit + step >= 0.0) & (unit + step <= 1.0)).all()
    inside = (unit + step > 0.0) & (unit + step < 1.0)
    if inside.all():
        np.testing.assert_allclose(information @ step, -scores, atol=1e-8)


def test_position_noise_of_trajectories(throws):
    assert position_noise(throws(6, 0, 0.01)) == pytest.approx(0.01, rel=0.1)
    assert position_noise(throws(6, 0)) < 1e-3


def test_initial_states_move_as_their_deviations_say(throws):
    observation = throws(1, 0, NOISE, STATE_NOISE)[0]
    first = InitialStateDeviations.of(observation)
    # A sphere: three of position and three of velocity; its spin is known exactly.
    assert first.axes == tuple((0, k) for k in (0, 1, 2, 6, 7, 8))
    np.testing.assert_allclose(
        first.standard_deviations, PRIOR_WIDENING * STATE_NOISE * np.repeat([1.0, 5.0], 3)
    )
    believed = observation.objects[0].initial_state.to_vector()
    ((moved,),) = InitialStates.of([first]).states(np.arange(1.0, 7.0)[None, None], 2)
    np.testing.assert_allclose(moved[0, :3], believed[:3] + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(moved[0, 3:7], believed[3:7])
    np.testing.assert_allclose(moved[0, 7:10], believed[7:10] + [4.0, 5.0, 6.0])
    assert moved[1, 6] == 1.0


def test_a_half_has_half_of_the_observations_of_each_parameter():
    influence = np.zeros((20, 2), dtype=bool)
    influence[:12, 0] = influence[12:, 1] = True
    members = balanced_half(influence)
    assert len(set(members)) == len(members)
    assert influence[members].sum(axis=0) == pytest.approx([6.0, 4.0], abs=1.0)


class CountingCost(TrajectoryCost):
    """Counts the trials that it simulates."""

    trials = 0

    def trial_residuals(self, trials):
        self.trials += trials.size
        return super().trial_residuals(trials)


def test_slopes_are_believed_where_motions_are_explained_to_their_ends(event_driven, throws):
    """No half is fitted there, so that nothing is left to be done in haste."""
    cost = CountingCost(throws(8, 5, NOISE, STATE_NOISE), event_driven)
    task = task_of(cost)
    fit = StagedFit(task.fit_task)
    fit.step()
    assert fit.doubted.any()
    assert fit.repeated_simulations > 0.0
    while fit.doubted.any():
        fit.step()
    assert fit.repeated_simulations == 0.0
    assert (fit.joint.horizons >= durations(fit.joint)).all()
    at_leisure, many = judged(fit, task, lambda: np.inf)
    in_haste, few = judged(fit, task, lambda: -1.0)
    assert few == many
    np.testing.assert_array_equal(in_haste.standard_deviations, at_leisure.standard_deviations)


def judged(fit, task, seconds_left):
    """What is stated of a fit, and by how many trials."""
    before = task.cost.trials
    fit.jointly.choose()
    stated = identifiability_by_fit(fit, task, seconds_left)
    return stated, task.cost.trials - before


def test_judges_in_little_time_where_little_is_left(event_driven, throws, monkeypatch):
    every = property(lambda fit: fit.task.influence.any(axis=0))
    monkeypatch.setattr(StagedFit, "doubted", every)
    cost = CountingCost(throws(8, 5, NOISE, STATE_NOISE), event_driven)
    task = task_of(cost)
    fit = StagedFit(task.fit_task)
    for _ in range(12):
        fit.step()
    at_leisure, many = judged(fit, task, lambda: np.inf)
    in_haste, few = judged(fit, task, lambda: -1.0)
    assert few < 0.6 * many
    # What was not looked at again is not told more surely for it.
    sure = in_haste.identified
    assert (at_leisure.identified | ~sure).all()
    assert (in_haste.standard_deviations >= 0.5 * at_leisure.standard_deviations)[sure].all()
