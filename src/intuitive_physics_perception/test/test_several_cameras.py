"""Several cameras of one scene: what any of them sees is one track, in one frame."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.tracker import Tracker

from .conftest import FLOOR, seen_sphere

RATE, RADIUS = 30.0, 0.07
SETTINGS = PerceptionSettings(environment_frames=4)
MODELLED = 8
"""Frames of each camera after which both have modelled what they see."""


def flight(time: float) -> np.ndarray:
    """p0 + v t - g t²/2."""
    start, velocity = np.array([1.4, -0.4, 0.5]), np.array([0.4, 0.6, 1.6])
    return start + velocity * time - [0.0, 0.0, 0.5 * 9.81 * time**2]


class Cameras:
    """Two cameras in one room: one looks along x, the other along -y; both at 30 Hz, the second
    `lag` s later than the first."""

    def __init__(self, make_room, lag: float = 0.013, seed: int = 0) -> None:
        self.first, self.second = make_room(seed=2 * seed), make_room(seed=2 * seed + 1)
        self.lag = lag
        self.second.look_along_minus_y([1.6, 1.2, 0.8])
        self.believed = {"": self.first.pose, "side": self.second.pose}
        self.pipeline = PerceptionPipeline(SETTINGS, np.random.default_rng(seed))
        self.from_environment: RigidTransform | None = None

    def frames(self, place, frames: int, using=("", "side"), blind=()):
        """Yield name, time and result of each frame; `place` of the ball by time, None for none;
        to cameras that are `blind` it is hidden."""
        for k in range(frames):
            for name, room, lag in (("", self.first, 0.0), ("side", self.second, self.lag)):
                if name not in using:
                    continue
                time = k / RATE + lag
                ball = place(time) if name not in blind or k < MODELLED else None
                points = room.points([(ball, RADIUS)] if ball is not None else [])
                result = self.pipeline.process(points, time, None, self.believed[name], name)
                if result.is_new_model:
                    camera = self.believed[""]
                    self.from_environment = camera.after(result.model.sensor_pose.inverse)
                yield name, time, result

    def error(self, item, truth) -> float:
        return float(np.linalg.norm(self.from_environment.points(item.state.position) - truth))


def flies(time: float):
    flown = time - MODELLED / RATE
    return flight(flown) if 0.0 <= flown < 0.42 else None


def test_two_cameras_follow_one_ball_more_exactly_than_one(make_small_room) -> None:
    """With n independent readings of one noise the error falls as 1/√n, and where the noise is
    along each one's line of sight and these are at right angles, by more."""
    rmse = {}
    for using in (("",), ("", "side")):
        errors = []
        for seed in range(3):
            cameras = Cameras(make_small_room, seed=seed)
            ids = set()
            for _, time, result in cameras.frames(flies, MODELLED + 12, using):
                for item in result.objects:
                    errors.append(cameras.error(item, flies(time)))
                    ids.add(item.object.id)
                    assert item.detection is not None
            assert len(ids) == 1
        rmse[len(using)] = np.sqrt(np.mean(np.square(errors)))
    assert rmse[2] < 0.85 * rmse[1]


def test_two_measurements_of_the_same_noise_have_half_the_variance(rng) -> None:
    """The variance of the mean of n measurements is σ²/n, whichever camera each is of."""
    variances = []
    for cameras in (1, 2):
        tracker = Tracker(FLOOR, PerceptionSettings())
        for k in range(20):
            for camera in range(cameras):
                sphere = seen_sphere(rng, [1.0, 0.0, RADIUS], RADIUS, 0.002)
                tracker.update(k / RATE + 0.01 * camera, [sphere])
        (track,) = tracker.tracks
        variances.append(track.radius_variance)
    assert variances[1] == pytest.approx(0.5 * variances[0], rel=1e-6)


def test_a_track_goes_on_while_any_camera_sees_it(make_small_room) -> None:
    """The ball is hidden from the first camera all the time, and known in its frames all the
    same."""
    cameras = Cameras(make_small_room)
    known = [
        [item.object.id for item in result.objects]
        for name, time, result in cameras.frames(flies, MODELLED + 13, blind=[""])
        if name == "" and time > (MODELLED + 5) / RATE
    ]
    assert len(known) >= 6
    assert known == [["sphere_1"]] * len(known)
    (observation,) = cameras.pipeline.finish()
    assert len(observation.objects) == 1


def test_cameras_of_one_trigger_make_one_observation(make_small_room) -> None:
    """Frames of one time are both used, and the times of an observation increase."""
    cameras = Cameras(make_small_room, lag=0.0)
    results = [result for _, _, result in cameras.frames(flies, MODELLED + 13)]
    late = [result for result in results if not result.objects and 0.47 < result.time < 0.65]
    assert not late
    (observation,) = cameras.pipeline.finish()
    times = observation.objects[0].detections.times
    assert all(later > earlier for earlier, later in pairwise(times))
    assert len(times) >= 18


def test_a_wrong_pose_is_reported(make_small_room) -> None:
    cameras = Cameras(make_small_room)
    for _ in cameras.frames(lambda _: None, MODELLED):
        pass
    assert cameras.pipeline.further_doubt("side") == ""
    raised = RigidTransform((0.0, 0.0, 0.05)).after(cameras.believed["side"])
    cameras = Cameras(make_small_room)
    cameras.believed["side"] = raised
    for _ in cameras.frames(lambda _: None, MODELLED):
        pass
    (distance,) = re.findall(r"a plane is (\S+) cm", cameras.pipeline.further_doubt("side"))
    assert float(distance) == pytest.approx(5.0, abs=0.3)


def test_time_that_goes_back_restarts_all_cameras(make_small_room) -> None:
    cameras = Cameras(make_small_room)
    for _ in cameras.frames(flies, MODELLED + 6):
        pass
    again = list(cameras.frames(flies, MODELLED + 13))
    assert again[0][2].restarted
    assert not any(result.restarted for _, _, result in again[1:])
    followed = {item.object.id for _, _, result in again for item in result.objects}
    assert len(followed) == 1
