"""Motions followed beyond fit horizons, and which throws need a kick."""

import numpy as np
import pytest

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.assessment import undisturbed_motion
from intuitive_physics_learner.assessment.undisturbed_motion import MOTIONS, undisturbed_misfits
from intuitive_physics_learner.joint_search.joint_search import JointSearch
from intuitive_physics_learner.segmented_estimation.chaotic_states import followed

from .cases import task_of

MATERIALS = ("thing", "floor")
FLOOR = Environment([Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0)], gravity=(0.0, 0.0, -9.81))
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


def fitted(simulator, observed, steps):
    search = JointSearch(
        task_of(TrajectoryCost(observed, simulator, MATERIALS)), np.random.default_rng(0)
    )
    for _ in range(steps):
        search.step(1000)
    return search.fit


@pytest.mark.parametrize("kick", [25, 60])
@pytest.mark.parametrize("shape", [Sphere(0.1), Box((0.15, 0.2, 0.3))])
def test_a_kick_in_motion_or_at_rest_is_no_undisturbed_motion(event_driven, shape, kick):
    generator = np.random.default_rng(3)
    observed = [thrown(event_driven, shape, generator, kick if k == 2 else None) for k in range(8)]
    fit = fitted(event_driven, observed, steps=12)
    misfits, times = undisturbed_misfits(fit, event_driven, np.random.default_rng(1))
    others = np.nan_to_num(np.delete(misfits, 2))
    assert misfits[2] > 3.0 * max(others.max(), 1.5)
    assert TIMES[kick] - 0.4 < times[2] < TIMES[kick] + 0.4


def test_no_look_is_begun_when_no_time_is_left(event_driven, monkeypatch):
    """The time runs out with the first look of a kicked throw, which asks for a second one."""
    observed = [thrown(event_driven, Sphere(0.1), np.random.default_rng(3), kick_at=25)]
    fit = fitted(event_driven, observed, steps=6)
    looks = []

    def counted(simulator, worlds, times, count):
        looks.append(count)
        return followed(simulator, worlds, times, count)

    monkeypatch.setattr(undisturbed_motion, "followed", counted)
    generator = np.random.default_rng(1)
    undisturbed_misfits(fit, event_driven, generator, lambda: 1.0 if len(looks) < 4 else 0.0)
    assert looks == 4 * [MOTIONS[0]]
    looks.clear()
    misfits, _ = undisturbed_misfits(fit, event_driven, np.random.default_rng(1), lambda: 0.0)
    assert not looks
    assert np.isnan(misfits).all()
