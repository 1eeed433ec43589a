"""One environment over time: what is known of it from wherever a sensor sees it, its revision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.scene import Environment
from intuitive_physics_perception.appearance.turn_search import SEARCH_STEP, turn_tables
from intuitive_physics_perception.detection.detections import DetectedSphere, without_doubles
from intuitive_physics_perception.detection.foreground import Clusters, ForegroundFinder
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.environment.environment_model import (
    EnvironmentModel,
    NoEnvironmentError,
    is_organised,
    model_environment,
    revised_environment,
)
from intuitive_physics_perception.environment.fusion import fused_frame
from intuitive_physics_perception.environment.gravity import MIN_TURN, FlightGravity
from intuitive_physics_perception.environment.known_space import NEW, KnownSpace, View
from intuitive_physics_perception.environment.range_cloud import spacing_of
from intuitive_physics_perception.environment.settled_view import SettledView
from intuitive_physics_perception.environment.standing import EnvironmentCheck, is_same_view
from intuitive_physics_perception.environment.static_boxes import with_static_boxes
from intuitive_physics_perception.hindsight import Hindsight
from intuitive_physics_perception.sensor_motion.sensor_motion import SensorMotion, sensor_motion_in
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.stages import Stages
from intuitive_physics_perception.tracking.episodes import Episode, record_of
from intuitive_physics_perception.tracking.followed_objects import FollowedObjects

LOOKED_AT = 0.01
"""Part of a frame's readings that may lie where nobody has looked before until the frame is
remembered."""

Result = TypeVar("Result")


class ModelledScene:
    """One environment as it changes, and as one sensor sees it, which may move.

    Only where the sensor stood when the environment was modelled, at home, each pixel has its ray
    again: there the environment is checked and revised, and frames are kept for hindsight.

    `model`: of its planes, to which what else stands there is added; `frames` (height, width, 3) m
    each, that it was modelled from; `pose`: of the sensor then, None where it is not known to move;
    `measured`: whether gravity was measured, so that flights are not needed; `background`: in which
    the environment is revised while frames go on; None revises it at once; `follows_sensor`: find
    the sensor by what it sees, as nobody gives its pose.

    Attributes
    ----------
    motion : what follows the sensor by what it sees; None where its pose is given, or it cannot be
        followed
    """

    def __init__(
        self,
        model: EnvironmentModel,
        frames: Sequence[NDArray[np.float32]],
        settings: PerceptionSettings,
        rng: np.random.Generator,
        *,
        pose: RigidTransform | None = None,
        measured: bool = False,
        background: Executor | None = None,
        follows_sensor: bool = False,
    ) -> None:
        model = with_static_boxes(model, frames, settings, rng)
        self._settings = settings
        self._rng = rng
        self._background = background
        fused = _fused(frames)
        self._view: SettledView | None = None
        if fused is not None and settings.revise_environment:
            self._view = SettledView(fused, model.noise)
        self.motion: SensorMotion | None = None
        if fused is not None and follows_sensor:
            self.motion = sensor_motion_in(fused, frames, model, settings)
        self._home = RigidTransform() if pose is None and self.motion is not None else pose
        # From where the sensor is now; None at home.
        self._way: RigidTransform | None = None
        self._revising: Future[tuple[Stages, View, SensorMotion | None]] | None = None
        self._space = KnownSpace(model.noise, spacing_of(frames[-1], rng))
        self._space.take(self._space.view(frames, model.sensor_pose))
        self._looking: Future[View] | None = None
        self._flights: FlightGravity | None = None
        if settings.gravity_from_flights and settings.gravity_source == "plane" and not measured:
            self._flights = FlightGravity(settings.gravity)
        self.hindsight = Hindsight()
        self.stages = Stages(model, settings, rng, _nearest_ranges(frames), self._space)
        self.stages.prepare(frames)
        if settings.spin_from_surface:
            # The first ball that flies cannot wait for them.
            turn_tables(SEARCH_STEP)
        self._check = EnvironmentCheck(model, settings, revised=self._view is not None)

    @property
    def model(self) -> EnvironmentModel:
        """The environment as it is known now, and as the sensor sees it."""
        return self.stages.model

    @property
    def is_at_home(self) -> bool:
        """Whether the sensor stands where it stood when the environment was modelled."""
        return self._way is None

    @property
    def seen_pose(self) -> RigidTransform | None:
        """The pose of the sensor by what it sees; None where it is not followed."""
        if self.motion is None or self._home is None:
            return None
        return self._home.after(self.motion.way)

    def restart(self) -> None:
        """Forget the last frames, since when readings have stayed, and how the sensor has moved by
        what it saw."""
        self._forget_frames()
        if self.motion is not None:
            self.motion.restart()

    def _forget_frames(self) -> None:
        self.hindsight.forget()
        if self._view is not None:
            self._view.restart()

    def look_from(self, pose: RigidTransform | None) -> None:
        """Take the pose of the sensor, None where it is not known to have moved."""
        if pose is None or self._home is None:
            return
        way = self._home.inverse.after(pose)
        here = None if is_same_view(way, self.model.noise) else way
        if _is_same(here, self._way):
            return
        if self._way is None:
            self._forget_frames()
        self._way = here
        self.stages.look_from(here)

    def moved(self, points: NDArray[np.float32], time: float) -> str:
        """Say in a sentence that the sensor was moved though its pose does not show it; empty while
        it was not.

        `points` (height, width, 3) m; `time` in s.
        """
        moved = self._check.moved(points, time) if self.is_at_home else ""
        if moved and self.motion is not None and self.motion.doubt:
            moved += f" (how it has moved is not known: {self.motion.doubt})"
        return moved

    def look_about(
        self, points: NDArray[np.float32], clusters: Clusters, followed: FollowedObjects
    ) -> None:
        """Remember what a frame shows where nobody has looked before, without what has come where
        nothing was: that does not stand there, and stays new where it goes.

        `points` (height, width, 3) m.
        """
        is_unknown = clusters.unknown > LOOKED_AT * clusters.readings
        if self._looking is None and self.stages.foreground.asks_map and is_unknown:
            standing = followed.removed_from(points, self.model)
            standing[clusters.marks == NEW] = np.nan
            pose = self.model.sensor_pose
            self._looking = begun(self._background, self._space.view, [standing], pose)
        if self._looking is not None and self._looking.done():
            self._space.fill(self._looking.result())
            self._looking = None

    def up_of_flights(self, episodes: Sequence[Episode]) -> NDArray[np.float64] | None:
        """Return the unit vector (3,) against gravity in the sensor's frame, where flights show
        that the modelled one is wrong; else None."""
        if self._flights is None or not episodes or not self.is_at_home:
            return None
        for track in (track for episode in episodes for track in episode.tracks):
            record = record_of(track, self._settings)
            self._flights.take(record.seen_path.with_shown_noise())
        estimate = self._flights.up()
        if estimate is None:
            return None
        up, deviation = estimate
        if up[2] >= np.cos(np.radians(max(MIN_TURN, 3.0 * deviation))):
            self.stages.confirm_gravity()
            if 3.0 * deviation < MIN_TURN:
                # The modelled direction is confirmed.
                self._flights = None
            return None
        return np.asarray(up @ self.model.rotation)

    def watch(
        self, points: NDArray[np.float32], time: float, objects: Sequence[NDArray[np.int64]]
    ) -> str:
        """Revise the environment where a frame shows that parts of it have come or gone.

        `points` (height, width, 3) m; `time` in s; `objects` (n,) pixels of each object of the
        frame. Returns a sentence on what has changed, empty while nothing has.

        Raises
        ------
        NoEnvironmentError
            When the support has gone: the environment has to be modelled again.
        """
        if self._view is None or not self.is_at_home:
            return ""
        self._view.take(points, time, objects)
        if self._revising is None and self._view.must_be_modelled(time):
            self._revising = self._begin_revision(self._view, time)
        if self._revising is None or not self._revising.done():
            return ""
        revised, self._revising = self._revising, None
        return self._take(*revised.result())

    def _begin_revision(
        self, view: SettledView, time: float
    ) -> Future[tuple[Stages, View, SensorMotion | None]]:
        points, changed = view.settled(time)
        view.take_reference(points, time)
        before = self.stages.before
        if before is not None:
            before = np.where(changed, np.linalg.norm(points, axis=2), before)
        # A generator of its own: the frames meanwhile draw from the other one.
        (rng,) = self._rng.spawn(1)
        follows = self.motion is not None
        job = self.model, points, before, self._space, self._settings, rng, follows
        return begun(self._background, _revised_stages, *job)

    def _take(self, stages: Stages, view: View, motion: SensorMotion | None) -> str:
        """Replace the environment by a revised one; return a sentence on how it differs."""
        old_ids = _ids(self.model.environment)
        self.stages, self.motion = stages, motion
        self._space.take(view)
        self._check = EnvironmentCheck(self.model, self._settings, revised=True)
        new_ids = _ids(self.model.environment)
        changes = [("come", new_ids - old_ids), ("gone", old_ids - new_ids)]
        text = "; ".join(f"{change}: {', '.join(sorted(ids))}" for change, ids in changes if ids)
        return f"the environment has changed; {text or 'parts of it end elsewhere'}"


def modelled_elsewhere(
    frames: Sequence[NDArray[np.float32]],
    known: EnvironmentModel,
    pose: RigidTransform | None,
    settings: PerceptionSettings,
    rng: np.random.Generator,
    background: Executor | None,
    follows_sensor: bool,
) -> ModelledScene | None:
    """Model a known environment from elsewhere, with the same up; None where nothing shows it.

    `frames` (height, width, 3) m each; `known`: as seen from there; others as of `ModelledScene`.
    """
    try:
        model = model_environment(frames, settings, rng, known.rotation[2]).in_frame_of(known)
    except NoEnvironmentError:
        return None
    return ModelledScene(
        model,
        frames,
        settings,
        rng,
        pose=pose,
        measured=True,
        background=background,
        follows_sensor=follows_sensor,
    )


def begun(
    background: Executor | None, job: Callable[..., Result], *arguments: Any
) -> Future[Result]:
    """Begin a job in the background and return its result to come; without one do it at once."""
    if background is not None:
        return background.submit(job, *arguments)
    done: Future[Result] = Future()
    done.set_result(job(*arguments))
    return done


def _is_same(way: RigidTransform | None, other: RigidTransform | None) -> bool:
    if way is None or other is None:
        return way is other
    return np.array_equal(way.translation, other.translation) and np.array_equal(
        way.orientation, other.orientation
    )


def _ids(environment: Environment) -> set[str]:
    planes, boxes = environment.planes, environment.boxes
    return {*(plane.id for plane in planes), *(box.id for box in boxes)}


def _fused(frames: Sequence[NDArray[np.float32]]) -> NDArray[np.float32] | None:
    """Medians (height, width, 3) m of the pixels of organised frames."""
    return fused_frame(frames, frames[0].size).astype(np.float32) if is_organised(frames) else None


def _nearest_ranges(frames: Sequence[NDArray[np.float32]]) -> NDArray[np.float32] | None:
    """Nearest range (height, width) m that each pixel read in organised frames, NaN for none."""
    if not is_organised(frames):
        return None
    squares = [np.einsum("hwi,hwi->hw", frame, frame) for frame in frames]
    return np.asarray(np.sqrt(np.fmin.reduce(squares)), dtype=np.float32)


def _revised_stages(
    model: EnvironmentModel,
    points: NDArray[np.float32],
    before: NDArray[np.float32] | None,
    space: KnownSpace,
    settings: PerceptionSettings,
    rng: np.random.Generator,
    follows_sensor: bool,
) -> tuple[Stages, View, SensorMotion | None]:
    """Stages for an environment of which something has come or gone, the view of it by settled
    `points` (height, width, 3) m, and what follows the sensor by that."""
    revised = revised_environment(model, points, settings, rng)
    revised = with_static_boxes(revised, [points], settings, rng, model.environment.boxes)
    stages = Stages(revised, settings, rng, before, space)
    stages.prepare([points])
    motion = sensor_motion_in(points, [points], revised, settings) if follows_sensor else None
    return stages, space.view([points], revised.sensor_pose), motion


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
    parts = SphereFinder(model, settings, rng).find(frame, clusters)
    spheres = without_doubles([sphere for part in parts for sphere in part.spheres])
    return model.environment, [s.moved(model.rotation, model.translation) for s in spheres]
