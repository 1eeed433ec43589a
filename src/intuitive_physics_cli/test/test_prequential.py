"""Predictions know only what was learned from observations before theirs."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.simulation import make_simulator
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_cli.evaluation.prequential import predict_before_learning
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.search.convergence import ConvergenceCriteria

from .thrown_balls import thrown_balls

OPTIONS = LearningOptions(criteria=ConvergenceCriteria(max_iterations=150))
BALLS = thrown_balls(5, np.random.default_rng(0))


def predicted(balls) -> list[PredictionCase]:
    rng = np.random.default_rng(1)
    found = predict_before_learning(balls, OPTIONS, make_simulator("auto"), rng, 30)
    assert found.left_out == 0
    return list(found.cases)


@pytest.fixture(scope="module")
def cases() -> list[PredictionCase]:
    return predicted(BALLS)


def test_later_observations_change_nothing(cases: list[PredictionCase]) -> None:
    # The second is predicted with what the first taught, the third and fourth with the first two.
    other = thrown_balls(5, np.random.default_rng(7))
    for count in (1, 2, 4):
        again = predicted([*BALLS[:count], *other[count:]])
        for ours, theirs in zip(cases[:count], again[:count], strict=True):
            np.testing.assert_array_equal(ours.samples, theirs.samples)


def test_the_order_of_time_counts(cases: list[PredictionCase]) -> None:
    again = predicted(BALLS[::-1])
    assert [case.name for case in cases] == [case.name for case in again]
    np.testing.assert_array_equal(cases[-1].samples, again[-1].samples)


def test_what_was_learned_makes_predictions_sharper(cases: list[PredictionCase]) -> None:
    # Of the same ball, with nothing known of its restitution. Spreads of 30 samples are true to a
    # tenth each, and the spin, which nothing is learned of, is part of all.
    later = [spread_within_a_second(case) for case in cases[2:]]
    alone = [spread_within_a_second(predicted(BALLS[k : k + 1])[0]) for k in range(2, len(BALLS))]
    assert sum(later) < 0.95 * sum(alone)


def spread_within_a_second(case: PredictionCase) -> float:
    """Return the spread, m, at the last point before 1 s."""
    return float(case.spread[case.times < 1.0][-1])
