"""Eqs. 5, 6 and 7."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.trajectory import Trajectory, max_distance, mean_distance, synchronise


def line(times, velocity=(1.0, 2.0, -1.0), start=(0.0, 0.0, 0.0)):
    times = np.asarray(times, dtype=float)
    return Trajectory(times, np.asarray(start) + np.outer(times, velocity))


@given(
    st.lists(st.floats(0.0, 10.0), min_size=2, max_size=20, unique=True),
    st.floats(-3, 3),
    st.floats(-3, 3),
)
def test_interpolation_of_a_line_is_exact(times, dx, dy):
    # Eq. 5 is linear, so two samplings of parallel lines are |Δ| apart at every time.
    times = sorted(times)
    if np.diff(times).min() < 1e-6:
        return
    a = line(times)
    b = line([-1.0, 0.3, 2.2, 11.0], start=(dx, dy, 0.0))
    gap = np.hypot(dx, dy)
    assert mean_distance(a, b) == pytest.approx(gap, abs=1e-9)
    assert max_distance(a, b) == pytest.approx(gap, abs=1e-9)


def test_distances_of_a_worked_example():
    # At 0, 1, 2 s the distances are 0, 1 (interpolated between 0 and 2) and 2.
    a = Trajectory([0, 1, 2], np.zeros((3, 3)))
    b = Trajectory([0, 2], [[0, 0, 0], [0, 2, 0]])
    assert mean_distance(a, b) == pytest.approx(1.0)
    assert max_distance(a, b) == pytest.approx(2.0)


@given(st.integers(2, 30), st.integers(0, 2**31))
def test_mean_is_at_most_max_and_zero_to_itself(n, seed):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.01, 1, n))
    a = Trajectory(times, rng.normal(size=(n, 3)))
    b = Trajectory(times, rng.normal(size=(n, 3)))
    assert 0 <= mean_distance(a, b) <= max_distance(a, b)
    assert max_distance(a, a) == 0


def test_points_outside_the_other_span_are_left_out():
    a, c = synchronise(line([0, 1, 2, 3]), line([0.5, 2.5]))
    assert a.times.tolist() == [1, 2]
    assert c.times.tolist() == [1, 2]
    with pytest.raises(InvalidInputError, match="overlap"):
        synchronise(line([0, 1]), line([2, 3]))


@pytest.mark.parametrize(
    ("times", "positions", "word"),
    [
        ([0, 0], np.zeros((2, 3)), "increase"),
        ([1, 0], np.zeros((2, 3)), "increase"),
        ([], np.zeros((0, 3)), "empty"),
        ([0, 1], np.zeros((3, 3)), "shape"),
        ([0, 1], [[0, 0, np.nan], [0, 0, 0]], "not finite"),
        ([0, np.inf], np.zeros((2, 3)), "not finite"),
        ("ab", np.zeros((2, 3)), "expected"),
    ],
)
def test_bad_trajectories_are_refused(times, positions, word):
    with pytest.raises(InvalidInputError, match=word):
        Trajectory(times, positions)


def test_a_trajectory_cannot_be_changed_behind_its_back():
    times = np.array([0.0, 1.0])
    t = Trajectory(times, np.zeros((2, 3)))
    times[0] = 5.0
    assert t.times[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        t.positions[0, 0] = 1.0
