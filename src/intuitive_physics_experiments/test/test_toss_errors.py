from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics_experiments.recorded_sets.cube_tosses import CubeToss, cube_tosses
from intuitive_physics_experiments.recorded_sets.toss_evaluation import (
    FAILED_DISTANCE,
    TossBatch,
    rotation_angles,
)

WIDTH = 0.1
angles = st.floats(0.0, np.pi)
vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


def still_tosses(*steps: int) -> list[CubeToss]:
    """Cubes that hang still, seen so many times after the first row."""
    count = sum(steps) + len(steps)
    return cube_tosses(
        {
            "position": np.tile([0.0, 0.0, 1.0], (count, 1)),
            "quaternion_wxyz": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            "velocity_world": np.zeros((count, 3)),
            "angular_velocity_body": np.zeros((count, 3)),
            "offsets": np.cumsum([0, *(n + 1 for n in steps)]),
            "dt": 0.01,
            "cube_edge": WIDTH,
        }
    )


def test_errors_are_means_over_the_steps_after_the_first_row():
    batch = TossBatch(still_tosses(4, 2))
    positions = np.tile([0.0, 0.0, 1.0], (2, 4, 1))
    positions[0, :, 0] = [0.01, 0.02, 0.03, 0.04]
    positions[1, :2, 1] = [0.0, 0.1]
    # What is said of the time after a toss's end does not count.
    positions[1, 2:] = np.nan
    turns = np.array([[0.1, 0.2, 0.3, 0.4], [np.pi / 2, np.pi, np.nan, np.nan]])
    orientations = np.zeros((2, 4, 4))
    orientations[..., 0], orientations[..., 3] = np.sin(turns / 2), np.cos(turns / 2)
    errors = batch.errors(positions, orientations)
    assert errors.position == pytest.approx([0.25, 0.5])
    assert errors.rotation == pytest.approx([0.25, 0.75 * np.pi])


def test_a_step_that_was_not_simulated_counts_as_far_away():
    batch = TossBatch(still_tosses(2))
    positions = np.tile([0.0, 0.0, 1.0], (1, 2, 1))
    orientations = np.tile([0.0, 0.0, 0.0, 1.0], (1, 2, 1))
    positions[0, 1] = orientations[0, 1] = np.nan
    errors = batch.errors(positions, orientations)
    assert errors.position == pytest.approx([0.5 * FAILED_DISTANCE / WIDTH])
    assert errors.rotation == pytest.approx([0.5 * np.pi])


@given(vector=vectors, axis=vectors.filter(lambda v: np.linalg.norm(v) > 0.1), angle=angles)
def test_the_angle_of_a_turn_is_found(vector, axis, angle):
    first = Rotation.from_rotvec(vector)
    turn = Rotation.from_rotvec(angle * np.array(axis) / np.linalg.norm(axis))
    a, b = first.as_quat(), (turn * first).as_quat()
    # Quaternions are rounded to about 1e-16, and an angle is twice theirs.
    assert rotation_angles(a, b) == pytest.approx(angle, abs=1e-14)
    assert rotation_angles(a, -b) == pytest.approx(angle, abs=1e-14)
    assert rotation_angles(b, a) == pytest.approx(angle, abs=1e-14)
