"""Frames in; environment, object states and finished observations out (Sec. VI-B and VI-C)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment
from intuitive_physics.validation import unit_vector
from intuitive_physics_perception.detection.detections import (
    DetectedSolid,
    DetectedSphere,
    without_doubles,
)
from intuitive_physics_perception.detection.foreground import Clusters, ForegroundFinder
from intuitive_physics_perception.detection.solids import SolidFinder, all_objects
from intuitive_physics_perception.detection.spheres import ClusterSpheres, SphereFinder
from intuitive_physics_perception.environment.environment_model import (
    EnvironmentCheck,
    EnvironmentModel,
    NoEnvironmentError,
    model_environment,
)
from intuitive_physics_perception.environment.static_boxes import StaticBoxFilter, with_static_boxes
from intuitive_physics_perception.frame_result import FrameDiagnostics, FrameResult, PerceivedObject
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import Episode, EpisodeRecorder
from intuitive_physics_perception.tracking.tracker import Tracker


class PerceptionPipeline:
    """Perceives frame after frame of one sensor that stands still.

    Parameters
    ----------
    settings : of all stages
    rng : source of all random choices
    clock : seconds, by which stages are timed
    """

    def __init__(
        self,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        clock: Callable[[], float] = perf_counter,
    ) -> None:
        self.settings = settings
        self._rng = rng
        self._clock = clock
        self._next_track = 1
        self._last_time = -np.inf
        self._first_frames: list[NDArray[np.float32]] = []
        self._scene: ModelledScene | None = None
        self._up: NDArray[np.float64] | None = None

    def take_up(self, up: ArrayLike) -> None:
        """Take the measured direction against gravity.

        With `gravity_source` "imu" the environment is modelled once it is known.

        Parameters
        ----------
        up : (3,) in the sensor's frame, of any length
        """
        self._up = unit_vector(up, "up")

    def rebuild_environment(self) -> tuple[Observation, ...]:
        """Forget the environment, which the next frames model again; return what was under way."""
        return _observations(self._forget_environment())

    def process(
        self,
        points: NDArray[np.float32],
        time: float,
        colors: NDArray[np.uint8] | None = None,
    ) -> FrameResult:
        """Perceive one frame.

        Parameters
        ----------
        points : (height, width, 3) float32 m in the sensor's frame, NaN where nothing was read
        time : s. An earlier time than that of the last frame restarts tracking
        colors : (height, width, 3) red, green and blue of the points, where they are known
        """
        if colors is not None and colors.shape != points.shape:
            raise InvalidInputError(
                f"colours are {colors.shape} and points {points.shape}; expected the same shape"
            )
        if not np.isfinite(time):
            raise InvalidInputError(f"time of the frame is {time}; expected a finite number")
        if time == self._last_time:
            return self._unused(time, "two frames have the same time; expected increasing times")
        restarted = time < self._last_time
        episodes = self._restarted() if restarted else ()
        self._last_time = time
        if not _has_readings(points):
            problem = "the frame has no reading at all; expected points: is the sensor covered?"
            result = self._unused(time, problem)
        elif self._scene is None:
            result = self._model(points, time)
        else:
            result = self._perceive(self._scene, points, time, colors)
        return replace(
            result,
            episodes=(*episodes, *result.episodes),
            restarted=restarted,
        )

    def finish(self) -> tuple[Observation, ...]:
        """Return the observations of what still moves, as at the end of a recording."""
        return _observations(self._restarted())

    def _model(self, points: NDArray[np.float32], time: float) -> FrameResult:
        """Collect the first frames, then model the environment."""
        if self.settings.gravity_source == "imu" and self._up is None:
            return self._unused(time, "up is not known yet; expected an IMU that has rested")
        self._first_frames.append(points)
        if len(self._first_frames) < self.settings.environment_frames:
            return FrameResult(time, None)
        started = self._clock()
        frames, self._first_frames = self._first_frames, []
        try:
            model = model_environment(frames, self.settings, self._rng, self._up)
        except NoEnvironmentError as error:
            return self._unused(time, str(error))
        if self.settings.static_boxes:
            model = with_static_boxes(model, frames, self.settings, self._rng)
        self._scene = ModelledScene(
            model, self.settings, self._rng, self._next_track, _nearest_ranges(frames)
        )
        self._scene.prepare(points)
        seconds = {"environment": self._clock() - started}
        return FrameResult(
            time, model, is_new_model=True, diagnostics=FrameDiagnostics(seconds=seconds)
        )

    def _perceive(
        self,
        scene: ModelledScene,
        points: NDArray[np.float32],
        time: float,
        colors: NDArray[np.uint8] | None,
    ) -> FrameResult:
        """Remove the planes, detect objects, track them, see which episodes are over."""
        instants = [self._clock()]
        moved = scene.check.moved(points, time)
        if moved:
            episodes = self._forget_environment()
            return replace(self._unused(time, moved), episodes=episodes, moved=moved)
        clusters = scene.clusters(points)
        instants.append(self._clock())
        spheres = scene.find_spheres(points, clusters, time)
        instants.append(self._clock())
        seen = all_objects(points, spheres, scene.solids, colors)
        scene.foreground.expect_objects([one.pixels(points) for one in seen])
        found = [one.detection for one in seen]
        pose = scene.model.rotation, scene.model.translation
        detections = [detection.moved(*pose) for detection in found]
        instants.append(self._clock())
        ended = scene.tracker.update(time, detections)
        alive = scene.tracker.tracks
        objects = tuple(
            PerceivedObject(
                track.scene_object(self.settings),
                track.object_state(scene.model.environment, self.settings),
                track.color,
            )
            for track in alive
        )
        instants.append(self._clock())
        episodes = scene.episodes.update(time, alive, ended)
        instants.append(self._clock())
        stages = ("planes", "spheres", "solids", "tracking", "episodes")
        diagnostics = FrameDiagnostics(
            readings=clusters.readings,
            foreground=clusters.foreground,
            clusters=len(clusters.indices),
            spheres=sum(isinstance(detection, DetectedSphere) for detection in found),
            solids=sum(isinstance(detection, DetectedSolid) for detection in found),
            seconds=dict(zip(stages, map(float, np.diff(instants)), strict=True)),
        )
        return FrameResult(
            time,
            scene.model,
            detections=tuple(detections),
            objects=objects,
            episodes=episodes,
            diagnostics=diagnostics,
        )

    def _forget_environment(self) -> tuple[Episode, ...]:
        """Let the next frames model the environment; return what was under way."""
        episodes = self._restarted()
        self._first_frames, self._scene = [], None
        return episodes

    def _restarted(self) -> tuple[Episode, ...]:
        """Restart tracking in the same environment; return what was under way."""
        if self._scene is None:
            return ()
        episodes = self._scene.episodes.finish(self._scene.tracker.tracks)
        self._next_track = self._scene.tracker.next_number
        self._scene.restart_tracking(self._next_track)
        return episodes

    def _unused(self, time: float, problem: str) -> FrameResult:
        model = self._scene.model if self._scene else None
        return FrameResult(time, model, diagnostics=FrameDiagnostics(problem=problem))


def _has_readings(points: NDArray[np.float32]) -> bool:
    return bool(points.size) and bool(np.isfinite(points[..., 2]).any())


def _observations(episodes: Sequence[Episode]) -> tuple[Observation, ...]:
    return tuple(found for episode in episodes for found in episode.observations())


def _nearest_ranges(frames: Sequence[NDArray[np.float32]]) -> NDArray[np.float32] | None:
    """Nearest range (height, width) m that each pixel read in organised frames, NaN for none."""
    if frames[0].shape[0] == 1 or any(frame.shape != frames[0].shape for frame in frames):
        return None
    ranges = np.fmin.reduce([np.linalg.norm(frame, axis=2) for frame in frames])
    return np.asarray(ranges, dtype=np.float32)


class ModelledScene:
    """Stages made for one environment, and what they remember of it.

    Parameters
    ----------
    model : the environment
    settings : of all stages
    rng : source of all random choices
    first_track : number of the first track
    before : (height, width) m, what the frames read that it was modelled from; None where their
        readings have no fixed pixels
    """

    def __init__(
        self,
        model: EnvironmentModel,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        first_track: int,
        before: NDArray[np.float32] | None,
    ) -> None:
        self.model = model
        self._settings = settings
        self.check = EnvironmentCheck(model, settings)
        self.foreground = ForegroundFinder(model, settings, before)
        self.static_boxes = StaticBoxFilter(model, settings)
        self.spheres = SphereFinder(model.noise, settings, rng, before)
        self.solids = SolidFinder(model, settings, rng) if settings.find_solids else None
        self.restart_tracking(first_track)

    def clusters(self, points: NDArray[np.float32]) -> Clusters:
        """Return clusters of what is neither a plane nor a static box.

        Parameters
        ----------
        points : (height, width, 3) m, of a frame
        """
        return self.static_boxes.without(points, self.foreground.find(points))

    def find_spheres(
        self, points: NDArray[np.float32], clusters: Clusters, time: float
    ) -> list[ClusterSpheres]:
        """Return the spheres of a frame by cluster: those that are followed are looked for first,
        where they are expected.

        Parameters
        ----------
        points : (height, width, 3) m
        time : s
        """
        expected = [
            np.append(self.model.to_sensor(sphere[:3]), sphere[3])
            for sphere in self.tracker.expected_spheres(time)
        ]
        return self.spheres.find(
            points, clusters, self._settings.clusters.searches_in_frame, expected
        )

    def prepare(self, points: NDArray[np.float32]) -> None:
        """Find where each pixel's ray meets a plane, and search the first clusters, so that no
        later frame waits for it.

        Parameters
        ----------
        points : (height, width, 3) m, of a frame
        """
        for _ in range(self._settings.clusters.first_searches):
            spheres = self.spheres.find(points, self.clusters(points))
            all_objects(points, spheres, self.solids)

    def restart_tracking(self, first_track: int) -> None:
        """Forget all tracks; the environment stays."""
        self.tracker = Tracker(self.model.environment, self._settings, first_track)
        self.episodes = EpisodeRecorder(self.model.environment, self._settings)


def perceive_cloud(
    points: ArrayLike, settings: PerceptionSettings, rng: np.random.Generator
) -> tuple[Environment, list[DetectedSphere]]:
    """Perceive one cloud alone: its environment, and the spheres in the environment's frame.

    Parameters
    ----------
    points : (n, 3) or (height, width, 3) m in the sensor's frame, the sensor at the origin; NaN
        where nothing was read

    Raises
    ------
    InvalidInputError
        When the points have another shape.
    NoEnvironmentError
        When the cloud shows no supporting plane.
    """
    try:
        cloud = np.ascontiguousarray(points, dtype=np.float32)
    except (TypeError, ValueError):
        raise InvalidInputError(f"points are {points!r:.80}; expected numbers (n, 3)") from None
    if cloud.ndim not in (2, 3) or cloud.shape[-1] != 3:
        raise InvalidInputError(
            f"points have the shape {cloud.shape}; expected (n, 3) or (height, width, 3)"
        )
    frame = cloud if cloud.ndim == 3 else cloud[None]
    model = model_environment([frame], settings, rng)
    clusters = ForegroundFinder(model, settings).find(frame)
    found = SphereFinder(model.noise, settings, rng).find(frame, clusters)
    spheres = without_doubles([sphere for part in found for sphere in part.spheres])
    return model.environment, [s.moved(model.rotation, model.translation) for s in spheres]
