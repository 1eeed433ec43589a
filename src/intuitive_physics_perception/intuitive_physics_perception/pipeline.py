"""Frame in; environment, object states and finished observations out (Sec. VI-B and VI-C)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics.scene import SceneObject
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import unit_vector
from intuitive_physics_perception.detected_solid import DetectedSolid
from intuitive_physics_perception.detection import Detection
from intuitive_physics_perception.environment_check import EnvironmentCheck
from intuitive_physics_perception.environment_model import (
    EnvironmentModel,
    NoEnvironmentError,
    model_environment,
)
from intuitive_physics_perception.episodes import EpisodeRecorder
from intuitive_physics_perception.foreground import ForegroundFinder
from intuitive_physics_perception.objects import all_objects
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.solids import SolidFinder
from intuitive_physics_perception.spheres import DetectedSphere, SphereFinder
from intuitive_physics_perception.static_boxes import with_static_boxes
from intuitive_physics_perception.tracker import Tracker


@dataclass(frozen=True)
class PerceivedObject:
    """An object that is followed now: what it is, and its state in the environment's frame."""

    object: SceneObject
    state: ObjectState


@dataclass(frozen=True)
class FrameDiagnostics:
    """What happened to one frame.

    Parameters
    ----------
    problem : one sentence on why the frame could not be used, empty when it could
    readings : points in range
    foreground : points off all planes
    clusters : groups of foreground points looked at
    spheres, solids : how many were found; solids are boxes and capsules
    seconds : time each stage took, by its name
    """

    problem: str = ""
    readings: int = 0
    foreground: int = 0
    clusters: int = 0
    spheres: int = 0
    solids: int = 0
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Perceived:
    """What one frame told.

    Parameters
    ----------
    time : s
    model : the environment; None while it is not known
    is_new_model : whether this frame completed it
    restarted : whether time went back, so that what was followed is followed anew
    moved : one sentence when the sensor was moved, so that the environment is modelled anew from
        the frames that follow; else empty
    detections : what was found in this frame alone, in the environment's frame
    objects : what is followed, in the environment's frame
    observations : those that this frame finished
    diagnostics : how it went
    """

    time: float
    model: EnvironmentModel | None
    is_new_model: bool = False
    restarted: bool = False
    moved: str = ""
    detections: tuple[Detection, ...] = ()
    objects: tuple[PerceivedObject, ...] = ()
    observations: tuple[Observation, ...] = ()
    diagnostics: FrameDiagnostics = FrameDiagnostics()


class PerceptionPipeline:
    """Perceives frame after frame of one sensor that stands still.

    Parameters
    ----------
    settings : see there
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
        self._scene: _ModelledScene | None = None
        self._up: NDArray[np.float64] | None = None

    def take_up(self, up: ArrayLike) -> None:
        """Take the measured direction against gravity, (3,) in the sensor's frame.

        With `gravity_source` "imu" the environment is modelled once it is known.
        """
        self._up = unit_vector(up, "up")

    def rebuild_environment(self) -> tuple[Observation, ...]:
        """Forget the environment, which the next frames model anew; return what was under way."""
        observations = self._restarted()
        self._first_frames, self._scene = [], None
        return observations

    def process(self, points: NDArray[np.float32], time: float) -> Perceived:
        """Perceive one frame.

        Parameters
        ----------
        points : (height, width, 3) float32 m in the sensor's frame, NaN where nothing was read
        time : s. An earlier time than that of the last frame restarts tracking.
        """
        if not np.isfinite(time):
            raise InvalidInputError(f"time of the frame is {time}; expected a finite number")
        if time == self._last_time:
            return self._unused(time, "two frames have the same time; expected increasing times")
        restarted = time < self._last_time
        observations = self._restarted() if restarted else ()
        self._last_time = time
        if not _has_readings(points):
            problem = "the frame has no reading at all; expected points: is the sensor covered?"
            perceived = self._unused(time, problem)
        elif self._scene is None:
            perceived = self._model(points, time)
        else:
            perceived = self._perceive(self._scene, points, time)
        return replace(
            perceived,
            observations=(*observations, *perceived.observations),
            restarted=restarted,
        )

    def finish(self) -> tuple[Observation, ...]:
        """Return the observations of what still moves, as at the end of a recording."""
        return self._restarted()

    def _model(self, points: NDArray[np.float32], time: float) -> Perceived:
        """Collect the first frames, then model the environment."""
        if self.settings.gravity_source == "imu" and self._up is None:
            return self._unused(time, "up is not known yet; expected an IMU that has rested")
        self._first_frames.append(points)
        if len(self._first_frames) < self.settings.environment_frames:
            return Perceived(time, None)
        started = self._clock()
        frames, self._first_frames = self._first_frames, []
        try:
            model = model_environment(frames, self.settings, self._rng, self._up)
        except NoEnvironmentError as error:
            return self._unused(time, str(error))
        if self.settings.static_boxes:
            model = with_static_boxes(model, frames, self.settings, self._rng)
        self._scene = _ModelledScene(model, self.settings, self._rng, self._next_track)
        # What each pixel sees of the planes is found out here, so that no later frame waits.
        self._scene.foreground.find(points)
        seconds = {"environment": self._clock() - started}
        return Perceived(
            time, model, is_new_model=True, diagnostics=FrameDiagnostics(seconds=seconds)
        )

    def _perceive(
        self, scene: _ModelledScene, points: NDArray[np.float32], time: float
    ) -> Perceived:
        """Take the planes out, find objects, follow them, close what is finished."""
        instants = [self._clock()]
        moved = scene.check.moved(points, time)
        if moved:
            observations = self.rebuild_environment()
            return replace(self._unused(time, moved), observations=observations, moved=moved)
        clusters = scene.foreground.find(points)
        instants.append(self._clock())
        spheres = scene.spheres.find(points, clusters)
        instants.append(self._clock())
        found = all_objects(points, spheres, scene.solids if self.settings.find_solids else None)
        pose = scene.model.rotation, scene.model.translation
        detections = [detection.moved(*pose) for detection in found]
        instants.append(self._clock())
        ended = scene.tracker.update(time, detections)
        alive = scene.tracker.tracks
        objects = tuple(
            PerceivedObject(
                track.scene_object(self.settings),
                track.object_state(scene.model.environment, self.settings),
            )
            for track in alive
        )
        instants.append(self._clock())
        observations = tuple(scene.episodes.update(time, alive, ended))
        instants.append(self._clock())
        stages = ("planes", "spheres", "solids", "tracking", "observations")
        diagnostics = FrameDiagnostics(
            readings=clusters.readings,
            foreground=clusters.foreground,
            clusters=len(clusters.indices),
            spheres=sum(isinstance(detection, DetectedSphere) for detection in found),
            solids=sum(isinstance(detection, DetectedSolid) for detection in found),
            seconds=dict(zip(stages, map(float, np.diff(instants)), strict=True)),
        )
        return Perceived(
            time,
            scene.model,
            detections=tuple(detections),
            objects=objects,
            observations=observations,
            diagnostics=diagnostics,
        )

    def _restarted(self) -> tuple[Observation, ...]:
        """Begin to follow anew in the same environment; return what was under way."""
        if self._scene is None:
            return ()
        observations = tuple(self._scene.episodes.finish(self._scene.tracker.tracks))
        self._next_track = self._scene.tracker.next_number
        self._scene.follow_anew(self.settings, self._next_track)
        return observations

    def _unused(self, time: float, problem: str) -> Perceived:
        model = self._scene.model if self._scene else None
        return Perceived(time, model, diagnostics=FrameDiagnostics(problem=problem))


class _ModelledScene:
    """The stages that need the environment."""

    def __init__(
        self,
        model: EnvironmentModel,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        first_track: int,
    ) -> None:
        self.model = model
        self.check = EnvironmentCheck(model, settings)
        self.foreground = ForegroundFinder(model, settings)
        self.spheres = SphereFinder(model.noise, settings, rng)
        self.solids = SolidFinder(model, settings, rng)
        self.follow_anew(settings, first_track)

    def follow_anew(self, settings: PerceptionSettings, first_track: int) -> None:
        """Forget what was followed; the environment stays."""
        self.tracker = Tracker(self.model.environment, settings, first_track)
        self.episodes = EpisodeRecorder(self.model.environment, settings)


def _has_readings(points: NDArray[np.float32]) -> bool:
    return bool(points.size) and bool(np.isfinite(points[..., 2]).any())
