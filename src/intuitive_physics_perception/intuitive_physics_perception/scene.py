"""One environment over time: its stages, whether it still is as it was modelled, its revision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from copy import copy
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.scene import Environment
from intuitive_physics_perception.appearance.sphere_image import sphere_image
from intuitive_physics_perception.appearance.surface_spin import SurfaceSpin
from intuitive_physics_perception.appearance.turn_search import SEARCH_STEP, turn_tables
from intuitive_physics_perception.detection.cluster_memory import FIRST_SEARCHES
from intuitive_physics_perception.detection.detections import (
    DetectedSphere,
    Detection,
    without_doubles,
)
from intuitive_physics_perception.detection.foreground import Clusters, ForegroundFinder
from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.detection.solids import ObjectInFrame, SolidFinder, all_objects
from intuitive_physics_perception.detection.spheres import (
    ClusterSpheres,
    RecentFrame,
    RecentFrames,
    SphereFinder,
)
from intuitive_physics_perception.environment.environment_model import (
    MIN_POINTS,
    EnvironmentModel,
    is_organised,
    is_same_view,
    model_environment,
    revised_environment,
)
from intuitive_physics_perception.environment.fusion import fused_frame
from intuitive_physics_perception.environment.gravity import MIN_TURN, FlightGravity
from intuitive_physics_perception.environment.known_space import KnownSpace, View
from intuitive_physics_perception.environment.range_cloud import spacing_of
from intuitive_physics_perception.environment.ray_planes import PlaneAgreement, RayPlanes
from intuitive_physics_perception.environment.settled_view import GONE_TIME, SettledView
from intuitive_physics_perception.environment.static_boxes import StaticBoxFilter, with_static_boxes
from intuitive_physics_perception.sensor_motion.sensor_motion import SensorMotion, sensor_motion_in
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import Episode, EpisodeRecorder, record_of
from intuitive_physics_perception.tracking.motion import PLACED, POSITION, RADIUS
from intuitive_physics_perception.tracking.track import FilterStep, Track
from intuitive_physics_perception.tracking.tracker import ExpectedBefore, Tracker

MIN_VISIBLE = 0.1
"""Part of the readings, relative to the first frames, that nothing may hide: with fewer the planes
cannot be checked."""

COVERED_TIME = 2.0
"""s for which nearly all is hidden until the sensor counts as moved."""

SEARCHES_IN_FRAME = 1
"""Clusters that are searched for spheres at random in one frame, which bounds its time."""

HINDSIGHT = 0.2
"""s for which frames are kept, to search them for a ball before it was first detected: 50 to 80 ms
pass after the release before the ball is apart from the hand all round its outline."""

HINDSIGHT_FRAMES = 2
"""Old frames that are searched in each new one, which bounds its time."""

READING_STEPS = 4
"""Steps from when a ball is read to where it was then, and back: a scan that is four times as fast
as a ball leaves 1/256 of the first error."""

CHECKED_POINTS = 1200
"""Points of each frame, evenly over it, that are compared with the planes: bounds the time."""

FOLLOWED_MARGIN = 0.05
"""Distance from what is followed within which a reading shows no environment, m: the noise and the
flying pixels at its edge."""

LOOKED_AT = 0.01
"""Part of a frame's readings that may lie where nobody has looked before until the frame is
remembered."""

LOOK_EVERY = 0.25
"""Time, s, between two checks for changes: half of the shortest time of a change."""

Result = TypeVar("Result")


class EnvironmentCheck:
    """Compares how much of each frame lies on the modelled planes with how much did at first.

    What moves through the view hides a part of it and says nothing about the planes. What has gone
    shows something else behind it, while the rest of the view is as it was. A sensor that was
    moved, if only by half a degree, sees most planes elsewhere. A sensor that slides along its only
    plane, or turns about that plane's normal, sees no change: this is not noticed.
    """

    def __init__(
        self, model: EnvironmentModel, settings: PerceptionSettings, *, revised: bool = False
    ) -> None:
        self._model = model
        self._settings = settings
        self._planes = RayPlanes(model.detected, model.noise, settings)
        self._revised = revised
        self._since: float | None = None

    def moved(self, points: NDArray[np.float32], time: float) -> str:
        """Say in a sentence that the sensor was moved; empty while it was not.

        `points` (height, width, 3) m in the sensor's frame, NaN where nothing was read; `time` in
        s.
        """
        if not self._model.detected:
            return ""
        now, was = self._agreement(points), self._model.agreement
        least = self._settings.moved_fraction
        covered = now.visible < MIN_VISIBLE * was.visible
        fraction = now.explained / max(was.explained, 1e-9)
        # With the support in its place, the sensor has its height and tilt: other changes came or
        # went, which a revision finds.
        stands = not covered and (
            fraction >= least or (self._revised and now.support >= least * was.support)
        )
        if stands or least == 0.0:
            self._since = None
            return ""
        if self._since is None or time < self._since:
            self._since = time
        lasting = time - self._since
        if lasting < (COVERED_TIME if covered else self._settings.moved_time):
            return ""
        if covered:
            return (
                f"for {lasting:.1f} s something before all planes has hidden them; the sensor was "
                "moved or covered: they are modelled again"
            )
        return (
            f"for {lasting:.1f} s {fraction:.0%} of the readings that should lie on the planes do; "
            "the sensor was moved: they are modelled again"
        )

    def _agreement(self, points: NDArray[np.float32]) -> PlaneAgreement:
        """Agreement of some readings, evenly over a frame, with the planes."""
        height, width = points.shape[:2]
        stride = max(1, int(np.sqrt(height * width / CHECKED_POINTS)))
        chosen = points[::stride, ::stride] if height > 1 else points[:, :: stride * stride]
        agreement = self._planes.agreement(np.ascontiguousarray(chosen).reshape(-1, 3))
        return agreement if agreement.readings >= MIN_POINTS else self._model.agreement


class Stages:
    """Finders of objects in the frames of one environment, with their memories.

    `before` (height, width) m, the nearest range that each pixel read when the environment was
    modelled, NaN for nothing; None where readings have no fixed pixels; `space`: what is known of
    the space about the sensor, for these.
    """

    def __init__(
        self,
        model: EnvironmentModel,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        before: NDArray[np.float32] | None,
        space: KnownSpace | None = None,
    ) -> None:
        self._settings = settings
        self.before = before
        self.spheres = SphereFinder(model, settings, rng)
        self.solids = SolidFinder(model, settings, rng) if settings.find_solids else None
        self._look_from(model, ForegroundFinder(model, settings, before, space))

    def _look_from(self, model: EnvironmentModel, foreground: ForegroundFinder) -> None:
        self.model, self.foreground = model, foreground
        self.static_boxes = StaticBoxFilter(model, self._settings)
        self.spheres.look_from(model)
        if self.solids is not None:
            self.solids.look_from(model)

    def seen_from(self, model: EnvironmentModel, space: KnownSpace) -> Stages:
        """Return them for the same environment as a sensor sees it from elsewhere; they share
        their memories.

        `space`: what is known of the space.
        """
        elsewhere = copy(self)
        foreground = ForegroundFinder(model, self._settings, None, space)
        elsewhere.before = None
        elsewhere._look_from(model, foreground)
        return elsewhere

    def look_again(self) -> None:
        """Look from where the environment was modelled again."""
        self._look_from(self.model, self.foreground)

    def clusters(self, points: NDArray[np.float32]) -> Clusters:
        """Return clusters of what is neither a plane nor a static box.

        `points` (height, width, 3) m, of a frame.
        """
        return self.static_boxes.without(points, self.foreground.find(points))

    def prepare(self, points: NDArray[np.float32]) -> None:
        """Find where each pixel's ray meets a plane and search the first clusters: later frames
        need not wait for it.

        `points` (height, width, 3) m, of a frame.
        """
        for _ in range(FIRST_SEARCHES):
            spheres = self.spheres.find(points, self.clusters(points))
            all_objects(points, spheres, self.solids)


class ModelledScene:
    """One environment as it changes, and what moves in it.

    `model`: of its planes, to which what else stands there is added; `frames` (height, width, 3) m
    each, that it was modelled from; `measured`: whether gravity was measured, so that flights are
    not needed; `background`: in which the environment is revised while frames go on; None revises
    it at once; `follows_sensor`: find the sensor by what it sees, as nobody gives its pose.
    """

    def __init__(
        self,
        model: EnvironmentModel,
        frames: Sequence[NDArray[np.float32]],
        settings: PerceptionSettings,
        rng: np.random.Generator,
        first_track: int,
        *,
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
        self._recent = RecentFrames(HINDSIGHT)
        # Of each track's number, down to which frame, s, this sensor's were searched for it.
        self._searched_until: dict[int, float] = {}
        self._flights: FlightGravity | None = None
        if settings.gravity_from_flights and settings.gravity_source == "plane" and not measured:
            self._flights = FlightGravity(settings.gravity)
        self._pending: Future[tuple[Stages, View, SensorMotion | None] | None] | None = None
        self._changed_since: float | None = None
        self._space = KnownSpace(model.noise, spacing_of(frames[-1], rng))
        self._space.take(self._space.view(frames, model.sensor_pose))
        self._looking: Future[View] | None = None
        self._way = RigidTransform()
        before = _nearest_ranges(frames)
        self.stages = self._home = Stages(
            model, settings, rng, before, self._space if before is None else None
        )
        self.stages.prepare(frames[-1])
        if settings.spin_from_surface:
            # The first ball that flies cannot wait for them.
            turn_tables(SEARCH_STEP)
        self.check = EnvironmentCheck(model, settings, revised=self._view is not None)
        self.restart_tracking(first_track)

    @property
    def model(self) -> EnvironmentModel:
        """The environment as it is known now."""
        return self.stages.model

    @property
    def is_at_home(self) -> bool:
        """Whether the sensor stands where it stood when the environment was modelled."""
        return self.stages is self._home

    def look_from(self, way: RigidTransform) -> None:
        """Take the pose of the sensor; what each pixel read before counts at home only.

        `way`: from the sensor's frame now to its frame when the environment was modelled.
        """
        if is_same_view(way, self._home.model.noise):
            if not self.is_at_home:
                self.stages = self._home
                self.stages.look_again()
            return
        if self.is_at_home:
            self._recent.forget()
            self._changed_since = None
            if self._view is not None:
                self._view.restart()
        elif np.array_equal(way.translation, self._way.translation) and np.array_equal(
            way.orientation, self._way.orientation
        ):
            return
        self._way = way
        self.stages = self._home.seen_from(self._home.model.seen_from(way), self._space)

    def look_about(self, points: NDArray[np.float32], clusters: Clusters) -> None:
        """Remember what a frame shows where nobody has looked before.

        `points` (height, width, 3) m.
        """
        is_unknown = clusters.unknown > LOOKED_AT * clusters.readings
        if self._looking is None and self.stages.before is None and is_unknown:
            job = [self.without_followed(points)], self.model.sensor_pose
            self._looking = begun(self._background, self._space.view, *job)
        if self._looking is not None and self._looking.done():
            self._space.fill(self._looking.result())
            self._looking = None

    def find_spheres(
        self, points: NDArray[np.float32], clusters: Clusters, time: float, budget: FrameBudget
    ) -> list[ClusterSpheres]:
        """Return the spheres of a frame by cluster; those of tracks are searched first, where they
        are expected.

        `points` (height, width, 3) m; `time` in s; `budget`: of the frame.
        """
        expected = [start.seen_from(self.model) for start in self.tracker.expected_spheres(time)]
        return self.stages.spheres.find(points, clusters, SEARCHES_IN_FRAME, expected, budget)

    def look_at_surfaces(
        self,
        objects: Sequence[tuple[ObjectInFrame, Detection]],
        points: NDArray[np.float32],
        colors: NDArray[np.uint8] | None,
        time: float,
    ) -> None:
        """Measure in a frame how balls in free flight turn.

        `objects`: of the frame, and the detections that the tracker took for them; `points`
        (height, width, 3) m and `colors` (height, width, 3); `time` in s.
        """
        if colors is None or points.shape[0] == 1 or not self._settings.spin_from_surface:
            return
        by_detection = {id(detection): item for item, detection in objects}
        rotation = self.model.rotation
        for track in self.tracker.followed:
            # Another sensor may have seen it later than this frame.
            steps = [step for step in track.since(time) if id(step.detection) in by_detection]
            if not steps:
                continue
            step, item = steps[-1], by_detection[id(steps[-1].detection)]
            if not isinstance(item.detection, DetectedSphere):
                continue
            if not self.tracker.flies(track, step):
                track.surface = None
                continue
            sphere = self._followed_sphere(track, step, item.detection)
            image = sphere_image(sphere, item.pixels(points), points, colors)
            if image is not None:
                track.surface = track.surface or SurfaceSpin()
                track.surface.take(step.time, image.moved(rotation))

    def _followed_sphere(
        self, track: Track, step: FilterStep, detected: DetectedSphere
    ) -> DetectedSphere:
        """A sphere as detected at a step, in the sensor's frame, averaged over all frames up to
        it."""
        averaged = replace(
            detected,
            center=step.mean[POSITION],
            radius=float(step.mean[RADIUS]),
            covariance=step.covariance[np.ix_(PLACED, PLACED)] + track.systematic,
        )
        return averaged.moved(self.model.rotation.T, self.model.to_sensor(np.zeros(3)))

    def look_back(self, frame: RecentFrame, budget: FrameBudget) -> None:
        """Search the newest frames for each ball where it was not seen, a few in each new frame,
        and one where its budget is spent.

        Beside the hand that releases it a ball is not yet an object of its own, but it is found
        where it must have been.

        `frame`: the newest one, in which has been tracked.
        """
        if self.is_at_home:
            self._recent.keep(frame)
        for track in self.tracker.tracks:
            for _ in range(1 if budget.is_spent else HINDSIGHT_FRAMES):
                if track.earlier is not None and not self._searches_backwards(track):
                    self.tracker.take_earlier(track)
        searched = {track.number for track in self.tracker.tracks if track.earlier is not None}
        self._searched_until = {
            number: until for number, until in self._searched_until.items() if number in searched
        }

    def _searches_backwards(self, track: Track) -> bool:
        """Search the newest frame before those that were searched for a track; False where there
        is none in which it can be expected."""
        searched_until = self._searched_until.get(track.number, np.inf)
        frame = self._recent.before(searched_until, track.number)
        if frame is None or track.earlier is None:
            return False
        time, expected = self._expected_in(frame, track)
        if expected is None and time < track.detections[0][0]:
            return False
        self._searched_until[track.number] = frame.time
        if expected is None:
            return True
        start = expected.start.seen_from(self.model)
        detected = self.stages.spheres.find_expected(frame.points, frame.clusters, start)
        if detected is not None:
            time = frame.time_of(detected)
            placed = detected.moved(self.model.rotation, self.model.translation)
            detection = replace(placed, delay=time - frame.time)
            if self.tracker.is_same(track, detection, expected):
                track.earlier.append((time, detection))
        return True

    def _expected_in(self, frame: RecentFrame, track: Track) -> tuple[float, ExpectedBefore | None]:
        """When, s, a frame must have shown a track, and where it was expected then.

        A sensor reads each place at a time of its own, which need not be that at which another one
        reads it.
        """
        later = [seen.center for when, seen in track.detections if when > frame.time]
        place = later[0] if later else track.mean[POSITION]
        time, expected = frame.time_towards(self.model.to_sensor(place)), None
        for _ in range(READING_STEPS if frame.offsets is not None else 1):
            expected = self.tracker.expected_before(track, time)
            if expected is None:
                break
            time = frame.time_towards(self.model.to_sensor(expected.start.sphere[:3]))
        return time, expected

    def restart_tracking(self, first_track: int) -> None:
        """Forget all tracks, the last frames, and since when readings have stayed; the environment
        remains."""
        self.tracker = Tracker(self.model.environment, self._settings, first_track)
        self.episodes = EpisodeRecorder(self.model.environment, self._settings)
        self._next_look, self._changed_since = -np.inf, None
        self._recent.forget()
        self._searched_until.clear()
        if self._view is not None:
            self._view.restart()
        if self.motion is not None:
            self.motion.restart()

    def without_followed(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a frame with NaN about what is followed: it shows no part of the environment.

        `points` (height, width, 3) m, of the frame. Returns the same (height, width, 3).
        """
        cleared = points.copy()
        for track in self.tracker.tracks:
            centre = self.model.to_sensor(track.mean[POSITION])
            shape = track.scene_object(self._settings).shape
            reach = shape.bounding_radius + FOLLOWED_MARGIN
            cleared[np.linalg.norm(points - centre, axis=2) < reach] = np.nan
        return cleared

    def share_tracking(self, other: ModelledScene) -> None:
        """Follow what another scene of the same environment, in the same frame, follows."""
        self.tracker, self.episodes = other.tracker, other.episodes

    def track_in_environment(self) -> None:
        """Let tracking go on in the environment as it is known now."""
        self.tracker.take_environment(self.model.environment)
        self.episodes.take_environment(self.model.environment)

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
            self.stages.model = replace(self.model, gravity_doubt="")
            if 3.0 * deviation < MIN_TURN:
                # The modelled direction is confirmed.
                self._flights = None
            return None
        return np.asarray(up @ self.model.rotation)

    def watch(
        self, points: NDArray[np.float32], time: float, objects: Sequence[NDArray[np.int64]]
    ) -> str | None:
        """Revise the environment where a frame shows that parts of it have come or gone.

        `points` (height, width, 3) m; `time` in s; `objects` (n,) pixels of each object of the
        frame. Returns a sentence on what has changed, empty while nothing has; None where the
        support has gone, and the environment has to be modelled again.
        """
        if self._view is None or not self.is_at_home:
            return ""
        self._view.take(points, time, objects)
        if self._pending is None and time >= self._next_look:
            self._look(self._view, time)
        if self._pending is None or not self._pending.done():
            return ""
        revised, self._pending = self._pending.result(), None
        self._next_look = time + GONE_TIME
        return None if revised is None else self._take(*revised)

    def _look(self, view: SettledView, time: float) -> None:
        """Begin a revision when something has changed and its parts have had time to settle."""
        self._next_look = time + LOOK_EVERY
        if not view.has_changed(time):
            self._changed_since = None
        elif self._changed_since is None:
            self._changed_since = time
        elif time - self._changed_since >= GONE_TIME:
            self._changed_since = None
            self._begin_revision(view, time)

    def _begin_revision(self, view: SettledView, time: float) -> None:
        points, changed = view.settled(time)
        view.take_reference(points)
        before = self.stages.before
        if before is not None:
            before = np.where(changed, np.linalg.norm(points, axis=2), before)
        # A generator of its own: the frames meanwhile draw from the other one.
        (rng,) = self._rng.spawn(1)
        follows = self.motion is not None
        job = self.model, points, before, self._space, self._settings, rng, follows
        self._pending = begun(self._background, _revised_stages, *job)

    def _take(self, stages: Stages, view: View, motion: SensorMotion | None) -> str:
        """Replace the environment by a revised one; return a sentence on how it differs."""
        old_ids = _ids(self.model.environment)
        self.stages = self._home = stages
        self.motion = motion
        self._space.take(view)
        self.check = EnvironmentCheck(self.model, self._settings, revised=True)
        self.track_in_environment()
        new_ids = _ids(self.model.environment)
        changes = [("come", new_ids - old_ids), ("gone", old_ids - new_ids)]
        text = "; ".join(f"{change}: {', '.join(sorted(ids))}" for change, ids in changes if ids)
        return f"the environment has changed; {text or 'parts of it end elsewhere'}"


def begun(
    background: Executor | None, job: Callable[..., Result], *arguments: Any
) -> Future[Result]:
    """Begin a job in the background and return its result to come; without one do it at once."""
    if background is not None:
        return background.submit(job, *arguments)
    done: Future[Result] = Future()
    done.set_result(job(*arguments))
    return done


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
) -> tuple[Stages, View, SensorMotion | None] | None:
    """Stages for an environment of which something has come or gone, the view of it, and what
    follows the sensor by that; None where its support has.

    `points` (height, width, 3) m, settled readings; `before` (height, width) m, as in `Stages`.
    """
    revised = revised_environment(model, points, settings, rng)
    if revised is None:
        return None
    revised = with_static_boxes(revised, [points], settings, rng, model.environment.boxes)
    stages = Stages(revised, settings, rng, before)
    stages.prepare(points)
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
