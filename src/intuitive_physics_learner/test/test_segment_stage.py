"""The order of fits where objects that tumble were thrown alone and with others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.materials import StaticParameters
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.joint_search import segment_stage, separate_fits, staged_fit
from intuitive_physics_learner.joint_search.staged_fit import FIRST_TOGETHER_STEPS, StagedFit
from intuitive_physics_learner.segmented_estimation.segmented_fit import SegmentedFit

from .cases import MATERIALS, box_throws, task_of

SEPARATE, TOGETHER, SEGMENTED = 6, 8, 60


@pytest.fixture(autouse=True)
def few_steps(monkeypatch):
    monkeypatch.setattr(separate_fits, "SEPARATE_STEPS", SEPARATE)
    monkeypatch.setattr(staged_fit, "TOGETHER_STEPS", TOGETHER)
    # So few throws and steps do not show it of every box.
    monkeypatch.setattr(segment_stage, "tumbles", lambda fit: True)


def called(observation, material, away):
    """The object of a throw as one of another material that moved elsewhere, m."""
    (thrown,) = observation.objects
    shift = np.array([away, 0.0, 0.0])
    return replace(
        thrown,
        object=replace(thrown.object, id=material, material=material),
        trajectory=Trajectory(thrown.trajectory.times, thrown.trajectory.positions + shift),
        initial_state=replace(thrown.initial_state, position=thrown.initial_state.position + shift),
    )


@pytest.fixture(scope="module")
def task(event_driven):
    """Two boxes, each thrown four times alone and twice with the other."""
    true = StaticParameters.uniform(MATERIALS)
    throws, _ = box_throws(event_driven, true, 10, 0.005, np.random.default_rng(4))
    named = ["red"] * 4 + ["green"] * 4
    alone = [
        replace(throw, objects=(called(throw, name, 0.0),), id="")
        for throw, name in zip(throws, named, strict=False)
    ]
    both = [
        replace(throw, objects=(called(throw, "red", 0.0), called(throw, "green", 9.0)), id="")
        for throw in throws[8:]
    ]
    return task_of(TrajectoryCost([*alone, *both], event_driven))


def staged(task, simulator):
    generator = np.random.default_rng(1)
    return StagedFit(
        task.fit_task,
        in_segments=lambda fit: SegmentedFit(fit, simulator, generator.spawn(1)[0]),
    )


def states_of_both(fit):
    return np.array([each.estimate for each in fit.joint.observation_fits()[8:]])


def test_states_of_collisions_are_fitted_before_segments_and_again_after_them(task, event_driven):
    fit = staged(task, event_driven)
    for _ in range(SEPARATE):
        fit.step()
    assert not states_of_both(fit).any()
    for _ in range(FIRST_TOGETHER_STEPS):
        fit.step()
    before, alone = states_of_both(fit), fit.joint.horizons[:8]
    assert before.any()
    assert fit.segment_steps == 0
    for _ in range(SEGMENTED):
        if fit.task.counted[:8].any():
            fit.step()
    assert not fit.task.counted[:8].any()
    assert fit.segment_steps == fit.steps - SEPARATE - FIRST_TOGETHER_STEPS
    np.testing.assert_array_equal(states_of_both(fit), before)
    # Throws that were fitted in segments begin as these say, from where one motion goes on.
    assert fit.joint.horizons[:8].mean() > 1.5 * alone.mean()
    while not fit._together_ended:
        fit.step()
        assert fit.joint.steps == 0
    together = fit._together.fit
    assert together.steps == TOGETHER or (together.settled and 0 < together.steps < TOGETHER)
    assert (states_of_both(fit) != before).any()
    fit.step()
    assert fit.joint.steps == 1


@pytest.mark.parametrize("stopped", [SEPARATE + 2, SEPARATE + FIRST_TOGETHER_STEPS + 2, 45])
def test_it_continues_exactly(task, event_driven, stopped):
    """Before the segments, within them, and after them."""
    whole, resumed = staged(task, event_driven), staged(task, event_driven)
    for _ in range(stopped):
        whole.step()
    resumed.load_state(whole.state())
    for _ in range(3):
        whole.step()
        resumed.step()
    np.testing.assert_array_equal(whole.joint.unit, resumed.joint.unit)
    np.testing.assert_array_equal(states_of_both(whole), states_of_both(resumed))
