from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.evaluation.evaluation import evaluate, split
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.search.convergence import ConvergenceCriteria

from .bouncing_balls import TRUE, bounces


def test_the_parameters_that_made_the_data_are_learned_and_predict_the_rest() -> None:
    options = LearningOptions(criteria=ConvergenceCriteria(max_iterations=600), seed=1)
    found = evaluate(bounces(5), options, train_fraction=0.6)
    assert (len(found.training), len(found.test)) == (3, 2)
    learned_training, learned_test = found.errors["learned parameters"]
    default_training, default_test = found.errors["default parameters"]
    flight_training, flight_test = found.errors["free flight"]
    assert learned_test.mean < 0.1 * default_test.mean < flight_test.mean
    assert learned_training.mean == pytest.approx(found.result.learned.cost, abs=1e-9)
    assert learned_training.last < default_training.last < flight_training.last
    pair = found.result.learned.parameters.pair("rubber", "room")
    assert pair["restitution"] == pytest.approx(0.85, abs=0.03)


def test_it_starts_from_the_parameters_it_is_given() -> None:
    options = LearningOptions(criteria=ConvergenceCriteria(max_iterations=1), seed=1)
    found = evaluate(bounces(3), options, train_fraction=0.6, start=TRUE.with_density("rubber", 80))
    # Nothing is better than what made the observations, and a lone ball's density tells nothing.
    assert found.result.learned.parameters.density[0] == 80
    assert found.errors["default parameters"][1].mean < 1e-9


@given(count=st.integers(2, 50), share=st.floats(0.01, 0.99), seed=st.integers(0, 99))
def test_a_split_uses_everything_once(count: int, share: float, seed: int) -> None:
    items = list(range(count))
    training, test = split(items, share, seed)  # type: ignore[arg-type]
    assert sorted(training + test) == items
    assert training
    assert test
    assert split(items, share, seed) == (training, test)  # type: ignore[arg-type]


@pytest.mark.parametrize(("count", "share"), [(1, 0.5), (0, 0.5), (5, 0.0), (5, 1.0), (5, np.nan)])
def test_what_cannot_be_split_is_refused(count: int, share: float) -> None:
    with pytest.raises(InvalidInputError):
        split(list(range(count)), share, 0)  # type: ignore[arg-type]
