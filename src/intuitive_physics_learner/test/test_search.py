"""Algorithm 1 and its convergence criteria."""

import json
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner import (
    FURTHER_RULES,
    UPDATE_RULES,
    ConvergenceCriteria,
    ParameterSearch,
    StopReason,
    make_update_rule,
)
from intuitive_physics_learner.search.parameter_search import LARGEST_BATCH

SPACE = ParameterSpace(("stone",))


def bowl(candidates):
    """A cost in m with its lowest, 0, where the restitution is 0.3."""
    return np.array([abs(theta.coefficients[3, 0, 0] - 0.3) for theta in candidates])


def search_of(method="random", cost=bowl, seed=0, start=None):
    rule = make_update_rule(method, SPACE.size, np.random.default_rng(seed), start)
    return ParameterSearch(cost, SPACE, rule)


@settings(max_examples=20)
@given(
    method=st.sampled_from(sorted(UPDATE_RULES)),
    seed=st.integers(0, 100),
    iterations=st.integers(1, 300),
)
def test_keeps_the_best_and_counts_every_evaluation(method, seed, iterations):
    evaluated = []

    def cost(candidates):
        costs = bowl(candidates)
        evaluated.extend(costs)
        return costs

    result = search_of(method, cost, seed).run(ConvergenceCriteria(iterations))
    assert result.stop_reason is StopReason.MAX_ITERATIONS
    assert result.iterations == len(evaluated) == iterations
    assert (result.history == np.minimum.accumulate(evaluated)).all()
    assert result.cost == min(evaluated) == bowl([result.parameters])[0]


def test_cost_threshold():
    result = search_of("cma_es").run(ConvergenceCriteria(10_000, cost_threshold=1e-3))
    assert result.stop_reason is StopReason.COST_THRESHOLD
    assert result.cost < 1e-3
    assert result.iterations < 2000


def test_iterations_without_gain():
    start = SPACE.to_unit(
        SPACE.to_parameters(np.full(5, 0.5)).with_pair("stone", "stone", restitution=0.3)
    )
    result = search_of("random", start=start).run(
        ConvergenceCriteria(10_000, max_iterations_without_gain=200)
    )
    assert result.stop_reason is StopReason.NO_GAIN
    # Evaluated in batches of up to 50 after the start.
    assert 201 <= result.iterations <= 251


def test_gains_that_are_too_small_do_not_count():
    costs = iter(1.0 - 1e-6 * np.arange(10_000))
    search = search_of("random", lambda some: np.array([next(costs) for _ in some]))
    result = search.run(ConvergenceCriteria(5000, max_iterations_without_gain=50))
    assert result.stop_reason is StopReason.NO_GAIN


def test_time_limit():
    batches = []

    def slow(candidates):
        began = time.monotonic()
        time.sleep(0.02)
        batches.append(time.monotonic() - began)
        return bowl(candidates)

    result = search_of("random", slow).run(ConvergenceCriteria(None, time_limit=0.1))
    assert result.stop_reason is StopReason.TIME_LIMIT
    assert result.seconds >= 0.1
    # Between the last two looks at the time only one batch was begun.
    assert sum(batches[:-1]) < 0.1


def test_ends_when_there_is_nothing_left_to_try():
    rule = make_update_rule("grid", SPACE.size, np.random.default_rng(0), increment=0.5)
    result = ParameterSearch(bowl, SPACE, rule).run(ConvergenceCriteria(1000))
    assert result.stop_reason is StopReason.EXHAUSTED
    assert result.iterations == 2**5


def test_progress_reports_every_cost_once():
    reports = []
    result = search_of("cma_es").run(ConvergenceCriteria(130), on_progress=reports.append)
    assert [cost for progress in reports for cost in progress.new_costs] == result.history.tolist()
    assert [progress.iteration for progress in reports] == [20, 40, 60, 80, 100, 120, 130]
    assert reports[-1].best_cost == result.cost
    assert reports[-1].seconds_left == 0.0


@settings(max_examples=40)
@given(
    method=st.sampled_from(sorted({**UPDATE_RULES, **FURTHER_RULES})),
    seed=st.integers(0, 1000),
    start=st.sampled_from([None, [0.9, 0.2, 0.5, 1.0, 0.4]]),
    iterations=st.integers(1, 500),
)
def test_resumes_exactly_wherever_it_stopped(method, seed, start, iterations):
    longer = ConvergenceCriteria(iterations + 120)
    whole = search_of(method, seed=seed, start=start).run(longer)
    stopped = search_of(method, seed=seed, start=start)
    stopped.run(ConvergenceCriteria(iterations))
    resumed = search_of(method, seed=seed, start=start)
    resumed.load_state(json.loads(json.dumps(stopped.state(), allow_nan=False)))
    assert resumed.best_cost == stopped.best_cost
    result = resumed.run(longer)
    assert (result.history == whole.history).all()
    assert (result.parameters.coefficients == whole.parameters.coefficients).all()


def test_costs_of_another_search_are_refused():
    rule = make_update_rule("grid", SPACE.size, np.random.default_rng(0), increment=0.5)
    search = ParameterSearch(bowl, SPACE, rule)
    with pytest.raises(InvalidInputError, match="8 costs are left"):
        search.load_state({"costs": [1.0] * 40})


@pytest.mark.parametrize(
    ("criteria", "message"),
    [
        ({"max_iterations": 0}, "max_iterations is 0"),
        ({"max_iterations_without_gain": -3}, "max_iterations_without_gain is -3"),
        ({"cost_threshold": float("nan")}, "cost_threshold is nan"),
        ({"time_limit": -1.0}, "time_limit is -1"),
        ({"max_iterations": None}, "nothing bounds the search"),
    ],
)
def test_criteria_are_checked(criteria, message):
    with pytest.raises(InvalidInputError, match=message):
        ConvergenceCriteria(**criteria)


def test_a_rule_of_another_size_is_refused():
    rule = make_update_rule("random", 3, np.random.default_rng(0))
    with pytest.raises(InvalidInputError, match="searches 3 parameters; expected 5"):
        ParameterSearch(bowl, SPACE, rule)


def test_nothing_is_best_before_the_first_evaluation():
    with pytest.raises(InvalidInputError, match="nothing was evaluated"):
        _ = search_of().best_parameters


def test_leaves_the_time_that_is_reserved():
    criteria = ConvergenceCriteria(10_000, time_limit=1000.0)
    result = search_of("random").run(criteria, reserve=lambda seconds: 1000.0)
    assert result.stop_reason is StopReason.TIME_LIMIT
    assert result.iterations == LARGEST_BATCH
