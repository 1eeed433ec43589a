"""A ball that rolls turns as its speed says; of any other nothing is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.attitude import ROLLING_TIME, rolling_angular_velocity
from intuitive_physics_perception.tracking.tracker import Tracker

from ..conftest import FLOOR, seen_sphere

SETTINGS = PerceptionSettings()
STEP = 1.0 / 30.0
RADIUS = 0.05
UNKNOWN = SETTINGS.angular_velocity_deviation
VECTORS = st.lists(st.floats(-5, 5), min_size=3, max_size=3).map(np.array)


@given(VECTORS, VECTORS.filter(lambda v: np.linalg.norm(v) > 0.1), st.floats(0.01, 1.0))
def test_the_point_of_contact_stands_still(velocity, normal, radius) -> None:
    normal = normal / np.linalg.norm(normal)
    velocity = velocity - (velocity @ normal) * normal
    spin, covariance = rolling_angular_velocity(velocity, 1e-4 * np.eye(3), radius, normal, UNKNOWN)
    # v + ω × (-r n) = 0
    assert velocity - radius * np.cross(spin, normal) == pytest.approx(np.zeros(3), abs=1e-9)
    assert normal @ covariance @ normal == pytest.approx(UNKNOWN**2)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def tracked(environment, places, rng):
    """Time and the tracker's state of a ball in each frame in which it is tracked."""
    tracker, states = Tracker(environment, SETTINGS), []
    for k, place in enumerate(places):
        tracker.update(k * STEP, [seen_sphere(rng, place, RADIUS)])
        states += [
            (k * STEP, track.object_state(environment, SETTINGS)) for track in tracker.tracks
        ]
    return states


def along_the_floor(times, deceleration):
    x = 1.5 * times - 0.5 * deceleration * times**2
    return np.column_stack([x, 0 * times, np.full(times.size, RADIUS)])


def test_rolling_is_seen_and_sliding_and_flight_are_not(rng) -> None:
    times = np.arange(0, 0.4, STEP)
    rolling = tracked(FLOOR, along_the_floor(times, 0.2), rng)[-1][1]
    speed = 1.5 - 0.2 * times[-1]
    # ω = v / r about the axis left of the way.
    assert rolling.angular_velocity == pytest.approx([0, speed / RADIUS, 0], rel=0.1, abs=2.5)
    assert rolling.covariance[10, 10] < (0.35 * UNKNOWN) ** 2
    for places in (
        along_the_floor(times, 0.3 * 9.81),
        np.column_stack([1.5 * times, 0 * times, 1.0 - 0.5 * 9.81 * times**2]),
    ):
        unknown = tracked(FLOOR, places, rng)[-1][1]
        assert unknown.angular_velocity == pytest.approx(np.zeros(3))
        assert np.diag(unknown.covariance)[9:] == pytest.approx(UNKNOWN**2)
        # The orientation of a ball is no question.
        assert np.abs(unknown.covariance[3:6]).max() == 0.0


BOX = StaticBox("box", "m", (0.5, 0.0, 0.2), (0.0, 0.0, 0.0, 1.0), (1.4, 0.6, 0.4))


def ramp(degrees):
    angle = np.radians(degrees)
    return Environment([Plane("ramp", "m", [np.sin(angle), 0, np.cos(angle)], 0.0)])


@pytest.mark.parametrize("case", ["box", 2.0, 8.0, 15.0, "up 8"])
def test_the_spin_of_what_rolls_on_boxes_and_ramps_is_known(case) -> None:
    determined, squares, count = 0, 0.0, 0
    for seed in range(12):
        rng = np.random.default_rng([seed, 5])
        times = np.arange(0, 0.8, STEP)
        if case == "box":
            environment, normal = Environment(FLOOR.planes, [BOX]), np.array([0.0, 0.0, 1.0])
            along, speed, gain = np.array([1.0, 0.0, 0.0]), 0.9, 0.0
            start = np.array([-0.1, 0.0, 0.4 + RADIUS])
        else:
            degrees = case if isinstance(case, float) else 8.0
            environment, angle = ramp(degrees), np.radians(degrees)
            normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
            along = np.array([np.cos(angle), 0.0, -np.sin(angle)])
            # Rolling without slipping: a = g sin α / (1 + κ), κ = 2/5.
            speed, gain = 0.5, 9.81 * np.sin(angle) / 1.4
            if case == "up 8":
                speed = -1.2
            start = RADIUS * normal
        gone = speed * times + 0.5 * gain * times**2
        states = tracked(environment, start + np.outer(gone, along), rng)
        # Rolling is visible from then on.
        for time, state in [item for item in states if item[0] > ROLLING_TIME + 0.1]:
            velocity = (speed + gain * time) * along
            spin = np.cross(normal, velocity) / RADIUS
            determined += state.covariance[10, 10] < (0.5 * UNKNOWN) ** 2
            off = np.concatenate([state.linear_velocity - velocity, state.angular_velocity - spin])
            spread = state.covariance[6:12, 6:12]
            # The spin about the normal is not known; that of the ball is zero.
            squares += off @ np.linalg.solve(spread, off)
            count += 1
    assert determined >= 0.95 * count
    # χ² / 6 of errors as large as the covariance says is one; it may be cautious, as the slip is.
    assert squares / (6.0 * count) < 1.5


def test_what_rests_does_not_turn(rng) -> None:
    still = np.tile([0.3, 0.2, RADIUS], (40, 1))
    state = tracked(FLOOR, still, rng)[-1][1]
    assert np.sqrt(state.covariance[9, 9]) <= SETTINGS.rest_speed / RADIUS * 1.1
