"""A LiDAR beside a camera: a scan takes as long as three of its frames, and each reading has a
time of its own, before or after the scan's stamp."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

from .conftest import waves

CAMERA_RATE, SCAN = 30.0, 0.1
RADIUS, THROWN, FLIES = 0.07, 0.85, 0.55
START, VELOCITY = np.array([1.4, -0.7, 0.4]), np.array([0.4, 1.6, 2.7])
SPIN = np.array([5.0, -8.0, 6.0])
"""rad/s of a ball with marks."""


MARKS = waves(3)


def flight(time: float) -> np.ndarray:
    """p0 + v t - g t²/2, m."""
    t = time - THROWN
    return START + VELOCITY * t - [0.0, 0.0, 0.5 * 9.81 * t**2]


def balls(time: float) -> list:
    return [(flight(time), RADIUS)] if 0.0 <= time - THROWN < FLIES else []


class CameraAndLidar:
    """A camera of 30 Hz that looks along x, and a LiDAR of 10 Hz that looks along -y, of which
    scans have the stamp of their last reading or, where it is `early`, of their first."""

    def __init__(self, make_room, seed: int, early: bool = False) -> None:
        self.camera, self.lidar = make_room(seed=2 * seed), make_room(seed=2 * seed + 1)
        self.lidar.look_along_minus_y([1.8, 1.3, 0.8])
        after = np.linspace(0.0, SCAN, self.lidar.width, dtype=np.float32)
        size = self.lidar.height_pixels, self.lidar.width
        self.offsets = np.broadcast_to(after if early else after - np.float32(SCAN), size)
        self.pipeline = PerceptionPipeline(
            PerceptionSettings(environment_frames=4), np.random.default_rng(seed)
        )
        self.to_room = RigidTransform()

    def scan(self, stamp: float) -> np.ndarray:
        """Readings (height, width, 3) m; the columns pass the ball, from left to right, where it is
        then, and it stands still for the 6 ms in which they do."""
        times = stamp + self.offsets[0]
        columns = [self.column_of(flight(time)) for time in times]
        passes = np.abs(columns - np.arange(len(times))).argmin()
        return self.lidar.points(balls(times[passes]))

    def column_of(self, place: np.ndarray) -> float:
        """Column in which the LiDAR sees a place (3,) m, also one beside its image."""
        x, _, z = self.lidar.to_camera(place)
        return self.lidar.matrix[0, 0] * x / z + self.lidar.matrix[0, 2]

    def colors(self, time: float) -> np.ndarray:
        """Grey levels (height, width, 3) of a camera's frame, on a ball of those of `MARKS` on its
        surface, which turns with `SPIN`."""
        rays = self.camera.rays / np.linalg.norm(self.camera.rays, axis=-1, keepdims=True)
        relative = flight(time) - self.camera.origin
        along = rays @ relative
        square = along**2 - relative @ relative + RADIUS**2
        normals = (rays * (along - np.sqrt(np.maximum(square, 0.0)))[..., None] - relative) / RADIUS
        turned = normals @ Rotation.from_rotvec((time - THROWN) * SPIN).as_matrix()
        is_ball = (square > 0.0) & bool(balls(time))
        levels = np.where(is_ball, 128.0 + 45.0 * MARKS(turned), 90.0)
        noisy = levels + self.camera.rng.normal(0.0, 1.0, levels.shape)
        return np.repeat(np.clip(noisy, 0, 255).astype(np.uint8)[..., None], 3, axis=2)

    def results(
        self, until: float, *, scans: bool = True, late: float = 0.004, marked: bool = False
    ):
        """Yield name and result of each frame, in the order of the stamps; these of scans are
        `late` s after those of frames. A ball that is `marked` shows that in the camera's."""
        frames = [(k / CAMERA_RATE, "") for k in range(int(until * CAMERA_RATE))]
        if scans:
            frames += [(n * SCAN + late, "lidar") for n in range(int(until / SCAN))]
        for stamp, name in sorted(frames):
            room = self.lidar if name else self.camera
            points = self.scan(stamp) if name else room.points(balls(stamp))
            colors = self.colors(stamp) if marked and not name else None
            times = {"offsets": self.offsets} if name else {}
            result = self.pipeline.process(points, stamp, colors, room.pose, name, **times)
            if result.is_new_model and not name:
                self.to_room = room.pose.after(result.model.sensor_pose.inverse)
            yield name, result

    def error(self, item, time: float) -> float:
        return float(np.linalg.norm(self.to_room.points(item.state.position) - flight(time)))


@pytest.mark.parametrize("early", [False, True])
def test_a_track_goes_on_over_each_scan_and_is_no_worse_for_it(make_small_room, early) -> None:
    """The LiDAR reads the ball up to 0.1 s before frames that have been used already: v t is 30 cm
    in that time, and g t²/2 is 5 cm. An estimate from more data has a smaller error."""
    rmse = {}
    for scans in (False, True):
        errors = []
        for seed in range(3):
            sensors = CameraAndLidar(make_small_room, seed, early)
            results = list(sensors.results(THROWN + FLIES, scans=scans))
            assert not any(result.restarted for _, result in results)
            items = [(name, result, item) for name, result in results for item in result.objects]
            assert len({item.object.id for _, _, item in items}) == 1
            errors += [sensors.error(item, result.time) for _, result, item in items]
            shown = sum(bool(name) and item.detection is not None for name, _, item in items)
            assert not scans or shown >= 3
        rmse[scans] = np.sqrt(np.mean(np.square(errors)))
    assert rmse[True] < 1.15 * rmse[False]


def test_a_detection_is_that_of_its_own_frame(make_small_room) -> None:
    """Each is published once, at the time of its readings, and observed once, in their order."""
    sensors, times = CameraAndLidar(make_small_room, 0), []
    for name, result in sensors.results(THROWN + FLIES):
        for item in result.objects:
            if item.detection is not None:
                times.append((float(item.detection.times[0]), name))
                place = sensors.to_room.points(item.detection.positions[0])
                assert place == pytest.approx(flight(times[-1][0]), abs=0.01)
    assert len(set(times)) == len(times) > 14
    assert all(round(30.0 * time, 6).is_integer() == (not name) for time, name in times)
    (observation,) = sensors.pipeline.finish()
    seen = observation.objects[0].detections.times
    assert (np.diff(seen) > 0.0).all()
    assert {time for time, _ in times} <= set(seen)


def test_a_bag_that_is_played_again_restarts_tracking_once(make_small_room) -> None:
    sensors = CameraAndLidar(make_small_room, 0)
    results = [result for _ in range(2) for _, result in sensors.results(THROWN + FLIES)]
    restarts = [n for n, result in enumerate(results) if result.restarted]
    assert restarts == [len(results) // 2]


@pytest.mark.parametrize("early", [False, True])
def test_the_spin_that_marks_show_is_known_beside_scans_as_without_them(
    make_small_room, early
) -> None:
    """A free flight keeps its spin ω, whatever else sees it; the images are the same with scans as
    without, so it is known as soon. (ω̂ - ω)ᵀ Σ⁻¹ (ω̂ - ω) is χ² with three degrees of freedom."""
    first_known = {}
    for scans in (False, True):
        sensors, known = CameraAndLidar(make_small_room, 0, early), []
        for _, result in sensors.results(THROWN + FLIES, scans=scans, marked=True):
            seen = [item.detection for item in result.objects if item.detection is not None]
            for spin in (detection.spin for detection in seen if detection.spin is not None):
                known.append(result.time)
                error = sensors.to_room.directions(spin.mean) - SPIN
                assert np.linalg.norm(error) < 0.5
                assert error @ np.linalg.solve(spin.covariance, error) < 25.0
        first_known[scans] = min(known, default=np.inf)
    assert first_known[True] < first_known[False] + 0.5 * SCAN < THROWN + FLIES
