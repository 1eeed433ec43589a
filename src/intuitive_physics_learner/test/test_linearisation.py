"""Slopes are derivatives, and bends say how far the linearisation is wrong a deviation away."""

import numpy as np
import pytest

from intuitive_physics_learner.joint_estimation.linearisation import (
    SMALLEST_PARAMETER_DIFFERENCE,
    ParameterSteps,
    difference_steps,
    linearise,
    residuals_at,
    separate_groups,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import observation_blocks

DEVIATION = 0.06
"""Deviation of each parameter, in widths; half of it is the step."""

E = 3
"""Index of the only parameter that has an effect."""


def linearised(task, deviation=DEVIATION):
    """Linearise at the task's start; return it with the block and |v| (W,) of its balls."""
    influence = task.influence[:, task.active]
    (block,) = observation_blocks(task.cost.observations, influence)
    deviations = np.full(task.begin.size, deviation)
    groups = separate_groups(influence)
    steps = ParameterSteps(task.begin, deviations, groups, task.searched.to_parameters)
    estimate = np.zeros_like(block.prior_deviations)
    linear = linearise(task.cost, block, estimate, block.prior_deviations, steps, block.durations)
    velocities = [o.objects[0].initial_state.linear_velocity for o in task.cost.observations]
    return linear, block, np.array(velocities)


@pytest.mark.parametrize(
    ("effect", "slope", "bend"),
    [
        (lambda e: e, 1.0, 0.0),
        # Sides of slope 2 e ± h differ by 2 h, of which half a deviation away counts.
        (np.square, 1.0, 0.5 * DEVIATION * DEVIATION),
        # A kink from slope -1 to 1 is wrong by a whole deviation.
        (lambda e: np.abs(e - 0.5), 0.0, DEVIATION),
    ],
)
def test_slopes_and_linearisation_error_of_known_functions(gliding_task, effect, slope, bend):
    linear, block, velocities = linearised(gliding_task([0.5, 0.5], effect=effect))
    paths = velocities[:, None] * block.times[..., None]
    np.testing.assert_allclose(linear.slopes[:, E], slope * paths, atol=1e-9)
    np.testing.assert_allclose(linear.slopes[:, :E], 0.0, atol=1e-9)
    np.testing.assert_allclose(linear.bends, bend * np.linalg.norm(paths, axis=2), atol=1e-9)


def test_what_is_known_well_has_the_slopes_of_a_rough_function_over_a_wider_step(gliding_task):
    # f(e) = e + a sin(k e) has the derivative 1 + a k cos(k e), here up to 2. Over ±h its slope
    # differs from 1 by a / h at most.
    amplitude, frequency, step = 1e-6, 1e6, SMALLEST_PARAMETER_DIFFERENCE
    task = gliding_task([0.5], effect=lambda e: e + amplitude * np.sin(frequency * e))
    linear, block, velocities = linearised(task, deviation=1e-9)
    paths = velocities[:, None] * block.times[..., None]
    error = np.abs(linear.slopes[:, E] - paths)
    assert (error <= amplitude / step * np.abs(paths) + 1e-9).all()
    # Both sides differ by 2 a / h at most, half of which counts over the 2 h that are looked at.
    assert linear.bends.max() <= 2.0 * amplitude * np.linalg.norm(paths, axis=2).max()


def test_initial_positions_move_all_points(gliding_task):
    linear, block, _ = linearised(gliding_task([0.5], position_deviation=0.01))
    for axis in range(3):
        expected = np.zeros(3)
        expected[axis] = 1.0
        np.testing.assert_allclose(
            linear.slopes[0, axis], np.tile(expected, (block.times.shape[1], 1)), atol=1e-9
        )


def test_residuals_of_a_linear_motion_follow_the_slopes(gliding_task):
    task = gliding_task([0.5, 0.7], position_deviation=0.01)
    linear, block, _ = linearised(task)
    moved = task.begin.copy()
    moved[E] += 0.1
    states = np.full((1, 2, 3), 0.02)
    got = residuals_at(
        task.cost,
        block,
        states,
        [task.searched.to_parameters(moved)],
        np.zeros((1, 1), dtype=int),
        block.durations,
    )
    change = 0.02 * linear.slopes[:, :3].sum(axis=1) + 0.1 * linear.slopes[:, 3 + E]
    np.testing.assert_allclose(got[0], linear.residuals + change, atol=1e-9)


def test_points_that_are_not_simulated_have_no_slope(gliding_task):
    # One step up from 0.985 the engine fails.
    task = gliding_task([0.5])
    begin = task.begin.copy()
    begin[E] = 0.985
    influence = task.influence[:, task.active]
    (block,) = observation_blocks(task.cost.observations, influence)
    steps = ParameterSteps(
        begin, np.full(4, DEVIATION), separate_groups(influence), task.searched.to_parameters
    )
    still = np.zeros((1, 0))
    linear = linearise(task.cost, block, still, still, steps, block.durations)
    assert not linear.valid.any()
    assert (linear.slopes == 0.0).all()
    assert np.isfinite(linear.residuals).all()


def test_steps_are_parts_of_deviations_within_limits():
    got = difference_steps(np.array([0.0, 1e-3, 0.04, 10.0]))
    np.testing.assert_allclose(got, [1e-6, 5e-4, 0.02, 0.05])
