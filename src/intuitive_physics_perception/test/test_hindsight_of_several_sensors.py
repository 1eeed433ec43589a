"""A ball that one sensor has found is looked for in the earlier frames of another, of which each
reading has a time of its own."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.frame import Frame
from intuitive_physics_perception.hindsight import Hindsight, RecentFrame
from intuitive_physics_perception.scene import ModelledScene
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.tracker import Tracker

from .conftest import FLOOR, seen_sphere

SETTINGS = PerceptionSettings(environment_frames=4)
RADIUS, FRAME, SCAN = 0.07, 1.0 / 60.0, 0.1
START, VELOCITY = np.array([1.7, -0.6, 0.5]), np.array([0.3, 4.0, 1.0])
FOUND = 0.1
"""s from when on the other sensor has detected the ball."""


def flight(time: float) -> np.ndarray:
    """p0 + v t - g t²/2, m."""
    return START + VELOCITY * time - [0.0, 0.0, 0.5 * 9.81 * time**2]


def offsets_of(room) -> np.ndarray:
    """Times (height, width) s of the readings of a scan from right to left after its first."""
    columns = np.linspace(SCAN, 0.0, room.width, dtype=np.float32)
    return np.broadcast_to(columns, (room.height_pixels, room.width))


def scan(room, begin: float) -> tuple[np.ndarray, float]:
    """Readings (height, width, 3) m of a scan that passes the ball where it is then, and when that
    is, s."""
    times = begin + offsets_of(room)[0]
    places = room.to_camera(np.array([flight(time) for time in times]))
    columns = room.matrix[0, 0] * places[:, 0] / places[:, 2] + room.matrix[0, 2]
    passed = np.abs(columns - np.arange(room.width)).argmin()
    return room.points([(flight(times[passed]), RADIUS)]), float(times[passed])


class TwoSensors:
    """A scene as one sensor sees it, in which another sensor detects the ball."""

    def __init__(self, room) -> None:
        self.room = room
        frames, rng = [room.points() for _ in range(4)], np.random.default_rng(0)
        model = model_environment(frames, SETTINGS, rng)
        self.stages = ModelledScene(model, frames, SETTINGS, rng).stages
        self.tracker, self.hindsight = Tracker(self.stages.model.environment, SETTINGS), Hindsight()

    def place(self, time: float) -> np.ndarray:
        model = self.stages.model
        return self.room.to_camera(flight(time)) @ model.rotation.T + model.translation

    def keep(self, time: float, points: np.ndarray, offsets: np.ndarray | None) -> None:
        """Take a frame in which the ball is not yet apart from what releases it."""
        frame = Frame(time, points, offsets=offsets)
        clusters = self.stages.clusters(points)
        self.hindsight.keep(RecentFrame(frame, clusters, self.tracker.shown))
        self.hindsight.search(self.tracker, self.stages, FrameBudget())

    def detect(self, times: list[float], delay: float) -> None:
        """Detect the ball at some times, s, `delay` s after the beginnings of frames."""
        rng = np.random.default_rng(1)
        for time in times:
            seen = seen_sphere(rng, self.place(time), RADIUS, delay=delay)
            self.tracker.update(time - delay, [seen])

    def found(self, time: float, points: np.ndarray, offsets: np.ndarray | None):
        """Take a last frame; return times (n,) s of what was found in earlier ones, and how far off
        (n,) m its places are from where the ball was then."""
        (track,) = self.tracker.tracks
        known = {when for when, _ in track.detections}
        self.keep(time, points, offsets)
        earlier = [pair for pair in track.detections if pair[0] not in known]
        off = [np.linalg.norm(seen.center - self.place(when)) for when, seen in earlier]
        return np.array([when for when, _ in earlier]), np.array(off)


def test_a_camera_looks_where_a_ball_was_that_a_lidar_found(make_small_room) -> None:
    """The readings of a camera are of its stamps: in the 50 ms by which those of the LiDAR are
    late the ball flies 20 cm. What is found has the errors of one frame."""
    scene = TwoSensors(make_small_room(seed=2))
    stamps = FOUND - FRAME * np.arange(4, 0, -1)
    for time in stamps:
        scene.keep(time, scene.room.points([(flight(time), RADIUS)]), None)
    scene.detect([FOUND + FRAME * k for k in range(6)], delay=0.05)
    times, off = scene.found(FOUND + FRAME * 5, scene.room.points(), None)
    assert times == pytest.approx(stamps[2:])
    assert off.max() < 0.015


@pytest.mark.parametrize("begin", [0.0, 0.02, 0.04])
def test_a_scan_shows_a_ball_that_a_camera_found_when_it_read_it(make_small_room, begin) -> None:
    """The readings of a scan are up to 0.1 s after its first, in which the ball flies 40 cm."""
    scene = TwoSensors(make_small_room(seed=2))
    offsets = offsets_of(scene.room)
    points, read = scan(scene.room, begin)
    scene.keep(begin, points, offsets)
    scene.detect([read + FRAME * k for k in range(1, 7)], delay=0.0)
    times, off = scene.found(begin + SCAN, scene.room.points(), offsets)
    assert times == pytest.approx([read], abs=0.001)
    assert off.max() < 0.015


@pytest.mark.parametrize("apart", [0.0, 0.0005])
def test_two_sensors_at_about_one_time_say_nothing_of_a_velocity(apart) -> None:
    """Extrapolated over a frame from two places with the errors σ, a frame apart, a place has the
    error √5 σ; from two of one time it may be anywhere."""
    tracker, rng, deviation = Tracker(FLOOR, SETTINGS), np.random.default_rng(4), 0.002
    for k in range(1, 5):
        for lag, camera in ((0.0, ""), (apart, "side")):
            time = FRAME * k + lag
            tracker.update(time, [seen_sphere(rng, flight(time), RADIUS, deviation)], camera)
    (track,) = tracker.tracks
    expected = tracker.expected_before(track, 0.0)
    assert expected is not None
    error = np.linalg.norm(expected.start.sphere[:3] - flight(0.0))
    # Of the bend, g times the square of a frame.
    assert error < 3.0 * np.sqrt(3.0 * 5.0) * deviation + 9.81 * FRAME**2
