from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.recorded_sets.cube_tosses import cube_tosses
from intuitive_physics_experiments.recorded_sets.toss_evaluation import (
    FrictionAndRestitution,
    TossErrors,
    evaluate_tosses,
    toss_cost,
)
from intuitive_physics_experiments.recorded_sets.toss_tables import toss_table
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.search.convergence import ConvergenceCriteria

TossArrays = Callable[..., dict[str, Any]]
OPTIONS = LearningOptions(method="cma_es", criteria=ConvergenceCriteria(max_iterations=80), seed=2)


@pytest.mark.parametrize("engine", ["stepped", "bullet"])
def test_the_coefficients_that_made_the_tosses_are_found(toss_arrays, engine):
    tosses = cube_tosses(toss_arrays(8, engine, friction=0.2, restitution=0.3))
    found = evaluate_tosses(tosses, [engine], OPTIONS, train_fraction=0.5)
    assert (len(found.training), len(found.test)) == (4, 4)
    fit = found.fits[engine]
    pair = fit.search.parameters.pair("cube", "table")
    assert pair["static_friction"] == pair["dynamic_friction"]
    assert pair["static_friction"] == pytest.approx(0.2, abs=0.02)
    assert pair["restitution"] == pytest.approx(0.3, abs=0.02)
    assert fit.search.cost == pytest.approx(toss_cost(fit.fitted[0], 0.1), rel=1e-9)
    for part in range(2):
        fitted, default = fit.fitted[part].position.mean(), fit.default[part].position.mean()
        assert fitted < 0.2 * default < default < found.free_flight[part].position.mean()
    assert f"{engine}, fitted" in toss_table(found)


def test_mujoco_is_fitted_in_its_softness_too(toss_arrays):
    tosses = cube_tosses(toss_arrays(2, "stepped"))
    options = LearningOptions(
        method="cma_es", criteria=ConvergenceCriteria(max_iterations=16), seed=2
    )
    fit = evaluate_tosses(tosses, ["mujoco"], options, train_fraction=0.5).fits["mujoco"]
    assert fit.search.cost < toss_cost(fit.default[0], 0.1)
    assert fit.simulator.name == "mujoco"


def test_the_cost_is_distance_plus_turn_of_a_face():
    # Width 0.1 m: 0.2 widths are 20 mm, and 0.5 rad move a face's middle by 25 mm.
    errors = TossErrors(np.array([[0.1, 0.3]]), np.array([[0.0, 1.0]]))
    assert toss_cost(errors, 0.1) == pytest.approx([0.045])


@given(point=st.tuples(*[st.floats(-0.5, 1.5)] * 2))
def test_every_point_is_one_friction_and_one_restitution(point):
    pair = FrictionAndRestitution().to_parameters(point).pair("cube", "table")
    friction, restitution = np.clip(point, 0.0, 1.0)
    assert pair == {
        "static_friction": friction,
        "dynamic_friction": friction,
        "rolling_friction": 0.0,
        "restitution": restitution,
    }


def test_one_toss_is_too_few(toss_arrays):
    with pytest.raises(InvalidInputError, match="at least 2"):
        evaluate_tosses(cube_tosses(toss_arrays(1)), ["stepped"], OPTIONS)
