"""Frame in; environment, object states and finished observations out (Sec. VI-B and VI-C)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment, SceneObject
from intuitive_physics.state import ObjectState
from intuitive_physics_perception.environment_model import (
    EnvironmentModel,
    NoEnvironmentError,
    model_environment,
)
from intuitive_physics_perception.episodes import EpisodeRecorder
from intuitive_physics_perception.foreground import ForegroundFinder
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.spheres import DetectedSphere, SphereFinder
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
    spheres : spheres found
    seconds : time each stage took, by its name
    """

    problem: str = ""
    readings: int = 0
    foreground: int = 0
    clusters: int = 0
    spheres: int = 0
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
    spheres : what was found in this frame alone, in the environment's frame
    objects : what is followed, in the environment's frame
    observations : those that this frame finished
    diagnostics : how it went
    """

    time: float
    model: EnvironmentModel | None
    is_new_model: bool = False
    restarted: bool = False
    spheres: tuple[DetectedSphere, ...] = ()
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
        self._first_frames.append(points)
        if len(self._first_frames) < self.settings.environment_frames:
            return Perceived(time, None)
        started = self._clock()
        frames, self._first_frames = self._first_frames, []
        try:
            model = model_environment(frames, self.settings, self._rng)
        except NoEnvironmentError as error:
            return self._unused(time, str(error))
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
        """Take the planes out, find spheres, follow them, close what is finished."""
        instants = [self._clock()]
        clusters = scene.foreground.find(points)
        instants.append(self._clock())
        spheres = [
            in_environment(sphere, scene.model) for sphere in scene.spheres.find(points, clusters)
        ]
        instants.append(self._clock())
        ended = scene.tracker.update(time, spheres)
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
        stages = ("planes", "spheres", "tracking", "observations")
        diagnostics = FrameDiagnostics(
            readings=clusters.readings,
            foreground=clusters.foreground,
            clusters=len(clusters.indices),
            spheres=len(spheres),
            seconds=dict(zip(stages, map(float, np.diff(instants)), strict=True)),
        )
        return Perceived(
            time,
            scene.model,
            spheres=tuple(spheres),
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
        self.foreground = ForegroundFinder(model, settings)
        self.spheres = SphereFinder(model.noise, settings, rng)
        self.follow_anew(settings, first_track)

    def follow_anew(self, settings: PerceptionSettings, first_track: int) -> None:
        """Forget what was followed; the environment stays."""
        self.tracker = Tracker(self.model.environment, settings, first_track)
        self.episodes = EpisodeRecorder(self.model.environment, settings)


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
    spheres = SphereFinder(model.noise, settings, rng).find(frame, clusters)
    return model.environment, [in_environment(sphere, model) for sphere in spheres]


def in_environment(sphere: DetectedSphere, model: EnvironmentModel) -> DetectedSphere:
    """Return a sphere of the sensor's frame in the environment's frame."""
    turn = np.eye(4)
    turn[:3, :3] = model.rotation
    return replace(
        sphere,
        center=model.to_environment(sphere.center),
        covariance=turn @ sphere.covariance @ turn.T,
    )


def _has_readings(points: NDArray[np.float32]) -> bool:
    return bool(points.size) and bool(np.isfinite(points[..., 2]).any())
