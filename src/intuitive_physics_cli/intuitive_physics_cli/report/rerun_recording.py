"""Perception and predictions as a Rerun recording, to be watched over time.

Needs `rerun-sdk` (`pip install rerun-sdk`); open the file with `rerun FILE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.geometry.polygons import plane_square
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_perception.frame_result import FrameResult

TIMELINE = "time"
"""Name of the time axis in Rerun; it counts s."""

PLANE_REACH = 3.0
"""m, half the edge of the square that is drawn of a plane without an edge."""

GRAVITY_SHOWN = 0.05
"""m of arrow for each m/s²."""

VELOCITY_SHOWN = 0.1
"""m of arrow for each m/s."""

MOST_CLOUD_POINTS = 20_000
"""Points of a cloud that are logged at most; a depth image has fifteen times as many."""

SAMPLE_COLOR, MEAN_COLOR, SEEN_COLOR = (37, 99, 235, 60), (17, 24, 39), (22, 163, 74)
"""Red, green, blue and, where there is a fourth number, opacity, 0 to 255 each."""

SPHERE_COLOR, GRAVITY_COLOR, PLANE_COLOR = (6, 182, 212), (220, 38, 38), (245, 158, 11, 60)
"""Likewise, for the results of perception."""


class RerunRecording:
    """A context that writes a Rerun recording to a file, usually `.rrd`."""

    def __init__(self, path: Path) -> None:
        self._rerun = _rerun()
        self._stream = self._rerun.RecordingStream("intuitive_physics")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        except OSError as error:
            raise InvalidInputError(f"cannot write {path}: {error.strerror}") from None
        self._stream.save(path)
        self._stream.log("/", self._rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def __enter__(self) -> RerunRecording:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.disconnect()

    def environment(self, environment: Environment) -> None:
        """Log planes and gravity."""
        rr = self._rerun
        for plane in environment.planes:
            corners = plane.boundary
            if corners is None:
                corners = plane_square(plane.normal, plane.offset, np.zeros(3), 2.0 * PLANE_REACH)
            fan = [(0, k, k + 1) for k in range(1, len(corners) - 1)]
            mesh = rr.Mesh3D(
                vertex_positions=corners, triangle_indices=fan, albedo_factor=PLANE_COLOR
            )
            self._stream.log(f"environment/{_path(plane.id)}", mesh)
        arrow = rr.Arrows3D(
            origins=[(0.0, 0.0, 1.0)],
            vectors=[GRAVITY_SHOWN * environment.gravity],
            colors=[GRAVITY_COLOR],
        )
        self._stream.log("environment/gravity", arrow)

    def perceived(self, points: NDArray[np.float32], frame: FrameResult) -> None:
        """Log one frame's points (..., 3) m, in the sensor's frame, and what was found in it."""
        if frame.model is None:
            return
        self._at(frame.time)
        if frame.is_new_model:
            self.environment(frame.model.environment)
        cloud = points.reshape(-1, 3)
        cloud = cloud[np.isfinite(cloud).all(axis=1)]
        cloud = cloud[:: max(1, len(cloud) // MOST_CLOUD_POINTS)]
        placed = frame.model.to_environment(cloud)
        self._stream.log("cloud", self._rerun.Points3D(placed, radii=0.004))
        rr = self._rerun
        centers = np.array([tracked.state.position for tracked in frame.objects]).reshape(-1, 3)
        speeds = np.array([tracked.state.linear_velocity for tracked in frame.objects]).reshape(
            -1, 3
        )
        radii = [tracked.object.shape.bounding_radius for tracked in frame.objects]
        self._stream.log("objects", rr.Points3D(centers, radii=radii, colors=[SPHERE_COLOR]))
        arrows = rr.Arrows3D(origins=centers, vectors=VELOCITY_SHOWN * speeds)
        self._stream.log("objects/velocity", arrows)

    def observation(self, seen: Observation, start_time: float) -> None:
        """Log each object as a ball of its size, and its trail, from `start_time` (s) on."""
        for observed_object in seen.objects:
            path = f"seen/{_path(observed_object.object.id)}"
            radius = observed_object.object.shape.bounding_radius
            positions = observed_object.trajectory.positions
            for k, time in enumerate(observed_object.trajectory.times):
                self._at(start_time + float(time) - seen.start_time)
                self._log_points(f"{path}/now", positions[k : k + 1], radius, SPHERE_COLOR)
                self._log_lines(f"{path}/trail", [positions[: k + 1]], SEEN_COLOR)
            self._stream.log(path, self._rerun.Clear(recursive=True))

    def prediction(self, case: PredictionCase, start_time: float) -> None:
        """Log a prediction from `start_time` (s) on: samples as lines, and where each is when."""
        path = f"predicted/{_path(case.name)}"
        self._at(start_time)
        self._log_lines(f"{path}/samples", list(case.samples), SAMPLE_COLOR)
        self._log_lines(f"{path}/mean", [case.mean], MEAN_COLOR)
        for k, time in enumerate(case.times):
            self._at(start_time + float(time))
            self._log_points(f"{path}/now", case.samples[:, k], 0.01, SAMPLE_COLOR)
        self._stream.log(path, self._rerun.Clear(recursive=True))

    def _at(self, time: float) -> None:
        self._stream.set_time(TIMELINE, duration=time)

    def _log_points(
        self, path: str, points: NDArray[np.float64], radius: float, color: Sequence[int]
    ) -> None:
        self._stream.log(path, self._rerun.Points3D(points, radii=radius, colors=[color]))

    def _log_lines(
        self, path: str, lines: Sequence[NDArray[np.float64]], color: Sequence[int]
    ) -> None:
        self._stream.log(path, self._rerun.LineStrips3D(lines, colors=[color]))


def _path(name: str) -> str:
    """A name as one part of an entity path."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name)


def _rerun() -> ModuleType:
    try:
        import rerun
    except ImportError:
        raise IntuitivePhysicsError(
            "Rerun is not installed; expected it for a recording: pip install rerun-sdk"
        ) from None
    return rerun
