"""Motions followed beyond fit horizons: jumps, velocities, and which throws need a kick."""

import numpy as np
import pytest

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.assessment.undisturbed_motion import (
    JUMP_DISPLACEMENT,
    JUMP_VELOCITY,
    VELOCITY_STEP,
    _jump,
    _states_at,
    undisturbed_misfits,
)
from intuitive_physics_learner.joint_search.joint_search import JointSearch

from .cases import task_of

MATERIALS = ("thing", "floor")
G = np.array([0.0, 0.0, -9.81])
FLOOR = Environment([Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0)], gravity=G)
TIMES = np.arange(75) / 30.0
NOISE = 0.01


def thrown(simulator, shape, generator, kick_at=None):
    """A throw of an object on a floor; kicked at the index of a time, where that is given."""
    thing = SceneObject("thing", "thing", shape)
    turn = generator.normal(size=4)
    velocity = [*generator.uniform(0.5, 2.0, 2), generator.uniform(-0.5, 0.5)]
    state = ObjectState(
        [0.0, 0.0, generator.uniform(0.4, 0.8)],
        turn / np.linalg.norm(turn),
        velocity,
        generator.normal(0.0, 2.0, 3),
    )
    parameters = StaticParameters.uniform(MATERIALS)
    times = TIMES[: kick_at + 1] if kick_at else TIMES
    rollout = simulator.rollout([Scene(FLOOR, (thing,), (state,))], parameters, times)
    positions = rollout.positions[0, 0]
    if kick_at:
        last = ObjectState(
            positions[-1],
            rollout.orientations[0, 0, -1],
            (positions[-1] - positions[-2]) * 30.0 + [-2.5, 1.5, 2.0],
            generator.normal(0.0, 5.0, 3),
        )
        since = TIMES[kick_at:] - TIMES[kick_at]
        after = simulator.rollout([Scene(FLOOR, (thing,), (last,))], parameters, since)
        positions = np.concatenate([positions[:-1], after.positions[0, 0]])
    covariance = np.diag(np.repeat([0.01, 0.05, 0.05, 0.2], 3)) ** 2
    believed = ObjectState(
        state.position, state.orientation, velocity, state.angular_velocity, covariance
    )
    seen = positions + generator.normal(0.0, NOISE, positions.shape)
    return Observation(FLOOR, (ObservedObject(thing, Trajectory(TIMES, seen), believed),), 0.0)


@pytest.mark.parametrize("kick", [25, 60])
@pytest.mark.parametrize("shape", [Sphere(0.1), Box((0.15, 0.2, 0.3))])
def test_a_kick_in_motion_or_at_rest_is_no_undisturbed_motion(event_driven, shape, kick):
    generator = np.random.default_rng(3)
    observed = [thrown(event_driven, shape, generator, kick if k == 2 else None) for k in range(8)]
    cost = TrajectoryCost(observed, event_driven, MATERIALS)
    task = task_of(cost)
    search = JointSearch(task, np.random.default_rng(0))
    for _ in range(12):
        search.step(1000)
    misfits, times = undisturbed_misfits(search.fit, event_driven, np.random.default_rng(1))
    others = np.nan_to_num(np.delete(misfits, 2))
    assert misfits[2] > 3.0 * max(others.max(), 1.5)
    assert TIMES[kick] - 0.4 < times[2] < TIMES[kick] + 0.4


def test_jumps_are_the_ridge_regression_of_offsets():
    """With x = (a, b), (Aᵀ W A + P) x = Aᵀ W r for A = [1 t], P of the priors."""
    generator = np.random.default_rng(0)
    times = np.arange(6) / 30.0
    offsets = generator.normal(0.0, 0.01, (1, 2, 1, 6, 3))
    precisions, scales = np.full((1, 1, 6), 0.02**-2), np.array([[[1.0], [0.1]]])
    jump = _jump(offsets, times[None], precisions, scales)
    design = np.stack([np.ones(6), times], axis=1)
    for k, scale in enumerate((1.0, 0.1)):
        prior = np.diag([(scale * JUMP_DISPLACEMENT) ** -2, (scale * JUMP_VELOCITY) ** -2])
        information = design.T @ design * 0.02**-2 + prior
        x = np.linalg.solve(information, design.T @ offsets[0, k, 0] * 0.02**-2)
        np.testing.assert_allclose(jump.displacements[0, k, 0], x[0], atol=1e-12)
        np.testing.assert_allclose(jump.velocities[0, k, 0], x[1], atol=1e-12)
        np.testing.assert_allclose(jump.losses[0, k], 0.5 * np.sum(x * (prior @ x)), rtol=1e-9)
        np.testing.assert_allclose(jump.offsets[0, k, 0], offsets[0, k, 0] - design @ x, atol=1e-12)


def test_states_of_a_free_flight_are_read_from_a_rollout(event_driven):
    """Over a step h a velocity errs by g h / 2, and a spin of constant axis by rounding."""
    thing = SceneObject("thing", "thing", Sphere(0.1))
    state = ObjectState(
        [0.0, 0.0, 5.0], linear_velocity=[1.0, 2.0, 3.0], angular_velocity=[4.0, -5.0, 6.0]
    )
    parameters = StaticParameters.uniform(MATERIALS)
    rollout = event_driven.rollout(
        [Scene(FLOOR, (thing,), (state,))], parameters, [0.2, 0.2 + VELOCITY_STEP]
    )
    ((read,),) = _states_at(rollout, np.zeros(1, dtype=np.int64))
    np.testing.assert_allclose(read[:3], rollout.positions[0, 0, 0])
    velocity = state.linear_velocity + 0.2 * G
    np.testing.assert_allclose(read[7:10], velocity, atol=9.81 * VELOCITY_STEP)
    np.testing.assert_allclose(read[10:], state.angular_velocity, rtol=1e-4)
