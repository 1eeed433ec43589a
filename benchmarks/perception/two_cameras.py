"""Two cameras of one scene with known poses: how much more exact than the first alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import PerceptionRun, tracked_spheres
from benchmarks.perception.scenes import LEAD_IN, SceneKind, random_truth
from benchmarks.perception.score import ENOUGH_PIXELS, rms
from benchmarks.results.result import Column, Table
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_experiments.rendering.camera import UP, Camera
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise, NoisyDepthCamera
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import points_from_depth

SEED = 38  # of the scenes, each of which has a generator of its own
SCENES, QUICK_SCENES = 6, 1
THROWS = 4  # in each scene, one ball at a time
RATE = 30.0  # frames a second of each camera
LAG = 0.4  # of a frame by which the second camera is later
AWAY = 2.0  # m before the first camera, of the place that both look at
APART = (50.0, 100.0)  # degrees between the two, as seen from there
FREE = 0.3  # m from the second camera to any wall, at least


def measure_two_cameras(quick: bool) -> Outcome:
    """Measure the states of balls that both cameras see."""
    count = QUICK_SCENES if quick else SCENES
    one: list[float] = []
    two: list[float] = []
    for k in range(count):
        report_progress(f"scene of two cameras {k + 1} of {count}")
        truth = random_truth(
            SceneKind(planes=1 + k % 2, balls_at_once=1, throws=THROWS, crates=k % 3),
            np.random.default_rng([SEED, k]),
        )
        cameras = [truth.camera, _second_camera(truth, np.random.default_rng([SEED, k, 1]))]
        alone = _errors(truth, cameras, 1, np.random.default_rng([SEED, k, 2]))
        both = _errors(truth, cameras, 2, np.random.default_rng([SEED, k, 2]))
        common = sorted(alone.keys() & both.keys())
        one += [alone[time] for time in common]
        two += [both[time] for time in common]
    ratio = rms(two) / rms(one)
    table = Table(
        title="Two cameras",
        note="Published places of balls, at the frames of the first camera in which both cameras "
        f"see at least {ENOUGH_PIXELS} pixels of the ball and both runs publish it.",
        columns=[
            Column("scenes"),
            Column("places"),
            Column("RMSE by the first alone", "mm", ".2f"),
            Column("by both", "mm", ".2f"),
            Column("ratio", "", ".3f"),
        ],
        rows=[[count, len(one), 1e3 * rms(one), 1e3 * rms(two), ratio]],
    )
    return Outcome([table], {"two_cameras_rmse_over_one": float(f"{ratio:.4g}")})


def _second_camera(truth: GroundTruth, rng: np.random.Generator) -> Camera:
    """A camera that looks at the same place from another side, inside the room."""
    first = truth.camera
    target = first.position + AWAY * first.rotation[:, 2]
    while True:
        angle = rng.choice([-1.0, 1.0]) * rng.uniform(*APART)
        turn = Rotation.from_rotvec(angle * UP, degrees=True)
        position = target + turn.apply(first.position - target)
        if all(plane.signed_distances(position) > FREE for plane in truth.environment.planes):
            return Camera.looking_at(position, target)


class _Eye:
    """One of the cameras, with noise of its own."""

    def __init__(
        self, camera: Camera, truth: GroundTruth, lag: float, rng: np.random.Generator
    ) -> None:
        self._camera, self._truth, self._lag = camera, truth, lag
        self._renderer = DepthRenderer(camera, truth.environment)
        background, focal = self._renderer.background, camera.focal_length
        self._sensor = NoisyDepthCamera(background, focal, DepthNoise(), rng)
        self._rays = Intrinsics(camera.width, camera.height, camera.matrix()).rays()
        turn = Rotation.from_matrix(camera.rotation).as_quat()
        self.pose = RigidTransform(camera.position, turn)

    def read(self, number: int) -> _Reading:
        """Read the frame of a number."""
        time = number / RATE + self._lag
        throws = self._truth.throws
        there = [n for n, t in enumerate(throws) if t.start_time <= time <= t.end_time]
        places = [throws[n].positions_at(np.array([time]))[0] for n in there]
        shown = self._renderer.render_balls(places, [throws[n].radius for n in there])
        points = points_from_depth(self._sensor.read(shown.image, shown.region), self._rays)
        seen = [n for k, n in enumerate(there) if (shown.owner == k).sum() >= ENOUGH_PIXELS]
        return _Reading(time, points, dict(zip(there, places, strict=True)), set(seen))


@dataclass(frozen=True, eq=False)
class _Reading:
    """A frame of one camera."""

    time: float  # s
    points: NDArray[np.float32]  # (height, width, 3) m
    places: dict[int, NDArray[np.float64]]  # (3,) m in the world, of each ball, by its throw
    seen: set[int]  # throws of balls with enough pixels


def _errors(
    truth: GroundTruth, cameras: Sequence[Camera], used: int, rng: np.random.Generator
) -> dict[tuple[float, int], float]:
    """Errors (m) of published places by time (s) of the first camera's frame and by throw, where
    both cameras see the ball; the frames of the first `used` cameras are perceived."""
    eyes = [
        _Eye(camera, truth, LAG * k / RATE, own)
        for k, (camera, own) in enumerate(zip(cameras, rng.spawn(len(cameras)), strict=True))
    ]
    run, errors = PerceptionRun(), dict[tuple[float, int], float]()
    for number in range(-int(LEAD_IN * RATE), int(RATE * max(t.end_time for t in truth.throws))):
        readings = [eye.read(number) for eye in eyes]
        results = [
            run.process(reading.points, reading.time, pose=eye.pose, camera="second" if k else "")
            for k, (eye, reading) in enumerate(zip(eyes[:used], readings, strict=False))
        ]
        for n in set.intersection(*(reading.seen for reading in readings)):
            true = eyes[0].pose.inverse.points(readings[0].places[n])
            away = [
                float(np.linalg.norm(run.model.to_sensor(item.state.position) - true))
                for item in tracked_spheres(results[0])
            ]
            if min(away, default=np.inf) < truth.throws[n].radius:
                errors[readings[0].time, n] = min(away)
    return errors
