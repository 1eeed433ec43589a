"""Each update rule is that of Sec. III-D, sentence by sentence, with the settings of Table I.

A sentence of the paper stands above the test that holds a rule to it.
"""

import numpy as np
import pytest

from intuitive_physics_learner import UPDATE_RULES, make_update_rule

from .rule_cases import bowl, proposed

TABLE_I = {
    "grid": {"increment": 0.05},
    "random": {},
    "coordinate_descent": {"increment": 0.05},
    "parameter_gradient": {"learning_rate": 0.1, "smallest_step": 0.001},
    "adaptive_random": {},
    "hybrid": {"random_iterations": 300, "learning_rate": 0.1, "smallest_step": 0.001},
    "hybrid_random": {
        "sweeps": 5,
        "random_iterations": 300,
        "learning_rate": 0.1,
        "smallest_step": 0.001,
    },
    "metropolis_hastings": {"learning_rate": 0.05, "temperature": 0.001},
    "cma_es": {"step_size": 0.2, "population": 20},
}
"""Table I, and the temperature that the paper does not give. It gives adaptive random search an α
and a β that the text does not use: those are of `bounded_adaptive_random`."""

LEVELS = 0.025 + 0.05 * np.arange(20)
"""The 1/δp = 20 values of a parameter."""


def rule_of(name, size=4, seed=0, start=None, **settings):
    return make_update_rule(name, size, np.random.default_rng(seed), start, **settings)


def moved(points, origin):
    """Indices of the coordinates (n,) in which a point differs from another."""
    return np.flatnonzero(points != origin)


def test_the_nine_have_the_settings_of_table_1():
    assert {name: rule.defaults for name, rule in UPDATE_RULES.items()} == TABLE_I


# "Tests all possible parameter combinations changing one value at a time with a fixed increment
# δp. […] n is the number of parameters and δp⁻¹ the possible values for each parameter."
def test_grid_search():
    points = proposed(rule_of("grid", 2), 1000)
    assert len(points) == len(np.unique(points, axis=0)) == 20**2
    for k, point in enumerate(points):
        np.testing.assert_allclose(point, [LEVELS[k % 20], LEVELS[k // 20]], rtol=1e-12)


# "All the parameter values are randomly generated from a uniform distribution over each parameter
# minimum and maximum values."
def test_random_search():
    points = proposed(rule_of("random", 3), 4000)
    # Means and variances of a uniform distribution, within four standard errors.
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=4 * np.sqrt(1 / 12 / 4000))
    np.testing.assert_allclose(points.var(axis=0), 1 / 12, atol=4 * np.sqrt(1 / 180 / 4000))
    # Nothing that was found changes what follows.
    other = proposed(rule_of("random", 3), 4000, costs=lambda p: -bowl(p))
    assert (points == other).all()


# "Similar to grid search, but sweeps parameters one by one without testing all combinations. The
# number of iterations required is n · δp⁻¹ for each sweep of all the parameters. The order used to
# modify the parameters is randomly generated before each sweep."
def test_coordinate_descent():
    start = np.full(4, 0.9)
    points = proposed(rule_of("coordinate_descent", start=start), 1 + 2 * 4 * 20)[1:]
    current, orders = start.copy(), []
    for sweep in points.reshape(2, 4, 20, 4):
        order = []
        for tried in sweep:
            target = np.flatnonzero(np.ptp(tried, axis=0))
            assert len(target) == 1
            np.testing.assert_allclose(tried[:, target[0]], LEVELS)
            assert all(set(moved(point, current)) <= set(target) for point in tried)
            costs = bowl(tried)
            if costs.min() < bowl(current[None])[0]:
                current = tried[costs.argmin()]
            order.append(int(target[0]))
        assert sorted(order) == [0, 1, 2, 3]
        orders.append(order)
    all_orders = {tuple(rule_of("coordinate_descent", seed=s)._order) for s in range(20)}
    assert len(all_orders) > 5


# "The first iteration uses random search. For the rest, a random parameter is targeted and the
# increment is set to the learning rate δp = α. The parameter is updated with δp. Subsequent
# iterations continue adding the same δp if the cost was reduced. Otherwise δp = -δp/2. If δp is
# below a configurable threshold β the next parameter is targeted."
def test_parameter_gradient_search():
    rule = rule_of("parameter_gradient")
    random = rule_of("parameter_gradient").ask(1)
    current = rule.ask(1)[0]
    assert (current == random[0]).all()
    cost = bowl(current[None])[0]
    rule.tell([cost])
    targets, target, step = [], None, 0.1
    for _ in range(300):
        point = rule.ask(1)[0]
        if target is None:
            step = 0.1
            target = rule._target
            targets.append(target)
        expected = current.copy()
        expected[target] = np.clip(current[target] + step, 0.0, 1.0)
        np.testing.assert_allclose(point, expected, rtol=0, atol=1e-15)
        there = bowl(point[None])[0]
        rule.tell([there])
        if there < cost:
            current, cost = point, there
        else:
            step = -step / 2
            if abs(step) < 0.001:
                target = None
    assert set(targets) == {0, 1, 2, 3}
    assert cost < 0.005


# "The first iteration uses random search. Subsequent iterations use δp = U(-ε, ε) where ε
# corresponds to the previous iteration cost. This strategy adapts the parameter accounting for the
# current cost of the parameter set."
@pytest.mark.parametrize("cost", [0.3, 0.04, 1e-6])
def test_adaptive_random_search(cost):
    size = 4000
    assert (rule_of("adaptive_random", size).ask(1) == rule_of("random", size).ask(1)).all()
    rule = rule_of("adaptive_random", size, start=np.full(size, 0.5))
    rule.tell(np.full(len(rule.ask(1)), cost))
    steps = rule.ask(1)[0] - 0.5
    # Uniform on (-ε, ε), ε = J: the largest of n is within 10 / n of it, the variance is ε² / 3.
    assert (1 - 10 / size) * cost < np.abs(steps).max() <= cost
    np.testing.assert_allclose(steps.var(), cost**2 / 3, rtol=0.08)
    # A candidate that is worse is not the parameter set, and its cost not the current one.
    rule.tell([2.0 * cost])
    assert np.abs(rule.ask(1)[0] - 0.5).max() <= cost


def test_steps_larger_than_the_interval_end_at_its_bounds():
    rule = rule_of("adaptive_random", 4000, start=np.full(4000, 0.5))
    rule.tell(np.full(len(rule.ask(1)), 1.0))
    point = rule.ask(1)[0]
    # U(-1, 1) leaves the interval by either end with the probability 1/4.
    assert np.mean(point == 0.0) == pytest.approx(0.25, abs=4 * np.sqrt(0.1875 / 4000))
    assert np.mean(point == 1.0) == pytest.approx(0.25, abs=4 * np.sqrt(0.1875 / 4000))


@pytest.mark.parametrize(("cost", "largest"), [(10.0, 0.1), (0.04, 0.04), (0.0, 0.001)])
def test_the_bounded_rule_holds_the_step_between_the_bounds_of_table_1(cost, largest):
    rule = rule_of("bounded_adaptive_random", 200, start=np.full(200, 0.5))
    rule.tell(np.full(len(rule.ask(1)), cost))
    steps = np.abs(rule.ask(1)[0] - 0.5)
    assert 0.9 * largest < steps.max() <= largest


# "A combination of parameter gradient search and random search that performs a configurable number
# of random search iterations i for initialization before switching to the parameter gradient update
# rule."
def test_hybrid_search():
    points = proposed(rule_of("hybrid", 50), 301)
    assert (points[:300] == proposed(rule_of("hybrid", 50, random_iterations=9999), 300)).all()
    assert (np.count_nonzero(np.diff(points[:300], axis=0), axis=1) == 50).all()
    best = points[:300][np.argmin(bowl(points[:300]))]
    (target,) = moved(points[300], best)
    assert points[300, target] == min(best[target] + 0.1, 1.0)


# "A variation of the hybrid search that switches to adaptive random search after the desired number
# s of hybrid search sweeps is performed."
def test_hybrid_random_search():
    size, sweeps, initial = 3, 2, 20
    settings = {"sweeps": sweeps, "random_iterations": initial}
    points = proposed(rule_of("hybrid_random", size, **settings), 400)
    hybrid = rule_of("hybrid", size, random_iterations=initial)
    done = 0
    while hybrid._gradient.targets_done < sweeps * size:
        assert (proposed(hybrid, 1) == points[done]).all()
        done += 1
    best = points[:done][np.argmin(bowl(points[:done]))]
    epsilon = bowl(best[None])[0]
    steps = points[done] - best
    assert (steps != 0.0).all()
    assert np.abs(steps).max() <= epsilon


# Fig. 6 with n = 14: random iterations, then five sweeps of at least seven evaluations each
# parameter, as 0.1 / 2⁷ is the first step below 0.001.
def test_hybrid_random_search_switches_after_790_evaluations_at_the_soonest():
    rule = rule_of("hybrid_random", 14)
    proposed(rule, 790, costs=lambda points: np.ones(len(points)))
    assert rule._adaptive.point is not None
    rule = rule_of("hybrid_random", 14)
    proposed(rule, 789, costs=lambda points: np.ones(len(points)))
    assert rule._adaptive.point is None


# "δp is sampled from U(-α, α) where α is the learning rate. On each iteration δp is added to a
# single parameter."
def test_one_dimensional_metropolis_hastings_steps():
    start = np.full(3, 0.5)
    steps = []
    for seed in range(600):
        rule = rule_of("metropolis_hastings", 3, seed, start)
        rule.tell(np.ones(len(rule.ask(1))))
        point = rule.ask(1)[0]
        (target,) = moved(point, start)
        steps.append((target, point[target] - 0.5))
    targets, sizes = np.array(steps).T
    assert np.bincount(targets.astype(int), minlength=3) == pytest.approx(200, abs=50)
    assert np.abs(sizes).max() <= 0.05
    np.testing.assert_allclose(sizes.var(), 0.05**2 / 3, rtol=0.15)


# What the paper leaves to [16]: the chance of acceptance, min(1, exp((J - J') / T)).
def test_one_dimensional_metropolis_hastings_acceptance():
    # With J = x the chain's stationary density is exp(-x / T) on [0, 1]; T = 0.1: mean near 0.1.
    rule = rule_of("metropolis_hastings", 1, temperature=0.1, learning_rate=0.5)
    accepted = []
    for _ in range(6000):
        point = rule.ask(1)
        rule.tell(point[:, 0])
        accepted.append(rule.point[0])
    assert 0.08 < np.mean(accepted[500:]) < 0.12


# "In each iteration a set of λ candidate solutions are generated."
def test_cma_es_generations():
    rule = rule_of("cma_es", 150)
    points = proposed(rule, 20)
    assert rule._generation_count == 1
    # The first generation: a normal distribution of the standard deviation σ about the middle.
    # Bounds bend what would leave the interval, so the middle of the distribution is looked at.
    quartiles = np.quantile(points, (0.25, 0.5, 0.75))
    np.testing.assert_allclose(quartiles, 0.5 + 0.2 * np.array([-0.6745, 0, 0.6745]), atol=0.02)
    # The next one is drawn about the better half.
    better = points[np.argsort(bowl(points))[:10]].mean(axis=0)
    following = proposed(rule, 20).mean(axis=0)
    assert np.corrcoef(following - 0.5, better - 0.5)[0, 1] > 0.5
