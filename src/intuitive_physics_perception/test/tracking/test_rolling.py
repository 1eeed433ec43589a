"""A ball that rolls turns as its speed says; of any other nothing is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.scene import Environment, Plane
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.rolling import rolling_angular_velocity
from intuitive_physics_perception.tracking.tracker import Tracker

FLOOR = Environment([Plane("floor", "m", (0, 0, 1), 0.0)])
SETTINGS = PerceptionSettings()
STEP = 1.0 / 30.0
RADIUS, NOISE = 0.05, 0.001
UNKNOWN = SETTINGS.angular_velocity_deviation
VECTORS = st.lists(st.floats(-5, 5), min_size=3, max_size=3).map(np.array)


@given(VECTORS, VECTORS.filter(lambda v: np.linalg.norm(v) > 0.1), st.floats(0.01, 1.0))
def test_the_point_of_contact_stands_still(velocity, normal, radius) -> None:
    normal = normal / np.linalg.norm(normal)
    velocity = velocity - (velocity @ normal) * normal
    spin, covariance = rolling_angular_velocity(
        velocity, 1e-4 * np.eye(3), radius, normal, UNKNOWN, SETTINGS.motion.rolling_slip
    )
    # v + ω × (-r n) = 0
    assert velocity - radius * np.cross(spin, normal) == pytest.approx(np.zeros(3), abs=1e-9)
    assert normal @ covariance @ normal == pytest.approx(UNKNOWN**2)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def last_state(rng, places):
    tracker = Tracker(FLOOR, SETTINGS)
    for k, place in enumerate(places):
        error = NOISE * rng.normal(size=4)
        sphere = DetectedSphere(place + error[:3], RADIUS + error[3], NOISE**2 * np.eye(4), 200, 2)
        tracker.update(k * STEP, [sphere])
    return tracker.tracks[0].object_state(FLOOR, SETTINGS)


def along_the_floor(times, deceleration):
    x = 1.5 * times - 0.5 * deceleration * times**2
    return np.column_stack([x, 0 * times, np.full(times.size, RADIUS)])


def test_rolling_is_seen_and_sliding_and_flight_are_not(rng) -> None:
    times = np.arange(0, 0.4, STEP)
    rolling = last_state(rng, along_the_floor(times, 0.2))
    speed = 1.5 - 0.2 * times[-1]
    # ω = v / r about the axis left of the way.
    assert rolling.angular_velocity == pytest.approx([0, speed / RADIUS, 0], rel=0.1, abs=2.5)
    assert rolling.covariance[10, 10] < (0.35 * UNKNOWN) ** 2
    for places in (
        along_the_floor(times, 0.3 * 9.81),
        np.column_stack([1.5 * times, 0 * times, 1.0 - 0.5 * 9.81 * times**2]),
    ):
        unknown = last_state(rng, places)
        assert unknown.angular_velocity == pytest.approx(np.zeros(3))
        assert np.diag(unknown.covariance)[9:] == pytest.approx(UNKNOWN**2)


def test_what_rests_does_not_turn(rng) -> None:
    still = np.tile([0.3, 0.2, RADIUS], (40, 1))
    state = last_state(rng, still)
    assert np.sqrt(state.covariance[9, 9]) <= SETTINGS.rest_speed / RADIUS * 1.1
