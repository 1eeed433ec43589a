"""Poses become states and observations that agree with the laws of motion within their σ."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics_perception.poses.described_objects import TaggedObject
from intuitive_physics_perception.poses.pose_tracker import MeasuredPose, PoseTracker

POSITION_NOISE, ROTATION_NOISE = 0.002, 0.01
RATE = 100.0
GRAVITY = np.array([0.0, 0.0, -9.81])

SHAPES = [Box((0.1, 0.15, 0.2)), Capsule(0.03, 0.1), Sphere(0.05)]


def tagged(name: str, shape: Shape = SHAPES[0], centre=(0.0, 0.0, 0.0)) -> TaggedObject:
    return TaggedObject(SceneObject(name, "wood", shape), RigidTransform(centre))


def environment() -> Environment:
    return Environment([Plane("floor", "wood", (0, 0, 1), 0.0)], frame_id="lab")


def measured(position, orientation, rng: np.random.Generator) -> MeasuredPose:
    """A true pose with Gaussian errors of the covariances that it names."""
    turned = Rotation.from_rotvec(ROTATION_NOISE * rng.normal(size=3)) * orientation
    noisy = np.asarray(position) + POSITION_NOISE * rng.normal(size=3)
    return MeasuredPose(
        RigidTransform(noisy, turned.as_quat()),
        POSITION_NOISE**2 * np.eye(3),
        ROTATION_NOISE**2 * np.eye(3),
    )


def flight(tracker: PoseTracker, name: str, rng, *, begin=0.0, duration=0.4, spin=(0.0, 0.0, 3.0)):
    """Play a free flight; return its first position and velocity, and the last time."""
    start, velocity = np.array([0.0, 0.5, 0.8]), np.array([1.5, -0.5, 2.0])
    for t in np.arange(0.0, duration, 1.0 / RATE):
        place = start + velocity * t + 0.5 * GRAVITY * t**2
        turn = Rotation.from_rotvec(np.asarray(spin) * t)
        tracker.update(begin + t, {name: measured(place, turn, rng)})
    return start, velocity, t


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.kind)
def test_states_are_right_within_their_covariance(shape: Shape) -> None:
    # NEES: for errors of the covariance P, the mean of eᵀ P⁻¹ e over N independent flights is that
    # of χ² of 6 degrees: 6 ± 4 √(2·6/N). The filter may claim too much noise, as it expects
    # accelerations that a flight does not have, but hardly too little.
    values, spins, flights = [], [], 30
    for seed in range(flights):
        rng = np.random.default_rng(seed)
        tracker = PoseTracker(environment(), [tagged("thing", shape)])
        start, velocity, t = flight(tracker, "thing", rng)
        (thing,), (state,) = tracker.states()
        assert (thing.id, thing.shape) == ("thing", shape)
        place, speed = start + velocity * t + 0.5 * GRAVITY * t**2, velocity + GRAVITY * t
        error = np.concatenate([state.position - place, state.linear_velocity - speed])
        kept = [0, 1, 2, 6, 7, 8]
        covariance = state.covariance[np.ix_(kept, kept)]
        values.append(error @ np.linalg.solve(covariance, error))
        spins.append(state.angular_velocity)
        assert np.linalg.norm(error[3:]) < 0.2
    assert np.mean(values) < 6.0 + 4.0 * np.sqrt(12.0 / flights)
    assert np.mean(values) > 0.5
    if not isinstance(shape, Sphere):
        # A capsule's turn about its own axis, z here, is not followed.
        axes = [2] if isinstance(shape, Box) else []
        assert np.mean(spins, axis=0)[axes] == pytest.approx([3.0] * len(axes), abs=0.15)


def test_a_throw_becomes_one_observation_of_the_named_object() -> None:
    rng = np.random.default_rng(0)
    tracker = PoseTracker(environment(), [tagged("tagged")])
    observations = []
    lying = Rotation.identity()
    for k in range(40):
        _, found = tracker.update(k / RATE, {"tagged": measured((0, 0.5, 0.8), lying, rng)})
        observations += found
    start, velocity, _ = flight(tracker, "tagged", rng, begin=0.4, duration=0.45)
    assert not observations
    observations += tracker.finish()
    (observation,) = observations
    (item,) = observation.objects
    assert item.object == SceneObject("tagged", "wood", SHAPES[0])
    assert observation.environment.frame_id == "lab"
    since = item.trajectory.times - 0.4
    expected = start + np.outer(since, velocity) + 0.5 * np.outer(since**2, GRAVITY)
    flown = since > 0.0
    assert item.trajectory.positions[flown] == pytest.approx(expected[flown], abs=0.01)
    assert item.detections is not None
    assert np.sqrt(np.median(item.detections.covariances[:, 0, 0])) == pytest.approx(
        POSITION_NOISE, rel=0.5
    )
    assert observation.start_time == pytest.approx(0.4, abs=0.05)


def test_objects_are_never_confused_where_they_meet() -> None:
    # Two equal boxes pass through one another's places: their names say which is which.
    rng = np.random.default_rng(1)
    tracker = PoseTracker(environment(), [tagged(name) for name in "ab"])
    for t in np.arange(0.0, 0.5, 1.0 / RATE):
        height = 1.0 + 2.4 * t - 0.5 * 9.81 * t**2
        poses = {
            name: measured((side * (0.5 - 2.0 * t), 0.0, height), Rotation.identity(), rng)
            for name, side in (("a", -1.0), ("b", 1.0))
        }
        tracker.update(t, poses)
    objects, states = tracker.states()
    assert [item.id for item in objects] == ["a", "b"]
    assert states[0].linear_velocity[0] == pytest.approx(2.0, abs=0.1)
    assert states[1].linear_velocity[0] == pytest.approx(-2.0, abs=0.1)


def test_what_is_hidden_is_carried_on_and_then_lost() -> None:
    rng = np.random.default_rng(2)
    tracker = PoseTracker(environment(), [tagged(name) for name in "ab"])
    flight(tracker, "a", rng, duration=0.3)
    assert [item.id for item in tracker.states()[0]] == ["a"]
    still = Rotation.identity()
    for k in range(100):
        tracker.update(0.3 + k / RATE, {"b": measured((0, 0, 0.1), still, rng)})
    assert [item.id for item in tracker.states()[0]] == ["b"]


def test_time_that_goes_back_begins_anew() -> None:
    rng = np.random.default_rng(3)
    tracker = PoseTracker(environment(), [tagged("a")])
    flight(tracker, "a", rng, begin=10.0)
    back, observations = tracker.update(5.0, {"a": measured((0, 0, 1), Rotation.identity(), rng)})
    assert back
    assert len(observations) == 1
    assert tracker.states() == ([], [])
    assert tracker.update(5.0, {"a": measured((0, 0, 1), Rotation.identity(), rng)}) == (False, ())


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 10.0),
            st.tuples(*[st.floats(-1e3, 1e3)] * 3),
            st.integers(0, 2**32 - 1),
        ),
        max_size=20,
    )
)
def test_whatever_comes_states_are_finite(poses) -> None:
    tracker = PoseTracker(environment(), [tagged("a")])
    for time, place, seed in poses:
        rng = np.random.default_rng(seed)
        tracker.update(time, {"a": measured(place, Rotation.random(random_state=seed), rng)})
        for state in tracker.states()[1]:
            assert np.isfinite(state.to_vector()).all()
            assert (np.linalg.eigvalsh(state.covariance) > -1e-9).all()


def test_what_cannot_be_is_refused() -> None:
    box = tagged("a")
    with pytest.raises(InvalidInputError, match="at least one"):
        PoseTracker(environment(), [])
    with pytest.raises(InvalidInputError, match="each once"):
        PoseTracker(environment(), [box, box])
    tracker = PoseTracker(environment(), [box])
    pose = measured((0, 0, 1), Rotation.identity(), np.random.default_rng(0))
    with pytest.raises(UnknownNameError, match="'b', which is not followed; expected one of a"):
        tracker.update(0.0, {"b": pose})
    with pytest.raises(InvalidInputError, match="finite"):
        tracker.update(np.nan, {"a": pose})


def test_the_centre_is_less_certain_the_farther_it_is_from_the_tag() -> None:
    # δp = δθ × l: an arm of 0.5 m makes 5 mm of 0.01 rad, across the arm.
    rng = np.random.default_rng(4)
    tracker = PoseTracker(environment(), [tagged("a", centre=(0.5, 0.0, 0.0))])
    errors = []
    for k in range(200):
        tag = measured((0.0, 0.0, 1.0), Rotation.identity(), rng)
        centre = tag.pose.points([0.5, 0.0, 0.0])
        errors.append(centre - [0.5, 0.0, 1.0])
        tracker.update(k / RATE, {"a": tag})
    ((state,),) = (tracker.states()[1],)
    assert state.position == pytest.approx([0.5, 0.0, 1.0], abs=0.005)
    detection = tracker._trackers["a"].tracks[0].steps[-1].detection
    assert detection is not None
    expected = np.diag([POSITION_NOISE**2, *[POSITION_NOISE**2 + (0.5 * ROTATION_NOISE) ** 2] * 2])
    assert detection.covariance[:3, :3] == pytest.approx(expected, abs=3e-6)
    assert np.cov(np.array(errors).T) == pytest.approx(expected, abs=8e-6)
