"""The descent of J ends where J, a sum of distances, is known to be lowest."""

import json

import numpy as np
import pytest

from intuitive_physics_learner.joint_search.cost_descent import CostDescent


def descent_of(task):
    return CostDescent(task.fit_task)


def run(descent, steps=10_000):
    """Step to the end, and return J in m after each step."""
    costs = []
    while not descent.finished and len(costs) < steps:
        descent.step()
        costs.append(descent.cost)
    return np.array(costs)


def weights_of(task):
    """Distance in m of each trajectory by unit of e: |v| times the mean time."""
    balls = [observation.objects[0] for observation in task.cost.observations]
    speeds = [np.linalg.norm(ball.initial_state.linear_velocity) for ball in balls]
    return np.array(speeds) * np.mean(balls[0].trajectory.times)


def test_search_finds_the_true_parameters(gliding_task):
    task = gliding_task([0.8, 0.8, 0.8])
    descent = descent_of(task)
    descent.take_best(task.begin[None])
    run(descent)
    assert descent.unit[3] == pytest.approx(0.8, abs=1e-3)


def test_ends_at_the_weighted_median(gliding_task):
    # J(e) = Σ w |e - e_i| / n is lowest at the median of the e_i weighted by w, which the mean of
    # least squares is not.
    e = np.array([0.3, 0.35, 0.4, 0.8, 0.9])
    task = gliding_task(e)
    weights = weights_of(task)
    middle = np.searchsorted(np.cumsum(weights), 0.5 * weights.sum())
    expected = (weights * np.abs(e[middle] - e)).mean()
    least_squares = (weights**2 * e).sum() / (weights**2).sum()
    assert abs(least_squares - e[middle]) > 0.05
    descent = descent_of(task)
    descent.take_best(task.begin[None])
    assert descent.cost == pytest.approx((weights * np.abs(0.5 - e)).mean())
    run(descent)
    assert descent.unit[3] == pytest.approx(e[middle], abs=2e-3)
    assert descent.cost == pytest.approx(expected, rel=2e-3)


def test_begins_at_the_best_point_and_never_rises(gliding_task):
    task = gliding_task([0.3, 0.6, 0.9])
    points = np.tile(task.begin, (3, 1))
    points[:, 3] = 0.05, 0.65, 0.95
    descent = descent_of(task)
    descent.take_best(points)
    assert descent.unit[3] == 0.65
    costs = run(descent)
    assert (np.diff(costs) <= 0.0).all()
    there = task.searched.to_parameters(descent.unit)
    assert descent.cost == task.cost.costs([there])[0]


def test_continues_exactly_from_its_state(gliding_task):
    task = gliding_task([0.3, 0.6, 0.9], noise=0.01)
    for before in (1, 4, 12):
        whole = descent_of(task)
        whole.take_best(task.begin[None])
        run(whole, before)
        state = json.loads(json.dumps(whole.state()))
        run(whole, 5)
        resumed = descent_of(task)
        resumed.load_state(state)
        run(resumed, 5)
        assert resumed.state() == whole.state()
