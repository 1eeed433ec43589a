"""Objects that never come near each other move as if each were alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner.assessment.undisturbed_motion import worst_of_motions
from intuitive_physics_learner.cost.independent_motions import LONGEST_GAP, independent_motions

from .cases import FLOOR

TIMES = np.arange(1, 31) / 30.0
RADIUS = 0.1
PARAMETERS = StaticParameters.uniform(("ball", "floor"), restitution=0.8)


def thrown(simulator, states):
    """Balls thrown over a floor at once, seen 30 times a second without noise."""
    balls = [SceneObject(f"ball {k}", "ball", Sphere(RADIUS)) for k in range(len(states))]
    scene = Scene(FLOOR, tuple(balls), tuple(states))
    positions = simulator.rollout([scene], PARAMETERS, TIMES).positions[0]
    objects = [
        ObservedObject(ball, Trajectory(TIMES, track), state)
        for ball, track, state in zip(balls, positions, states, strict=True)
    ]
    return Observation(FLOOR, tuple(objects), 0.0)


def drawn_states(generator, count):
    """States (count,) of balls apart from each other, that fly to and fro."""
    places = RADIUS + np.arange(count)[:, None] * (0.5, 0.0, 0.0) + (0.0, 0.0, 0.3)
    velocities = generator.normal(0.0, 2.0, (count, 3))
    return [
        ObjectState(place, linear_velocity=velocity)
        for place, velocity in zip(places, velocities, strict=True)
    ]


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 4))
def test_motions_that_are_taken_apart_are_those_of_all_together(event_driven, seed, count):
    # Without a contact between objects, Newton's equations of each have none of the others.
    observation = thrown(event_driven, drawn_states(np.random.default_rng(seed), count))
    motions, origins = independent_motions([observation])
    assert (origins == 0).all()
    seen = {each.object.id: each for each in observation.objects}
    assert sorted(each.object.id for motion in motions for each in motion.objects) == sorted(seen)
    assert len({motion.id for motion in motions}) == len(motions)
    for motion in motions:
        alone = event_driven.rollout([motion.scene()], PARAMETERS, TIMES).positions[0]
        for each, positions in zip(motion.objects, alone, strict=True):
            expected = seen[each.object.id].trajectory.positions
            np.testing.assert_allclose(positions, expected, atol=1e-9)


def test_what_is_far_apart_is_taken_apart_and_what_meets_is_not(event_driven):
    far = [ObjectState((x, 0.0, 1.0)) for x in (-9.0, 1.0, 3.0)]
    # The third flies at the second: 2 m less two radii in 0.36 s.
    meeting = [*far[:2], ObjectState((3.0, 0.0, 1.0), linear_velocity=(-5.0, 0.0, 0.0))]
    observations = [thrown(event_driven, states) for states in (far, meeting)]
    motions, origins = independent_motions(observations)
    assert origins.tolist() == [0, 0, 0, 1, 1]
    groups = [[each.object.id for each in motion.objects] for motion in motions]
    assert groups == [["ball 0"], ["ball 1"], ["ball 2"], ["ball 0"], ["ball 1", "ball 2"]]


def test_an_observation_in_one_piece_stays_as_it_is(event_driven):
    observation = thrown(event_driven, [ObjectState((0.0, 0.0, 1.0))])
    motions, _ = independent_motions([observation])
    assert motions[0] is observation


@pytest.mark.parametrize("unseen", [slice(10, 20), slice(20, 30), slice(0, 10)])
def test_what_was_not_seen_for_a_while_may_have_been_anywhere(event_driven, unseen):
    assert TIMES[10] - TIMES[0] > LONGEST_GAP
    observation = thrown(event_driven, [ObjectState((x, 0.0, 1.0)) for x in (0.0, 3.0)])
    first, second = observation.objects
    track = second.trajectory
    kept = Trajectory(np.delete(track.times, unseen), np.delete(track.positions, unseen, axis=0))
    hidden = replace(observation, objects=(first, replace(second, trajectory=kept)), id="")
    assert len(independent_motions([observation])[0]) == 2
    assert independent_motions([hidden])[0] == [hidden]


def test_an_observation_is_explained_as_badly_as_its_worst_motion():
    misfits, times = worst_of_motions(
        np.array([2.0, 7.0, np.nan, np.nan, 1.0, 3.0]),
        np.array([0.1, 0.2, np.nan, np.nan, 0.3, 0.4]),
        np.array([0, 0, 1, 2, 2, 2]),
    )
    np.testing.assert_array_equal(misfits, [7.0, np.nan, 3.0])
    np.testing.assert_array_equal(times, [0.2, np.nan, 0.4])
