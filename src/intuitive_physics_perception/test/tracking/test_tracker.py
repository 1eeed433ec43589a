"""Tracks: who is who, how fast, how large, and when it is over."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.scene import Environment
from intuitive_physics.shapes import Capsule
from intuitive_physics_perception.detection.detections import DetectedSolid
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_perception.tracking.episodes import detection_at, record_of
from intuitive_physics_perception.tracking.tracker import Tracker

from ..conftest import FLOOR, seen_sphere

SETTINGS = PerceptionSettings()
STEP = 1.0 / 30.0
NOISE = 0.001


def detection(rng, place, radius=0.05, noise=NOISE, color=None):
    return seen_sphere(rng, place, radius, noise, color=color)


def follow(tracker, rng, paths, times, radius=0.05):
    """Feed paths (n_balls, n_times, 3); return tracks after each frame and all that ended."""
    alive, ended = [], []
    for k, time in enumerate(times):
        spheres = [detection(rng, path[k], radius) for path in paths if np.isfinite(path[k]).all()]
        ended += tracker.update(float(time), spheres)
        alive.append(deepcopy(tracker.tracks))
    return alive, ended


def test_velocity_before_and_after_a_bounce(rng, bounce) -> None:
    times = np.arange(0, 1.2, STEP)
    path = bounce(times, (0, 0, 0.8), (0.5, 0.2, 0.0), 0.05, 0.7)
    tracker = Tracker(FLOOR, SETTINGS)
    alive, _ = follow(tracker, rng, [path], times)
    assert {track.number for tracks in alive for track in tracks} == {1}
    truth = np.gradient(path, times, axis=0)
    # Away from bounces (at 0.39 and 0.93 s) central differences of parabolas are exact.
    for k in (8, 9, 10, 18, 19, 20, 25, 26):
        speed = alive[k][0].mean[3:6]
        assert np.linalg.norm(speed - truth[k]) < 0.12, times[k]


RED, BLUE = np.array([0.7, 0.2, 0.2]), np.array([0.2, 0.2, 0.7])


@pytest.mark.parametrize("elastic", [True, False])
@pytest.mark.parametrize("colored", [True, False])
def test_colours_tell_balls_that_meet_from_balls_that_pass(rng, elastic, colored) -> None:
    """Equal balls that meet head-on without loss exchange their velocities: where balls are seen
    is the same as if they had passed through each other, and only colour tells who is who."""
    times = np.arange(0, 0.8, STEP)
    along = np.array([1.0, 0.0, 0.0])
    first, second = -0.4 + 1.0 * times, 0.4 - 1.0 * times
    if elastic:
        first, second = np.minimum(first, second), np.maximum(first, second)
    tracker = Tracker(Environment(FLOOR.planes, gravity=(0, 0, -1e-6)), SETTINGS)
    for k, time in enumerate(times):
        light = rng.uniform(0.8, 1.0)
        tracker.update(
            float(time),
            [
                detection(
                    rng, np.array([0, 0, 1.0]) + x[k] * along, color=light * c if colored else None
                )
                for x, c in ((first, RED), (second, BLUE))
            ],
        )
    tracks = sorted(tracker.tracks, key=lambda track: track.number)
    assert [track.number for track in tracks] == [1, 2]
    # Without colour the simpler explanation holds: they passed.
    truly = first if colored or not elastic else second
    assert tracks[0].mean[0] == pytest.approx(truly[-1], abs=0.01)
    if colored:
        assert tracks[0].color == pytest.approx(RED, abs=0.15)
        assert tracks[1].color == pytest.approx(BLUE, abs=0.15)


def test_a_ball_whose_colour_changes_in_a_shadow_stays_itself(rng, bounce) -> None:
    times = np.arange(0, 0.8, STEP)
    path = bounce(times, (0, 0, 0.8), (0.5, 0.2, 0.0), 0.05, 0.7)
    tracker = Tracker(FLOOR, SETTINGS)
    for k, time in enumerate(times):
        color = RED if k % 8 < 4 else 0.1 * BLUE
        assert tracker.update(float(time), [detection(rng, path[k], color=color)]) == []
    assert [track.number for track in tracker.tracks] == [1]


def capsule(rng, place, direction, length: float, radius: float = 0.04) -> DetectedSolid:
    """A capsule along a direction, with the errors of one frame."""
    return DetectedSolid(
        Capsule(radius, length),
        np.asarray(place) + NOISE * rng.normal(size=3),
        Rotation.align_vectors([direction], [[0.0, 0.0, 1.0]])[0].as_matrix(),
        NOISE**2 * np.eye(3),
        0.02**2 * np.eye(3),
        NOISE**2,
        300,
        1.0,
    )


def lying_capsule(rng) -> DetectedSolid:
    """A capsule of 4 cm radius and 20 cm between its ends, along x."""
    return capsule(rng, [0.3, 0.2, 0.04], [1.0, 0.0, 0.0], 0.2)


@pytest.mark.parametrize("turned", [True, False])
def test_a_capsule_that_was_seen_end_on_is_a_capsule_once_its_side_is_seen(rng, turned) -> None:
    """From the end it is a ball of its radius at the near cap; a ball apart from it stays one."""
    place = lying_capsule(rng).center + (np.array([-0.1, 0, 0]) if turned else [-0.2, 0, 0])
    tracker = Tracker(FLOOR, SETTINGS)
    for k in range(6):
        tracker.update(k * STEP, [detection(rng, place, 0.04)])
    assert [track.kind for track in tracker.tracks] == ["sphere"]
    ended = []
    for k in range(6, 9):
        ended += tracker.update(k * STEP, [lying_capsule(rng)])
    kinds = [track.kind for track in tracker.tracks]
    assert kinds == (["capsule"] if turned else ["sphere", "capsule"])
    # The ball did not end, which would make an observation of it: it never was one.
    assert ended == []
    # Seen end-on again it is no further thing.
    for k in (9, 10):
        tracker.update(k * STEP, [detection(rng, place, 0.04)])
    assert [track.kind for track in tracker.tracks] == kinds
    assert tracker.next_number == (2 if turned else 3)


@pytest.mark.parametrize("rate", [30, 60, 90])
def test_a_ball_that_noise_gives_a_side_in_a_frame_stays_a_ball(rng, rate) -> None:
    """It is a capsule only once nothing else was seen for as long as makes it an object."""
    place, tracker = np.array([0.0, 0.0, 0.6]), Tracker(FLOOR, SETTINGS)
    for k in range(rate):
        ball = detection(rng, place, 0.04)
        if k % rate == rate // 2:
            ball = capsule(rng, place, [1.0, 0.0, 0.0], 0.011, radius=0.038)
        tracker.update(k / rate, [ball])
        assert [track.kind for track in tracker.followed] == ["sphere"]
    (track,) = tracker.tracks
    assert len(track.detections) == rate
    assert track.mean[:3] == pytest.approx(place, abs=0.005)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(3.0, 8.0), rate=st.floats(30.0, 90.0))
def test_a_ball_that_is_swept_in_some_frames_is_one_ball(seed, speed, rate) -> None:
    """Whichever frames show a capsule along its way, partly or fully: one number, no other kind at
    the end, and an error as the covariance says."""
    rng = np.random.default_rng(seed)
    heading = rng.normal(size=3) * [1.0, 1.0, 0.3]
    velocity = speed * heading / np.linalg.norm(heading)
    tracker, numbers = Tracker(FLOOR, SETTINGS), set()
    for time in np.arange(0.0, 0.3, 1.0 / rate):
        place = [0.0, 0.0, 3.0] + time * velocity + 0.5 * time**2 * FLOOR.gravity
        now = velocity + time * FLOOR.gravity
        if rng.random() < 0.5:
            seen = detection(rng, place, 0.04)
        else:
            # What a ball is taken for that is swept by an exposure.
            swept = rng.uniform(0.4, 0.9) / rate * float(np.linalg.norm(now))
            seen = capsule(rng, place, now, swept)
        tracker.update(float(time), [seen])
        numbers |= {track.number for track in tracker.followed}
    tracker.update(float(time) + 1.0 / rate, [detection(rng, place + now / rate, 0.04)])
    (track,) = tracker.tracks
    assert numbers == {1}
    assert track.kind == "sphere"
    off = track.mean[3:6] - now - FLOOR.gravity / rate
    assert off @ np.linalg.solve(track.covariance[3:6, 3:6], off) < 25.0


def test_a_short_occlusion_keeps_the_track_and_a_long_one_ends_it(rng, bounce) -> None:
    times = np.arange(0, 1.0, STEP)
    path = bounce(times, (0, 0, 1.5), (1.0, 0, 1.0), 0.05)
    hidden = path.copy()
    hidden[10:15] = np.nan
    alive, ended = follow(Tracker(FLOOR, SETTINGS), rng, [hidden], times)
    assert ended == []
    assert {track.number for track in alive[-1]} == {1}
    hidden[10:22] = np.nan
    alive, ended = follow(Tracker(FLOOR, SETTINGS), rng, [hidden], times)
    assert [track.number for track in ended] == [1]
    assert {track.number for track in alive[-1]} == {2}


def test_radius_is_averaged(rng) -> None:
    times = np.arange(0, 1.0, STEP)
    still = np.tile([0.3, 0.2, 0.05], (times.size, 1))
    alive, _ = follow(Tracker(FLOOR, SETTINGS), rng, [still], times)
    assert alive[-1][0].mean[6] == pytest.approx(0.05, abs=0.0006)
    assert np.sqrt(alive[-1][0].covariance[6, 6]) < 0.4 * NOISE


def test_a_ball_that_lies_still_comes_to_rest_even_where_nothing_is_modelled(rng) -> None:
    # On a chair the model does not know.
    times = np.arange(0, 2.0, STEP)
    still = np.tile([0.3, 0.2, 0.5], (times.size, 1))
    alive, ended = follow(Tracker(FLOOR, SETTINGS), rng, [still], times)
    (track,) = alive[-1]
    assert ended == []
    assert track.resting
    assert track.mean[:3] == pytest.approx(still[0], abs=0.002)
    assert track.mean[3:6] == pytest.approx([0, 0, 0])
    assert {t.number for tracks in alive for t in tracks} == {1}


def test_a_ball_at_the_top_of_a_throw_is_not_at_rest(rng) -> None:
    # A line fitted to the points about the top has no slope.
    times = np.arange(0, 1.0, STEP)
    path = np.zeros((times.size, 3))
    path[:, 2] = 0.1 + 4.9 * times - 0.5 * 9.81 * times**2
    alive, _ = follow(Tracker(FLOOR, SETTINGS), rng, [path], times)
    assert [len(tracks) for tracks in alive[5:]] == [1] * (times.size - 5)
    assert not any(track.resting for tracks in alive for track in tracks)


def test_a_resting_ball_that_is_hit_moves_again(rng) -> None:
    times = np.arange(0, 2.0, STEP)
    path = np.tile([0.0, 0.0, 0.05], (times.size, 1))
    late = times > 1.2
    path[late, 0] = 1.0 * (times[late] - 1.2)
    alive, _ = follow(Tracker(FLOOR, SETTINGS), rng, [path], times)
    assert alive[34][0].resting
    (track,) = alive[-1]
    assert not track.resting
    assert track.number == 1
    assert track.moving_since == pytest.approx(1.2, abs=0.1)
    assert track.mean[3] == pytest.approx(1.0, abs=0.1)


def test_single_false_detections_never_become_objects(rng) -> None:
    tracker = Tracker(FLOOR, SETTINGS)
    for k in range(60):
        place = rng.uniform(-1, 1, 3) + [0, 0, 2]
        tracker.update(k * STEP, [detection(rng, place)] if k % 4 == 0 else [])
        assert tracker.tracks == []


def test_a_known_object_gives_name_material_and_radius(rng, bounce) -> None:
    objects = (KnownObject("small", 0.03, "wood"), KnownObject("large", 0.05, "rubber"))
    settings = replace(SETTINGS, known_objects=objects)
    times = np.arange(0, 0.4, STEP)
    path = bounce(times, (0, 0, 1), (1, 0, 0), 0.05)
    alive, _ = follow(Tracker(FLOOR, settings), rng, [path], times, radius=0.051)
    ball = alive[-1][0].scene_object(settings)
    assert (ball.id, ball.material) == ("large_1", "rubber")
    assert ball.shape.bounding_radius == pytest.approx(0.05, abs=1e-4)
    alive, _ = follow(Tracker(FLOOR, settings), rng, [path], times, radius=0.04)
    ball = alive[-1][0].scene_object(settings)
    assert (ball.id, ball.material) == ("sphere_1", "ball_38_46mm")


def test_unknown_spheres_have_the_material_of_their_size(rng, bounce) -> None:
    times = np.arange(0, 0.4, STEP)
    path = bounce(times, (0, 0, 1), (1, 0, 0), 0.05)
    objects = (KnownObject("large", 0.05, "rubber"),)
    settings = replace(SETTINGS, known_objects=objects)
    alike = replace(settings, material_radius_ratio=1.0)
    cases = {0.02: "ball_18_22mm", 0.033: "ball_32_38mm", 0.035: "ball_32_38mm", 0.05: "rubber"}
    for radius, material in cases.items():
        alive, _ = follow(Tracker(FLOOR, settings), rng, [path], times, radius=radius)
        assert alive[-1][0].scene_object(settings).material == material
        alive, _ = follow(Tracker(FLOOR, alike), rng, [path], times, radius=radius)
        assert alive[-1][0].scene_object(alike).material in ("ball", "rubber")


def test_a_detection_is_that_of_its_frame_given_the_averaged_radius(rng) -> None:
    # Of a ball whose line of sight does not turn, `record_of` moves each centre in the same way.
    tracker = Tracker(FLOOR, SETTINGS)
    times = np.arange(10) / 30.0
    follow(tracker, rng, [np.tile([0.0, 0.0, 1.0], (10, 1))], times)
    (track,) = tracker.tracks
    newest, record = detection_at(track, track.time), record_of(track, SETTINGS)
    assert newest.times.tolist() == [times[-1]]
    np.testing.assert_allclose(newest.positions[0], record.positions[-1], atol=1e-12)
    np.testing.assert_allclose(newest.covariances[0], record.covariances[-1], atol=1e-15)
    tracker.update(times[-1] + 0.01, [])
    assert detection_at(track, track.time) is None


@pytest.mark.parametrize("hidden", [slice(0), slice(10, 14)], ids=["seen", "hidden"])
def test_balls_that_cross_keep_their_names(rng, hidden) -> None:
    # Where they cross the farther one may be hidden for four frames.
    times = np.arange(0, 0.8, STEP)
    weightless = Environment(FLOOR.planes, gravity=(0, 0, -1e-6))
    for trial in range(10):
        speed, gap = rng.uniform(1.0, 3.0), rng.uniform(0.06, 0.12)
        left = np.column_stack([speed * (times - 0.4), gap + 0 * times, 1 + 0 * times])
        right = np.column_stack([-speed * (times - 0.4), -gap + 0 * times, 1 + 0 * times])
        right[hidden] = np.nan
        alive, _ = follow(Tracker(weightless, SETTINGS), rng, [left, right], times)
        speeds = {track.number: track.mean[3] for track in alive[-1]}
        assert speeds == {
            1: pytest.approx(speed, abs=0.15),
            2: pytest.approx(-speed, abs=0.15),
        }, trial


@pytest.mark.parametrize("rate", [15, 30, 60, 90])
@pytest.mark.parametrize("speed", [0.06, 0.1, 0.5])
def test_a_ball_that_starts_slowly_from_rest_is_seen_to_move(rng, rate, speed) -> None:
    """Within 0.4 s, though no single frame contradicts rest."""
    times = np.arange(0, 3.0, 1.0 / rate)
    along = np.maximum(times - 1.5, 0.0) * speed
    tracker, velocities = Tracker(FLOOR, SETTINGS), []
    for time, x in zip(times, along, strict=True):
        tracker.update(float(time), [detection(rng, (x, 0.2, 0.05))])
        (track,) = tracker.tracks or [None]
        if 1.0 < time < 1.5:
            assert track.resting
        if time > 1.9:
            assert not track.resting
            off = track.mean[3:6] - [speed, 0, 0]
            assert off @ np.linalg.solve(track.covariance[3:6, 3:6], off) < 25.0
            velocities.append(track.mean[3:6])
    assert np.mean(velocities, axis=0) == pytest.approx([speed, 0, 0], abs=0.015)
    assert 1.2 < track.moving_since < 1.8


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rate=st.floats(15.0, 90.0), noise=st.floats(0.0003, 0.008))
def test_a_ball_at_rest_stays_at_rest_whatever_the_noise(seed, rate, noise) -> None:
    rng = np.random.default_rng(seed)
    tracker = Tracker(FLOOR, SETTINGS)
    for time in np.arange(0, 4.0, 1.0 / rate):
        tracker.update(float(time), [detection(rng, (0.3, 0.2, 0.5), noise=noise)])
        if time > 1.2:
            assert [track.resting for track in tracker.tracks] == [True]


@pytest.mark.parametrize("rate", [15, 30, 60, 90])
def test_an_object_is_one_after_the_same_time_at_every_frame_rate(rng, rate) -> None:
    tracker, times = Tracker(FLOOR, SETTINGS), np.arange(0, 0.5, 1.0 / rate)
    is_object = []
    for time in times:
        tracker.update(float(time), [detection(rng, (0.3, 0.2, 0.5))])
        is_object.append(bool(tracker.tracks))
    # Three frames at 30 Hz last 67 ms; a slower camera needs as many.
    assert times[is_object.index(True)] == pytest.approx(max(2 / 30, 2 / rate), abs=0.018)


@pytest.mark.parametrize("rate", [30, 60, 90])
def test_a_suggestion_that_is_not_seen_again_is_given_up_after_the_same_time(rng, rate) -> None:
    tracker = Tracker(FLOOR, SETTINGS)
    tracker.update(0.0, [detection(rng, (0.3, 0.2, 0.5))])
    for time in np.arange(1.0 / rate, 0.2, 1.0 / rate):
        tracker.update(float(time), [])
    for k in range(rate // 5):
        tracker.update(0.2 + k / rate, [detection(rng, (0.3, 0.2, 0.5))])
    assert [track.number for track in tracker.tracks] == [2]
