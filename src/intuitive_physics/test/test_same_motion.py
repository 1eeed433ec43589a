"""Which observations are one and the same measurement, played twice."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.observation import SAME_POINTS, Detections, Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory

TODAY = 1_750_000_000.0
NOISE = 0.002
SPREAD = np.diag([1.0, 2.0, 0.5]) ** 2 * NOISE**2
BALL = Sphere(0.05)
SEEDS = st.integers(0, 2**31)


def flight(times: np.ndarray, seed: int) -> np.ndarray:
    """True positions (n, 3) in m of a throw, at times in s since it began."""
    rng = np.random.default_rng([seed, 0])
    start, velocity = rng.uniform(-1.0, 1.0, 3), rng.normal(0.0, 1.5, 3)
    return start + times[:, None] * velocity - 0.5 * 9.81 * times[:, None] ** 2 * [0, 0, 1]


def measured(seed: int, noise_seed: int, count: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """Times since the throw began and detected positions of one throw, measured once."""
    times = np.arange(1, count + 1) / 30.0
    noise = np.random.default_rng([noise_seed, 1]).multivariate_normal(np.zeros(3), SPREAD, count)
    return times, flight(times, seed) + noise


def observed(
    measurement: tuple[np.ndarray, np.ndarray],
    start: float = TODAY,
    *,
    frames: np.ndarray | slice = slice(None),
    frame_id: str = "environment",
    shape: Sphere | Box = BALL,
    detected: bool = True,
) -> Observation:
    """An observation of some frames of a measurement, whose first stamp is at `start`."""
    times, positions = measurement[0][frames] + start, measurement[1][frames]
    detections = Detections(times, positions, np.tile(SPREAD, (times.size, 1, 1)), np.zeros((3, 3)))
    seen = ObservedObject(
        SceneObject("ball", "cork", shape),
        Trajectory(times, positions),
        ObjectState(positions[0], covariance=NOISE**2 * np.eye(12)),
        detections if detected else None,
    )
    floor = Plane("floor", "wood", (0, 0, 1), -5.0)
    return Observation(Environment([floor], frame_id=frame_id), (seen,), float(times[0]) - 0.01)


def assert_same(a: Observation, b: Observation, expected: bool) -> None:
    assert a.same_motion(b) == b.same_motion(a) == expected


@given(SEEDS, st.sampled_from([0.0, TODAY]))
def test_a_motion_is_the_same_as_itself(seed, start):
    seen = observed(measured(seed, seed), start)
    assert_same(seen, Observation.from_json(seen.to_json()), True)


@given(SEEDS, st.sampled_from([0.0, TODAY]))
def test_a_replay_that_drops_frames_and_models_another_environment_is_the_same(seed, start):
    rng = np.random.default_rng(seed)
    times, positions = measured(seed, seed)
    frames = rng.random(30) > 0.3
    once = observed((times, positions), start, frames=frames)
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.003, 3)).as_matrix()
    refitted = positions + 0.1 * NOISE * rng.normal(size=positions.shape)
    kept = rng.random(30) > 0.3
    kept[: rng.integers(0, 8)] = False
    assume(np.sum(frames & kept) >= SAME_POINTS)
    again = observed((times, refitted @ turn.T + rng.normal(0.0, 0.003, 3)), start, frames=kept)
    assert once.id != again.id
    assert_same(once, again, True)


@given(SEEDS, SEEDS)
def test_different_throws_that_all_start_at_time_zero_are_different(seed, other):
    assert_same(observed(measured(seed, 1), 0.0), observed(measured(other, 2), 0.0), False)


@given(SEEDS, st.sampled_from([0.0, TODAY]), st.integers(8, 60))
def test_equal_throws_with_noise_of_their_own_are_different(seed, start, count):
    once = observed(measured(seed, 1, count), start)
    assert_same(once, observed(measured(seed, 2, count), start), False)


def test_independent_errors_rarely_pass_for_the_same():
    """0.45 % of tracks that share six points: 5.6 of 1225 pairs, and 16 is more than 4 σ above."""
    seen = [observed(measured(0, k, 6)) for k in range(50)]
    assert sum(a.same_motion(b) for a, b in combinations(seen, 2)) <= 16


@given(SEEDS, st.floats(0.5, 1e6))
def test_equal_measurements_at_other_stamps_are_different(seed, later):
    once = observed(measured(seed, seed))
    again = observed(measured(seed, seed), TODAY + np.ceil(later) + 1.0)
    assert once.time_span[1] < again.time_span[0]
    assert_same(once, again, False)


@pytest.mark.parametrize(
    "change",
    [
        {"frame_id": "other"},
        {"shape": Box((0.1, 0.1, 0.1))},
        {"start": TODAY + 1.0 / 60.0},
        {"frames": slice(25, None)},
    ],
)
def test_another_frame_shape_stamp_or_too_few_points_are_different(change):
    assert_same(observed(measured(1, 1)), observed(measured(1, 1), **change), False)


def test_equal_motions_apart_from_each_other_are_different():
    times, positions = measured(3, 3)
    assert_same(observed((times, positions)), observed((times, positions + [0.2, 0, 0])), False)


@given(SEEDS)
def test_an_observation_without_detections_is_recognised_by_those_of_the_other(seed):
    measurement = measured(seed, seed)
    old = observed(measurement, detected=False)
    assert_same(old, observed(measurement, frames=slice(2, None)), True)
    assert_same(old, observed(measurement, frames=slice(2, None), detected=False), False)
    assert_same(old, Observation.from_json(old.to_json()), True)


def test_one_object_of_several_is_enough():
    rng = np.random.default_rng(0)
    first, second = observed(measured(1, 1)), observed(measured(2, 2))
    other = ObservedObject(
        SceneObject("other", "cork", Sphere(0.05)),
        second.objects[0].trajectory,
        second.objects[0].initial_state,
        second.objects[0].detections,
    )
    both = Observation(first.environment, (first.objects[0], other), first.start_time)
    assert_same(both, second, True)
    assert_same(both, observed(measured(int(rng.integers(100, 200)), 3)), False)


def test_the_time_span_holds_all_that_was_seen():
    seen = observed(measured(0, 0), 0.0)
    assert seen.time_span == pytest.approx((1.0 / 30.0, 1.0))
