"""All update rules keep the ask/tell promise, and each is the rule of Sec. III-D and Table I."""

import builtins

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics_learner import (
    FURTHER_RULES,
    UPDATE_RULES,
    MissingDependencyError,
    UnknownMethodError,
    make_update_rule,
)

from .rule_cases import bowl, proposed

RULES = sorted({**UPDATE_RULES, **FURTHER_RULES})
SHORT = {
    "hybrid": {"random_iterations": 30},
    "hybrid_random": {"random_iterations": 30, "sweeps": 1},
}
"""Settings with which a rule passes through all it does in a few hundred candidates."""


def rule_of(name, size=4, seed=0, start=None):
    return make_update_rule(name, size, np.random.default_rng(seed), start, **SHORT.get(name, {}))


@pytest.mark.parametrize("name", RULES)
@settings(max_examples=10)
@given(limits=st.lists(st.integers(1, 60), min_size=1, max_size=200))
def test_candidates_do_not_depend_on_how_many_are_asked_for(name, limits):
    rule, got = rule_of(name), []
    for limit in limits:
        points = rule.ask(limit)
        assert 1 <= len(points) <= limit
        rule.tell(bowl(points))
        got.append(points)
    got = np.concatenate(got)
    assert (got == proposed(rule_of(name), len(got))).all()
    assert ((got >= 0.0) & (got <= 1.0)).all()


@pytest.mark.parametrize("name", RULES)
def test_start_comes_first(name):
    start = [0.9, 0.2, 0.5, 1.0]
    assert (proposed(rule_of(name, start=start), 1) == [start]).all()


@pytest.mark.parametrize("name", sorted(set(RULES) - {"grid", "random"}))
def test_finds_the_lowest(name):
    points = proposed(rule_of(name), 1500)
    assert bowl(points).min() < 0.03


@pytest.mark.parametrize("name", RULES)
def test_order_of_ask_and_tell(name):
    rule = rule_of(name)
    with pytest.raises(InvalidInputError, match="at least 1"):
        rule.ask(0)
    points = rule.ask(3)
    with pytest.raises(InvalidInputError, match="were given"):
        rule.ask(3)
    with pytest.raises(InvalidInputError, match="shape"):
        rule.tell(np.zeros(len(points) + 1))
    with pytest.raises(InvalidInputError, match="not finite"):
        rule.tell(np.full(len(points), np.nan))
    rule.tell(bowl(points))


def test_unknown_rule():
    with pytest.raises(UnknownMethodError, match=r"'annealing'.*cma_es"):
        make_update_rule("annealing", 2, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"increment": -1}, "increment of grid is -1"),
        ({"step": 0.1}, "setting of grid is 'step'; expected increment"),
    ],
)
def test_settings_are_those_of_the_rule_and_above_zero(settings, message):
    with pytest.raises((InvalidInputError, UnknownNameError), match=message):
        make_update_rule("grid", 2, np.random.default_rng(0), **settings)


@given(increment=st.floats(0.01, 1.0))
def test_levels_are_the_inverse_of_the_increment_many_and_centred(increment):
    rule = make_update_rule("grid", 1, np.random.default_rng(0), increment=increment)
    levels = proposed(rule, 1000)[:, 0]
    assert len(levels) == int(1.0 / increment + 1e-9)
    np.testing.assert_allclose(np.diff(levels), increment, rtol=1e-9)
    np.testing.assert_allclose(levels + levels[::-1], 1.0, rtol=1e-12)
    assert 0.0 < levels[0] <= levels[-1] < 1.0


def test_cma_es_leaves_the_global_generator_alone():
    np.random.seed(1)  # noqa: NPY002
    expected = np.random.random()  # noqa: NPY002
    np.random.seed(1)  # noqa: NPY002
    proposed(rule_of("cma_es"), 100)
    assert np.random.random() == expected  # noqa: NPY002


def test_cma_es_ends_when_it_has_converged():
    rule = rule_of("cma_es", size=2)
    points = proposed(rule, 20_000)
    assert len(points) < 20_000
    assert len(rule.ask(10)) == 0
    assert bowl(points).min() < 1e-6


def test_cma_es_without_pycma(monkeypatch):
    real = builtins.__import__

    def without_cma(name, *args, **kwargs):
        if name == "cma":
            raise ImportError("No module named 'cma'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without_cma)
    with pytest.raises(MissingDependencyError, match="pip install cma"):
        rule_of("cma_es")
