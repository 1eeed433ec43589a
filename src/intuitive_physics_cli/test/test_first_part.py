"""What is known of an observation after its first part, and nothing of what came later."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.observation import Detections, Observation, ObservedObject
from intuitive_physics.shapes import Box
from intuitive_physics.state import ANGULAR_VELOCITY, ROTATION
from intuitive_physics_cli.evaluation.prequential import (
    FIRST_PART,
    after_first_part,
    after_first_parts,
)
from intuitive_physics_perception.settings import PerceptionSettings

from .bouncing_balls import bounces
from .thrown_balls import FLOOR, thrown_balls

SETTINGS = PerceptionSettings()
G = 9.81


def with_object(seen: Observation, **changes: object) -> Observation:
    return replace(seen, objects=(replace(seen.objects[0], **changes),))


def detections_of(seen: ObservedObject) -> Detections:
    assert seen.detections is not None
    return seen.detections


def known(seen: Observation) -> Observation:
    found = after_first_part(seen, SETTINGS)
    assert found is not None
    return found


def test_what_came_later_changes_nothing() -> None:
    for seen in thrown_balls(5, np.random.default_rng(0)):
        found = known(seen)
        whole = detections_of(seen.objects[0])
        moved = whole.positions.copy()
        moved[whole.times > found.start_time] += 0.3
        other = Detections(whole.times, moved, whole.covariances, whole.bias)
        again = known(with_object(seen, detections=other))
        assert again.start_time == found.start_time
        ours, theirs = (one.objects[0].initial_state for one in (found, again))
        np.testing.assert_array_equal(ours.to_vector(), theirs.to_vector())
        np.testing.assert_array_equal(ours.covariance, theirs.covariance)


def test_what_is_left_is_what_was_detected_later() -> None:
    (seen,) = thrown_balls(1, np.random.default_rng(1))
    found = known(seen)
    whole, left = detections_of(seen.objects[0]), found.objects[0].trajectory
    assert found.id == seen.id
    assert found.start_time == pytest.approx(seen.start_time + FIRST_PART, abs=1e-6)
    later = whole.times > found.start_time
    np.testing.assert_array_equal(left.times, whole.times[later])
    np.testing.assert_array_equal(left.positions, whole.positions[later])


def test_states_are_as_wrong_as_they_say() -> None:
    # χ² of position and velocity has six degrees of freedom.
    balls = thrown_balls(100, np.random.default_rng(2), height=2.0, duration=0.8)
    squares = []
    for seen in balls:
        found = known(seen)
        since = found.start_time - seen.start_time
        first, state = seen.objects[0].initial_state, found.objects[0].initial_state
        velocity = first.linear_velocity - (0.0, 0.0, G * since)
        position = first.position + since * first.linear_velocity - (0, 0, 0.5 * G * since**2)
        off = np.concatenate([state.position - position, state.linear_velocity - velocity])
        rows = np.r_[0:3, 6:9]
        squares.append(off @ np.linalg.solve(state.covariance[np.ix_(rows, rows)], off))
    # The noise of ten points is known within a quarter, and so is the covariance.
    assert np.mean(squares) == pytest.approx(6.0, rel=0.35)
    spin = found.objects[0].initial_state.covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY]
    np.testing.assert_allclose(spin, SETTINGS.angular_velocity_deviation**2 * np.eye(3))


def test_a_bounce_in_the_first_part_is_no_obstacle() -> None:
    balls = thrown_balls(40, np.random.default_rng(3), height=0.06)
    squares = []
    for found in after_first_parts(balls).observations:
        (seen,) = (one for one in balls if one.id == found.id)
        path, state = seen.objects[0].trajectory, found.objects[0].initial_state
        off = state.position - path.positions[np.searchsorted(path.times, found.start_time)]
        squares.append(off @ np.linalg.solve(state.covariance[:3, :3], off))
    assert len(squares) >= 35
    # The median of χ² with three degrees of freedom is 2.4.
    assert np.median(squares) < 4.0


def test_what_cannot_be_known_is_left_out() -> None:
    short = thrown_balls(2, np.random.default_rng(4), duration=0.25)
    whole = thrown_balls(3, np.random.default_rng(4))
    found = after_first_parts([*short, *whole])
    assert found.left_out == 2
    assert [one.id for one in found.observations] == [one.id for one in whole]


def test_without_detections_observations_are_as_they_were() -> None:
    seen = bounces(2)
    assert after_first_parts(seen).observations == tuple(seen)


def test_a_box_turns_on_as_it_did_at_its_start() -> None:
    (seen,) = thrown_balls(1, np.random.default_rng(5), height=2.0, duration=0.8)
    item = replace(seen.objects[0].object, shape=Box((0.05, 0.06, 0.07)))
    spin = np.array([1.0, -2.0, 3.0])
    covariance = 1e-6 * np.eye(12)
    first = replace(seen.objects[0].initial_state, angular_velocity=spin, covariance=covariance)
    found = known(with_object(seen, object=item, initial_state=first))
    state, since = found.objects[0].initial_state, found.start_time - seen.start_time
    np.testing.assert_allclose(state.angular_velocity, spin)
    turned = Rotation.from_rotvec(since * spin).inv() * Rotation.from_quat(state.orientation)
    assert turned.magnitude() < 1e-9
    assert (np.diag(state.covariance)[ROTATION] > 1e-6).all()
    assert found.environment is FLOOR
