"""One tracker of sensors with rates and times of their own."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.scene import Environment, Plane
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.tracker import Tracker

DEVIATION, RADIUS = 0.002, 0.06
FLOOR = Environment([Plane("floor", "wood", (0.0, 0.0, 1.0), 0.0)])


def flight(time: float) -> np.ndarray:
    return np.array([0.0, 0.0, 1.0]) + np.array([3.0, 0.0, 2.0]) * time - [0, 0, 4.905 * time**2]


def seen(rng, time: float, delay: float = 0.0) -> DetectedSphere:
    noise = rng.normal(0.0, DEVIATION, 4)
    covariance = DEVIATION**2 * np.eye(4)
    place = flight(time + delay) + noise[:3]
    return DetectedSphere(place, RADIUS + noise[3], covariance, 300, 2.0, delay=delay)


def test_what_a_slow_sensor_alone_sees_is_followed(rng) -> None:
    """10 frames a second show it, and 60 of a camera that looks elsewhere do not."""
    tracker = Tracker(FLOOR, PerceptionSettings())
    for k in range(30):
        tracker.update(k / 60.0, [], "camera")
        if k % 6 == 0:
            tracker.update(k / 60.0 + 0.001, [seen(rng, k / 60.0 + 0.001)], "lidar")
    assert [track.number for track in tracker.tracks] == [1]
    assert tracker.next_number == 2


def test_what_its_own_sensor_misses_is_dropped_as_ever(rng) -> None:
    tracker = Tracker(FLOOR, PerceptionSettings())
    tracker.update(0.0, [seen(rng, 0.0)])
    tracker.update(0.05, [])
    tracker.update(0.1, [])
    assert tracker.followed == []


def test_a_late_reading_is_taken_at_its_own_time(rng) -> None:
    """A LiDAR shows it 20 to 80 ms after its scan's stamp, and frames of a camera come from
    meanwhile after the scan: at 3 m/s these are 6 to 24 cm. All errors are those of readings."""
    tracker = Tracker(FLOOR, PerceptionSettings())
    delays = rng.uniform(0.02, 0.08, 6)
    for k, delay in enumerate(delays):
        begin = 0.1 * k
        tracker.update(begin, [seen(rng, begin, float(delay))], "lidar")
        for n in range(1, 4):
            time = begin + n / 40.0
            tracker.update(time, [seen(rng, time)], "camera")
        if k >= 2:
            (track,) = tracker.tracks
            assert track.mean[:3] == pytest.approx(flight(track.time), abs=5.0 * DEVIATION)
    (track,) = tracker.tracks
    times = [step.time for step in track.steps]
    assert all(np.diff(times) > 0.0)
    assert tracker.next_number == 2
