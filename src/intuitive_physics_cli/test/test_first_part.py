"""What is known of an observation after its first part, and nothing of what came later."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import parameter_names
from intuitive_physics.observation import Detections, Observation, ObservedObject
from intuitive_physics.shapes import Box
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ANGULAR_VELOCITY, ROTATION
from intuitive_physics_cli.evaluation.prequential import (
    AFTER_BOUNCE,
    FIRST_PART,
    SeenPart,
    after_first_bounce,
    after_first_part,
)
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

from .bouncing_balls import bounces
from .thrown_balls import FLOOR, TRUE, thrown_balls

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
    return found.left


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
    for seen in balls:
        part = after_first_part(seen, SETTINGS)
        if part is None:
            continue
        found = part.left
        path, state = seen.objects[0].trajectory, found.objects[0].initial_state
        off = state.position - path.positions[np.searchsorted(path.times, found.start_time)]
        squares.append(off @ np.linalg.solve(state.covariance[:3, :3], off))
    assert len(squares) >= 35
    # The median of χ² with three degrees of freedom is 2.4.
    assert np.median(squares) < 4.0


def test_what_cannot_be_known_is_left_out() -> None:
    short = thrown_balls(2, np.random.default_rng(4), duration=0.25)
    whole = thrown_balls(3, np.random.default_rng(4))
    assert [after_first_part(seen, SETTINGS) for seen in short] == [None, None]
    assert [known(seen).id for seen in whole] == [seen.id for seen in whole]


def test_without_detections_observations_are_as_they_were() -> None:
    for seen in bounces(2):
        assert known(seen) is seen
        assert after_first_bounce(seen, SETTINGS) is None


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


def parts_after_bounce(count: int, seed: int) -> list[tuple[Observation, SeenPart]]:
    balls = thrown_balls(count, np.random.default_rng(seed))
    parts = [(seen, after_first_bounce(seen, SETTINGS)) for seen in balls]
    return [(seen, part) for seen, part in parts if part is not None]


def test_the_moment_after_a_bounce_is_that_many_detections_after_it() -> None:
    found = parts_after_bounce(20, 6)
    assert len(found) >= 18
    for seen, part in found:
        path = seen.objects[0].trajectory
        up = np.flatnonzero(np.diff(path.positions[:, 2]) > 0.0)
        falls = np.flatnonzero(np.diff(path.positions[:, 2]) < 0.0)[0]
        lowest = path.times[up[up > falls][0]]
        frames = (part.left.start_time - lowest) * 30.0
        assert AFTER_BOUNCE - 1.5 < frames < AFTER_BOUNCE + 2.5


def test_estimates_after_a_bounce_are_nearer_than_the_fit_and_not_too_sure() -> None:
    size = len(parameter_names(TRUE.materials))
    learned = LearnedParameters(TRUE, np.full(size, 1e-6), np.ones(size, bool), 1, 0.0, 1, "")
    uncertain, rng = UncertainParameters(learned), np.random.default_rng(0)
    rows = np.r_[0:3, 6:9]
    squares, ours, theirs = [], [], []
    for seen, part in parts_after_bounce(40, 7):
        (states,) = part.estimates(uncertain, make_simulator("auto"), rng)
        assert states is not None
        fit, path = part.left.objects[0].initial_state, seen.objects[0].trajectory
        state = states.state(fit.orientation)
        k = int(np.searchsorted(path.times, part.left.start_time - 1e-9))
        before, now, after = path.positions[k - 1 : k + 2]
        velocity = 15.0 * (after - before)
        off = np.concatenate([state.position - now, state.linear_velocity - velocity])
        squares.append(off @ np.linalg.solve(state.covariance[np.ix_(rows, rows)], off))
        ours.append(np.linalg.norm(state.linear_velocity - velocity))
        theirs.append(np.linalg.norm(fit.linear_velocity - velocity))
    # χ² of position and velocity has six degrees of freedom; it is less where balls turn less than
    # is thought possible.
    assert np.mean(squares) < 6.0
    assert np.median(ours) < 0.7 * np.median(theirs)
