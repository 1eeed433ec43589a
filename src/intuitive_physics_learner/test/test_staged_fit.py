"""Objects that moved alone are fitted each by itself, then all observations jointly."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.cost.wrapped_costs import PartialCost
from intuitive_physics_learner.joint_estimation import JointEstimationSettings
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_search import separate_fits, staged_fit
from intuitive_physics_learner.joint_search.separate_fits import separable
from intuitive_physics_learner.joint_search.staged_fit import StagedFit
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.search_space import ActiveSpace

from .cases import task_of

STEPS, TOGETHER = 4, 3


@pytest.fixture(autouse=True)
def few_steps(monkeypatch):
    monkeypatch.setattr(separate_fits, "SEPARATE_STEPS", STEPS)
    monkeypatch.setattr(staged_fit, "TOGETHER_STEPS", TOGETHER)


@dataclass(frozen=True)
class Moved:
    """Stands for an observation of some objects."""

    objects: tuple[int, ...]


def moved(observation, material, away):
    """The motion of a ball elsewhere, m, by a ball of another material."""
    (ball,) = observation.objects
    shift, state = np.array([away, 0.0, 0.0]), ball.initial_state
    return replace(
        ball,
        object=replace(ball.object, id=material, material=material),
        trajectory=Trajectory(ball.trajectory.times, ball.trajectory.positions + shift),
        initial_state=replace(state, position=state.position + shift),
    )


@pytest.fixture(scope="module")
def task(event_driven, throws):
    """Two balls, thrown one at a time and both at once."""
    observed = throws(9, 3, 0.005, 0.02, 30)
    named = ["red"] * 3 + ["green"] * 3
    alone = [
        replace(observation, objects=(moved(observation, name, 0.0),), id="")
        for observation, name in zip(observed, named, strict=False)
    ]
    both = [
        replace(
            observation,
            objects=(moved(observation, "red", 0.0), moved(observation, "green", 1.0)),
            id="",
        )
        for observation in observed[6:]
    ]
    return task_of(TrajectoryCost([*both, *alone], event_driven))


def fit_of(task):
    return StagedFit(task.fit_task)


@given(
    st.lists(
        st.tuples(st.integers(1, 3), st.sets(st.integers(0, 11), max_size=4)),
        min_size=1,
        max_size=12,
    )
)
def test_groups_share_no_parameter_and_hold_all_objects_that_moved_alone(drawn):
    observations = [Moved(tuple(range(count))) for count, _ in drawn]
    influence = np.zeros((len(drawn), 12), dtype=bool)
    for row, (_, parameters) in zip(influence, drawn, strict=True):
        row[list(parameters)] = True
    groups = separable(observations, influence)
    alone = {i for i, (count, single) in enumerate(drawn) if count == 1 and single}
    if not groups:
        # Nothing to separate: none moved alone, or all of them belong together.
        reached = influence[min(alone, default=0)]
        for _ in alone:
            reached = influence[[i for i in alone if (influence[i] & reached).any()]].any(axis=0)
        assert all((influence[i] & reached).any() for i in alone)
        return
    assert len(groups) > 1
    assert sorted(np.concatenate(groups)) == sorted(alone)
    owners = np.array([influence[members].any(axis=0) for members in groups])
    assert (owners.sum(axis=0) <= 1).all()
    for members in groups:
        reached = influence[members[0]]
        for _ in members:
            reached = influence[members][(influence[members] & reached).any(axis=1)].any(axis=0)
        assert (influence[members] & reached).any(axis=1).all()


def test_an_object_is_fitted_as_if_there_were_no_other(task):
    staged = fit_of(task)
    for _ in range(STEPS):
        staged.step()
    influence = task.influence[:, task.active]
    groups = separable(task.cost.observations, influence)
    assert len(groups) == 2
    assert staged.joint.steps == 0
    for members in groups:
        parameters = influence[members].any(axis=0)
        whole = task.active.copy()
        whole[task.active] = parameters
        space = ActiveSpace(task.space, whole, task.start)
        prior = task.prior.marginal(np.flatnonzero(parameters))
        cost = PartialCost(task.cost, members)
        part = FitTask(cost, space, influence[np.ix_(members, parameters)], prior)
        fit = JointFit(part, JointEstimationSettings())
        for _ in range(STEPS):
            if not fit.settled:
                fit.step()
        np.testing.assert_allclose(staged.joint.unit[parameters], fit.unit, atol=1e-9)
        fits = staged.joint.observation_fits()
        for member, observation_fit in zip(members, fit.observation_fits(), strict=True):
            np.testing.assert_allclose(fits[member].estimate, observation_fit.estimate, atol=1e-9)
            assert fits[member].horizon == observation_fit.horizon


def several(task):
    """Indices of the observations of several objects."""
    observations = task.cost.observations
    return [i for i, observation in enumerate(observations) if len(observation.objects) == 2]


def test_collisions_come_in_once_the_separate_fits_have_ended(task):
    staged = fit_of(task)
    first = [staged.joint.observation_fits()[i].estimate.copy() for i in several(task)]
    for _ in range(STEPS):
        staged.step()
    for before, i in zip(first, several(task), strict=True):
        np.testing.assert_array_equal(before, staged.joint.observation_fits()[i].estimate)
    for _ in range(TOGETHER):
        staged.step()
        assert staged.joint.steps == 0
    for before, i in zip(first, several(task), strict=True):
        assert (before != staged.joint.observation_fits()[i].estimate).any()
    staged.step()
    assert staged.joint.steps == 1
    assert staged.steps == STEPS + TOGETHER + 1


def test_collisions_are_fitted_with_what_the_separate_fits_say(task):
    """As if these were a prior: of independent observations likelihoods multiply."""
    staged = fit_of(task)
    for _ in range(STEPS):
        staged.step()
    prior = task.fit_task.prior
    for part in staged._separate.parts:
        said = Gaussian.nothing(part.fit.unit.size).plus(part.fit.likelihoods(), part.fit.weights)
        prior = prior.joined(said.among(part.parameters, prior.mean.size))
    members = np.array(several(task))
    asked = replace(task.fit_task, prior=prior).of(members)
    fit = JointFit(asked, JointEstimationSettings())
    deviations = np.minimum(staged.joint.deviations, prior.deviations)
    fit.begin_at(staged.joint.unit, deviations, [None] * members.size)
    for _ in range(TOGETHER):
        staged.step()
        fit.step()
    np.testing.assert_allclose(staged.joint.unit, fit.unit, atol=1e-6)


@pytest.mark.parametrize("stopped", [2, 5, 8])
def test_a_stopped_fit_continues_exactly(task, stopped):
    whole, first, second = (fit_of(task) for _ in range(3))
    for _ in range(stopped):
        first.step()
    second.load_state(first.state())
    for _ in range(9):
        whole.step()
    for _ in range(9 - stopped):
        second.step()
    np.testing.assert_array_equal(whole.joint.unit, second.joint.unit)
    assert whole.steps == second.steps
    assert whole.joint.model.simulations == second.joint.model.simulations


def test_fits_jointly_from_the_beginning_where_few_moved_alone(task, monkeypatch):
    monkeypatch.setattr(separate_fits, "SMALLEST_SEPARATE_SHARE", 1.0)
    jointly = fit_of(task)
    jointly.step()
    assert jointly.joint.steps == 1
