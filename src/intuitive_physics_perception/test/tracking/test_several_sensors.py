"""One tracker of sensors with rates and times of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_perception.tracking.tracker import Tracker

from ..conftest import FLOOR, seen_sphere

DEVIATION, RADIUS, SCAN = 0.002, 0.06, 0.1


def flight(time: float) -> np.ndarray:
    return np.array([0.0, 0.0, 1.0]) + np.array([3.0, 0.0, 2.0]) * time - [0, 0, 4.905 * time**2]


def seen(rng, time: float, delay: float = 0.0) -> DetectedSphere:
    return seen_sphere(rng, flight(time + delay), RADIUS, DEVIATION, delay=delay)


def test_what_a_slow_sensor_alone_sees_is_followed(rng) -> None:
    """10 frames a second show it, and 60 of a camera that looks elsewhere do not."""
    tracker = Tracker(FLOOR, PerceptionSettings())
    for k in range(30):
        tracker.update(k / 60.0, [], "camera")
        if k % 6 == 0:
            tracker.update(k / 60.0 + 0.001, [seen(rng, k / 60.0 + 0.001)], "lidar")
    assert [track.number for track in tracker.tracks] == [1]
    assert tracker.next_number == 2


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


def readings(rng, until: float) -> tuple[list, list]:
    """Frames of a camera at 30 Hz, and scans of a LiDAR of which the stamps are those of their
    last readings: stamp, first time, and what was seen of the ball."""
    frames = [(k / 30.0, k / 30.0, seen(rng, k / 30.0)) for k in range(int(30.0 * until))]
    scans = []
    for stamp in np.arange(2.0 * SCAN, until, SCAN) + rng.uniform(0.0, 0.033):
        begin, delay = float(stamp) - SCAN, float(rng.uniform(0.0, SCAN))
        scans.append((float(stamp), begin, seen(rng, begin, delay)))
    return frames, scans


@given(st.integers(0, 1000))
def test_the_order_in_which_readings_come_makes_no_difference(seed: int) -> None:
    """Bayes: p(x | z1, z2) = p(x | z2, z1). Scans come after frames that were read meanwhile; the
    ball bounces off the floor at 0.7 s."""
    frames, scans = readings(np.random.default_rng(seed), 0.9)
    by_stamp, by_time = Tracker(FLOOR, PerceptionSettings()), Tracker(FLOOR, PerceptionSettings())
    for _, begin, ball in sorted([*frames, *scans], key=lambda item: item[0]):
        by_stamp.update(begin, [ball], "lidar" if ball.delay else "camera")
    for _, begin, ball in sorted([*frames, *scans], key=lambda item: item[1] + item[2].delay):
        by_time.update(begin + ball.delay, [replace(ball, delay=0.0)])
    (track,), (expected,) = by_stamp.followed, by_time.followed
    assert [step.time for step in track.steps] == [step.time for step in expected.steps]
    np.testing.assert_allclose(track.mean, expected.mean, atol=1e-9)
    np.testing.assert_allclose(track.covariance, expected.covariance, atol=1e-9)
    assert track.seen_time == pytest.approx(expected.seen_time, abs=1e-9)
    assert track.last_seen == expected.last_seen


def test_a_scan_that_showed_a_ball_before_any_frame_begins_no_second_track(rng) -> None:
    """It is known from the first frame on; the scan that ends then read it before."""
    tracker = Tracker(FLOOR, PerceptionSettings())
    tracker.update(0.05, [seen(rng, 0.05)], "camera")
    tracker.update(-0.04, [seen(rng, -0.04, 0.06)], "lidar")
    for k in range(1, 5):
        tracker.update(0.05 + k / 30.0, [seen(rng, 0.05 + k / 30.0)], "camera")
    assert [track.number for track in tracker.tracks] == [1]
    assert tracker.next_number == 2


def test_a_ball_that_is_recognised_meanwhile_has_the_known_radius(rng) -> None:
    """A scan read it before the frame in which it was recognised, and comes after that."""
    known = (KnownObject("toy", RADIUS + 0.001, "wood"),)
    tracker = Tracker(FLOOR, PerceptionSettings(known_objects=known))
    frames, scans = readings(rng, 0.5)
    recognised = 0
    for _, begin, ball in sorted([*frames, *scans], key=lambda item: item[0]):
        tracker.update(begin, [ball], "lidar" if ball.delay else "camera")
        for track in tracker.tracks:
            recognised += 1
            assert track.known_object is known[0]
            assert track.mean[6] == pytest.approx(RADIUS + 0.001, abs=1e-4)
    assert recognised > 5


def test_what_only_scans_show_is_as_of_the_newest_frame(rng) -> None:
    """A LiDAR reads it up to 0.1 s before frames of a camera that looks elsewhere."""
    tracker = Tracker(FLOOR, PerceptionSettings())
    _, scans = readings(rng, 0.9)
    frames = [(k / 60.0, k / 60.0, None) for k in range(54)]
    for stamp, begin, ball in sorted([*frames, *scans], key=lambda item: item[0]):
        tracker.update(begin, [] if ball is None else [ball], "camera" if ball is None else "lidar")
        for track in tracker.tracks:
            assert track.time > stamp - 1.0 / 60.0
            if 0.45 < stamp < 0.6:
                assert track.mean[:3] == pytest.approx(flight(track.time), abs=0.06)
    assert [track.number for track in tracker.tracks] == [1]
    assert tracker.next_number == 2


def test_a_ball_that_leaves_its_rest_is_followed_through_late_scans(rng) -> None:
    """At rest for 1 s, then 0.5 m/s: a scan may have read it before a frame saw that it moves."""

    def place(time: float) -> np.ndarray:
        return np.array([0.5 * max(time - 1.0, 0.0), 0.0, RADIUS])

    tracker = Tracker(FLOOR, PerceptionSettings())
    frames = [(k / 30.0, 0.0) for k in range(60)]
    scans = [(0.1 * n + 0.02, 0.1) for n in range(1, 20)]
    for stamp, duration in sorted(frames + scans):
        delay = duration * float(rng.uniform())
        seen_at = place(stamp - duration + delay)
        ball = seen_sphere(rng, seen_at, RADIUS, DEVIATION, delay=delay)
        tracker.update(stamp - duration, [ball], str(duration))
        for track in tracker.tracks:
            if 0.7 < stamp < 1.0:
                assert track.resting
            if stamp > 1.4:
                assert not track.resting
                assert track.mean[:3] == pytest.approx(place(track.time), abs=5.0 * DEVIATION)
                assert track.mean[3] == pytest.approx(0.5, abs=0.1)
    assert [track.number for track in tracker.tracks] == [1]
    assert tracker.next_number == 2
