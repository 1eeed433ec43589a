"""Predicted observations stand beside what was seen, at the times at which it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.observation import ObservedObject
from intuitive_physics.simulation import make_simulator
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_cli.evaluation.prediction_case import predict_cases
from intuitive_physics_experiments.paper.paper_dataset import POSITION_NOISE, make_paper_dataset


def test_the_truth_predicts_what_was_seen():
    made = make_paper_dataset(3, 3, np.random.default_rng(2)).with_initial_states("true")
    rng = np.random.default_rng(0)
    cases = predict_cases(made.observations, made.parameters, make_simulator("auto"), rng, 3)
    assert len(cases) == 9
    for case in cases:
        # Known exactly: all samples are one, and what is left is noise, σ √(8/π) in the mean.
        assert case.spread == pytest.approx(np.zeros(case.times.size), abs=1e-12)
        assert case.error == pytest.approx(POSITION_NOISE * np.sqrt(8.0 / np.pi), rel=0.25)
        assert case.samples.shape == (3, case.times.size, 3)


def test_objects_seen_at_times_of_their_own_keep_them():
    made = make_paper_dataset(4, 4, np.random.default_rng(1)).with_initial_states("true")
    several = next(one for one in made.observations if len(one.objects) > 1)
    first, second, *_ = several.objects
    thinned = Trajectory(second.trajectory.times[::3], second.trajectory.positions[::3])
    both = replace(
        several, objects=(first, ObservedObject(second.object, thinned, second.initial_state))
    )
    (_, case) = predict_cases(
        [both], made.parameters, make_simulator("auto"), np.random.default_rng(0), 2
    )
    # The first point is the initial state itself.
    assert np.array_equal(case.times, thinned.times[1:])
    assert np.array_equal(case.observed, thinned.positions[1:])
