"""Balls that are found in the frames before they were first seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.scene import Environment
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.fitted_sphere import Start
from intuitive_physics_perception.detection.foreground import Clusters, ForegroundFinder
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.frame import Frame
from intuitive_physics_perception.hindsight import HINDSIGHT, Hindsight, RecentFrame
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.tracker import Tracker

from ..conftest import FLOOR, seen_sphere

SETTINGS = PerceptionSettings(environment_frames=4)
NO_GRAVITY = Environment([], gravity=(0.0, 0.0, 0.0))
SMALL = {"width": 400, "height_pixels": 300, "focal": 328.0}
STEP = 1.0 / 60.0
RADIUS = 0.05
PALM = (0.1, 0.025, 0.1)
HELD = 0.35
"""s for which the ball is held and swung."""


def flight_of(times: np.ndarray) -> np.ndarray:
    """Places (n, 3) m of a ball that flies up and to the left."""
    return [0.0, 0.0, 1.0] + np.outer(times, [0.0, 1.5, 1.0]) + np.outer(times**2, [0, 0, -4.905])


@given(st.integers(1, 12), st.integers(2, 12))
def test_a_track_is_as_if_it_had_been_followed_from_the_start(earlier: int, later: int) -> None:
    rng = np.random.default_rng([earlier, later])
    times = STEP * np.arange(earlier + later)
    places = [0.0, 0.0, 1.0] + np.outer(times, [1.0, 0.0, 2.0]) + np.outer(times**2, [0, 0, -4.905])
    detections = [seen_sphere(rng, place, RADIUS) for place in places]
    whole, part = Tracker(FLOOR, SETTINGS), Tracker(FLOOR, SETTINGS)
    for time, detection in zip(times, detections, strict=True):
        whole.update(float(time), [detection])
    for time, detection in list(zip(times, detections, strict=True))[earlier:]:
        part.update(float(time), [detection])
    (expected,), (track,) = whole._tracks, part._tracks
    track.earlier = list(zip(times[:earlier].tolist(), detections[:earlier], strict=True))[::-1]
    assert [time for time, _ in track.detections] == times.tolist()
    part.take_earlier(track)
    assert track.earlier is None
    np.testing.assert_allclose(track.mean, expected.mean, atol=1e-9)
    np.testing.assert_allclose(track.covariance, expected.covariance, atol=1e-12)
    assert [step.time for step in track.steps] == times.tolist()
    assert track.moving_since == 0.0


@given(st.integers(6, 12), st.integers(1, 3), st.integers(2, 12))
def test_what_is_found_in_a_gap_leaves_a_track_without_one(first: int, gap: int, last: int) -> None:
    rng, times = np.random.default_rng([first, gap, last]), STEP * np.arange(first + gap + last)
    detections = [seen_sphere(rng, place, RADIUS) for place in flight_of(times)]
    whole, part = Tracker(FLOOR, SETTINGS), Tracker(FLOOR, SETTINGS)
    for k, (time, seen) in enumerate(zip(times.tolist(), detections, strict=True)):
        whole.update(time, [seen])
        part.update(time, [] if first <= k < first + gap else [seen])
    (expected,), (track,) = whole.followed, part.followed
    missed = slice(first, first + gap)
    track.earlier = list(zip(times[missed].tolist(), detections[missed], strict=True))[::-1]
    part.take_earlier(track)
    np.testing.assert_allclose(track.mean, expected.mean, atol=1e-9)
    np.testing.assert_allclose(track.covariance, expected.covariance, atol=1e-12)
    assert [time for time, _ in track.detections] == times.tolist()


@given(st.lists(st.floats(0.01, 0.1), min_size=1, max_size=30), st.floats(0, 3))
def test_frames_are_kept_for_their_time(steps: list[float], asked: float) -> None:
    hindsight, times = Hindsight(), np.cumsum(steps).tolist()
    tracker = Tracker(NO_GRAVITY, SETTINGS)
    ball = DetectedSphere(np.array([0.0, 0.0, 1.0]), RADIUS, 1e-6 * np.eye(4), 200, 2.0)
    for time in times:
        tracker.update(time, [ball])
        frame = Frame(time, np.zeros((1, 1, 3), np.float32))
        hindsight.keep(RecentFrame(frame, Clusters([], [], 0, 0), shown=tracker.shown))
    (seen,) = tracker.followed
    other = replace(seen, number=seen.number + 1)
    kept = [time for time in times if time >= times[-1] - HINDSIGHT and time < asked]
    recent = hindsight.before(asked, other, tracker)
    assert (None if recent is None else recent.frame.time) == (kept[-1] if kept else None)
    assert hindsight.before(asked, seen, tracker) is None


@given(st.integers(7, 10), st.integers(0, 2), st.integers(0, 1000))
def test_what_was_elsewhere_when_the_ball_was_here_was_another_thing(other, missed, seed) -> None:
    """A track goes over from a hand to the ball that leaves it. The frames before show the ball, as
    nothing is at two places: the track is that of a ball which nothing else was."""
    rng, times = np.random.default_rng(seed), STEP * np.arange(other + missed + 12)
    ball = [seen_sphere(rng, place, RADIUS) for place in flight_of(times)]
    hand = [seen_sphere(rng, place - [0.0, 0.0, 0.15], RADIUS) for place in flight_of(times)]
    mixed, alone = Tracker(FLOOR, SETTINGS), Tracker(FLOOR, SETTINGS)
    for k, time in enumerate(times.tolist()):
        shown = [hand[k]] if k < other else [] if k < other + missed else [ball[k]]
        mixed.update(time, shown)
        alone.update(time, [ball[k]])
    (track,), (expected,) = mixed.followed, alone.followed
    assert track.number == 1
    if track.earlier is None:
        track.earlier = []
    for k in range(other + missed)[::-1]:
        time = float(times[k])
        assert not mixed.was_there(track, time)
        mixed.add_earlier(track, time, ball[k], time if k < other else None)
    mixed.take_earlier(track)
    assert [time for time, _ in track.detections] == times.tolist()
    np.testing.assert_allclose(track.mean, expected.mean, atol=1e-9)
    np.testing.assert_allclose(track.covariance, expected.covariance, atol=1e-12)
    assert track.moving_since == 0.0


def test_a_ball_is_looked_for_again_after_a_jump() -> None:
    """What a jump leads to may be another thing, whenever it comes."""
    tracker, rng = Tracker(NO_GRAVITY, SETTINGS), np.random.default_rng(3)
    looked_for = []
    for k, time in enumerate((STEP * np.arange(30)).tolist()):
        place = np.array([0.0, 0.01 * k, 1.0 if k < 15 else 1.2])
        tracker.update(time, [seen_sphere(rng, place, RADIUS)])
        (track,) = tracker.followed
        if k == 10:
            tracker.take_earlier(track)
        looked_for.append(track.earlier is not None)
    assert not any(looked_for[10:16])
    # As soon as it is clear where it goes from there.
    assert all(looked_for[15 + 5 :])


def test_a_ball_that_was_hit_stays_what_it_was() -> None:
    tracker, rng = Tracker(NO_GRAVITY, SETTINGS), np.random.default_rng(5)
    times = (STEP * np.arange(16)).tolist()
    for k, time in enumerate(times):
        place = np.array([0.0, 0.08 * max(k - 7, 0), 1.0])
        tracker.update(time, [seen_sphere(rng, place, RADIUS)])
    (track,) = tracker.followed
    track.earlier = []
    again = seen_sphere(rng, np.array([0.0, 0.0, 1.0]), RADIUS)
    tracker.add_earlier(track, times[6], again, times[6])
    tracker.take_earlier(track)
    assert [time for time, _ in track.detections] == times


def thrown_by_a_palm(room, shapes) -> tuple[list, float]:
    """Frames of a ball that a palm swings to the left and lets go, and the time of the release.

    The palm pushes with a(t) = A sin(π t / T) until it stops within a few frames; from then on the
    ball flies.
    """
    start, speed, swing = np.array([1.7, -0.5, 0.6]), 1.6, 0.3
    frames = [room.points() for _ in range(4)]
    release = None
    for time in np.arange(0.0, HELD + 0.35, STEP):
        # Without a phase of its own a frame would be at the release itself.
        t = time + 0.004 - (HELD - swing)
        phase = np.clip(t / swing, 0.0, 1.0)
        gone = speed * swing * (phase - np.sin(np.pi * phase) / np.pi) / 2.0
        # v = speed (1 - cos π t / T) / 2, which is `speed` with no acceleration at the end.
        since = max(t - swing, 0.0)
        ball = start + [0.0, gone + speed * since, -4.905 * since**2]
        follows = gone + 0.03 * speed * (1.0 - np.exp(-since / 0.03))
        palm = start + [0.0, follows - RADIUS - 0.5 * PALM[1], 0.0]
        if ball[2] < RADIUS:
            break
        box = shapes["box"](palm, PALM, 0.0)
        arm = shapes["box"](palm - [0.0, 0.0, 0.2], (0.06, 0.06, 0.3), 0.0)
        frames.append(room.points([(ball, RADIUS)], [box, arm]))
        if since > 0.0 and release is None:
            release = time - since
    return frames, 4 * STEP + release


def test_an_observation_begins_where_a_palm_lets_go(make_room, shapes, pipeline) -> None:
    frames, release = thrown_by_a_palm(make_room(tilt=20.0, height=1.0, seed=2, **SMALL), shapes)
    observations = []
    for k, frame in enumerate(frames):
        observations += pipeline.process(frame, k * STEP).observations
    observations += pipeline.finish()
    begins = min(observation.start_time for observation in observations)
    # A hand that no longer accelerates differs from flight by g t² / 2, which is three times the
    # noise of 2 mm after 35 ms; a frame more is the next one that shows it.
    assert -STEP < begins - release < 0.035 + STEP


def test_a_ball_beside_a_palm_is_found_where_it_is_expected(corner_model, shapes) -> None:
    room, model = corner_model
    place = np.array([1.8, 0.2, 0.6])
    palm = shapes["box"](place - [0.0, RADIUS + 0.05, 0.0], (0.1, 0.1, 0.1), 0.0)
    arm = shapes["box"](place - [0.0, RADIUS + 0.05, 0.2], (0.06, 0.06, 0.3), 0.0)
    before = np.linalg.norm(room.points(), axis=2)
    finder = SphereFinder(model, SETTINGS, np.random.default_rng(4))
    foreground = ForegroundFinder(model, SETTINGS, before)
    expected = Start(
        np.append(room.to_camera(place + [0.0, 0.01, -0.01]), RADIUS), size_is_known=True
    )
    errors = []
    for _ in range(5):
        points = room.points([(place, RADIUS)], [palm, arm])
        sphere = finder.find_expected(points, foreground.find(points), expected)
        assert sphere is not None
        errors.append([*(sphere.center - room.to_camera(place)), sphere.radius - RADIUS])
    # The depth of one frame is sure to some mm at this range, the sides to less.
    assert np.abs(np.mean(errors, axis=0)).max() < 0.006
    # Where only the palm is there is none.
    aside = Start(
        np.append(room.to_camera(place - [0.0, RADIUS + 0.05, 0.0]), RADIUS), size_is_known=True
    )
    assert finder.find_expected(points, foreground.find(points), aside) is None
