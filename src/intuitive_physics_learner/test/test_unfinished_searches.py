"""Searches that an earlier version of the program left unfinished continue in this one."""

import json
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.methods import JOINT_METHOD, METHODS, make_search
from intuitive_physics_learner.search.learning_task import LearningTask

SAVED = json.loads((Path(__file__).parent / "data" / "unfinished_searches.json").read_text())
"""States of searches in November 2026, of every method; histories cut to their last five."""


def test_there_is_one_of_every_method_of_then():
    """A method that came later has no state of an earlier version."""
    methods = {saved["method"] for saved in SAVED}
    assert len(methods) == 13
    assert methods <= set(METHODS)


@pytest.mark.parametrize("saved", SAVED, ids=lambda saved: saved["method"])
def test_a_saved_state_is_restored_and_continues(event_driven, throws, saved):
    observed = throws(*saved["throws"])
    cost = TrajectoryCost(observed, event_driven)
    influence = parameter_influence(observed, cost.materials)
    start = StaticParameters.uniform(cost.materials)
    task = LearningTask(cost, ParameterSpace(cost.materials), influence, start)
    search = make_search(saved["method"], task, np.random.default_rng(7))
    search.load_state(saved["search"])
    expected = saved["search"]
    if saved["method"] == "adaptive_random":
        # The rule had bounds of its step then, which are ignored.
        expected = {**expected, "rule": {**expected["rule"], "settings": {}}}
    if saved["method"] == JOINT_METHOD:
        # All observations had the same weight then, all were fitted jointly from the beginning, and
        # priors of initial spins were never widened.
        fit = expected["fit"]
        fits = [{**one, "weights": [1.0] * len(one["horizons"])} for one in fit["fits"]]
        fit = {**fit, "fits": fits, "staged_steps": fit["steps"], "separate": []}
        fit["spins"] = {}
        expected = {**expected, "fit": fit}
    assert search.state_dict() == expected
    assert search.step(20) > 0
    assert search.iterations > 5
    assert np.isfinite(search.best_cost)
