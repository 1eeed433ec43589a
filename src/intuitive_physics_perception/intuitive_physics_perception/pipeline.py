"""Frames in; environment, object states and finished observations out (Sec. VI-B and VI-C)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.observation import Observation
from intuitive_physics.validation import unit_vector
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.detection.solids import all_objects
from intuitive_physics_perception.detection.spheres import RecentFrame
from intuitive_physics_perception.environment.environment_model import (
    EnvironmentModel,
    NoEnvironmentError,
    is_same_view,
    model_environment,
)
from intuitive_physics_perception.environment.gravity import degrees_between
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.frame_result import (
    FrameDiagnostics,
    FrameResult,
    PerceivedObject,
    StageTimer,
)
from intuitive_physics_perception.further_camera import FurtherCamera
from intuitive_physics_perception.input.frame_order import Timeline
from intuitive_physics_perception.input.reading_times import reading_span
from intuitive_physics_perception.scene import COVERED_TIME, ModelledScene, begun
from intuitive_physics_perception.sensor_motion.sensor_motion import SensorMotion
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import (
    Episode,
    detection_at,
    observations_from,
)
from intuitive_physics_perception.tracking.track import Track

STANDING_TIME = 1.0
"""Time for which a sensor stays where it is, as far as noise shows, until it stands, s: one that
drives at 5 cm/s has gone too far for that by then, and a frame is too short to tell."""


@dataclass(frozen=True, eq=False)
class ModelledElsewhere:
    """An environment that is being modelled from where a sensor stands that has moved.

    Parameters
    ----------
    pose : of the sensor there
    scene : what comes of it; None where nothing shows an environment from there
    """

    pose: RigidTransform
    scene: Future[ModelledScene | None]


class PerceptionPipeline:
    """Perceives frame after frame of one sensor, which stands still or moves slowly, or whose pose
    is given; and of further cameras of the same scene, whose poses are given.

    The environment stays in the frame in which it was modelled first, wherever the sensor looks
    from. When a sensor that has moved stands still, and nothing that is followed moves, the
    environment is modelled again from there, in the same frame; what is followed goes on.

    What any camera sees is one track. The environment is that of the first camera, by which flights
    tell gravity and what is painted on a ball its spin.

    Parameters
    ----------
    settings : of all stages
    rng : source of all random choices
    clock : seconds, by which stages are timed
    background : in which the environment is revised, and modelled again from elsewhere, while
        frames go on, as a live camera needs, and hypotheses have a budget of time; None does all
        within a frame, so that results depend on the frames alone
    """

    def __init__(
        self,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        clock: Callable[[], float] = perf_counter,
        background: Executor | None = None,
    ) -> None:
        self.settings = settings
        self._rng = rng
        self._clock = clock
        self._background = background
        self._budget = FrameBudget()
        if background is not None:
            self._budget = FrameBudget(1e-3 * settings.hypothesis_budget, clock)
        self._next_track = 1
        self._timeline = Timeline()
        self._further: dict[str, FurtherCamera] = {}
        self._first_frames: list[NDArray[np.float32]] = []
        self._first_pose: RigidTransform | None = None
        self._moved_since_first = False
        self._standing: list[NDArray[np.float32]] = []
        self._stands_since: tuple[float, RigidTransform] | None = None
        self._modelling: ModelledElsewhere | None = None
        self._pose: RigidTransform | None = None
        self._modelled_at: RigidTransform | None = None
        self._scene: ModelledScene | None = None
        self._up: NDArray[np.float64] | None = None
        self._up_seen_from: RigidTransform | None = None

    @property
    def model(self) -> EnvironmentModel | None:
        """The environment as it is known now; None while it is not."""
        return self._scene.model if self._scene else None

    @property
    def sensor_motion(self) -> SensorMotion | None:
        """What follows the first sensor by what it sees; None where its pose is given, or it cannot
        be followed."""
        return self._scene.motion if self._scene else None

    def take_up(self, up: ArrayLike) -> None:
        """Take the measured direction against gravity, `up` (3,) in the sensor's frame, of any
        length.

        With `gravity_source` "imu" the environment is modelled once it is known.
        """
        self._up, self._up_seen_from = unit_vector(up, "up"), self._pose

    def rebuild_environment(self) -> tuple[Observation, ...]:
        """Forget the environment, which the next frames model again; return what was under way."""
        return observations_from(self._forget_environment())

    def process(
        self,
        points: NDArray[np.float32],
        time: float,
        colors: NDArray[np.uint8] | None = None,
        pose: RigidTransform | None = None,
        camera: str = "",
        offsets: NDArray[np.float32] | None = None,
    ) -> FrameResult:
        """Perceive one frame.

        Parameters
        ----------
        points : (height, width, 3) float32 m in the sensor's frame, NaN where nothing was read
        time : s. An earlier time than that of the camera's last frame restarts tracking, as does a
            frame that ends before others began
        colors : (height, width, 3) red, green and blue of the points, where they are known
        pose : of the sensor at this time, in a frame that stands still; None: the sensor does
        camera : name of a further camera, empty for the first; their frames come in the order of
            their times, and all poses are in one frame
        offsets : (height, width) s, time of each reading after `time`, or before it where it is
            negative, where they differ; objects are followed at the times of their own readings
        """
        stamp, (first, last) = time, reading_span(points, offsets)
        if offsets is not None:
            time, offsets = stamp + first, offsets - np.float32(first)
        if colors is not None and colors.shape != points.shape:
            raise InvalidInputError(
                f"colours are {colors.shape} and points {points.shape}; expected the same shape"
            )
        if not np.isfinite(time):
            raise InvalidInputError(f"time of the frame is {time}; expected a finite number")
        if self._timeline.has(camera, stamp):
            return self._unused(time, "two frames have the same time; expected increasing times")
        self._budget.begin_frame()
        restarted = self._timeline.goes_back(camera, stamp, first, last)
        episodes = self._restarted() if restarted else ()
        if not np.isfinite(points[..., 2]).any():
            problem = "the frame has no reading at all; expected points: is the sensor covered?"
            result = self._unused(time, problem)
        elif camera:
            result = self._see_further(camera, points, time, colors, pose, offsets)
        elif (scene := self._scene) is None:
            self._take_first(points, pose)
            result = self._model(time, self._up_from_here())
        else:
            self._pose = pose
            result = self._see(scene, points, time, colors, pose, offsets)
        self._budget.end_frame()
        return replace(
            result,
            episodes=(*episodes, *result.episodes),
            restarted=restarted,
        )

    def finish(self) -> tuple[Observation, ...]:
        """Return the observations of what still moves, as at the end of a recording."""
        return observations_from(self._restarted())

    def further_doubt(self, camera: str) -> str:
        """Return a sentence on why the pose of a further camera may be wrong, empty where nothing
        shows that."""
        return self._further[camera].doubt if camera in self._further else ""

    def _see(
        self,
        scene: ModelledScene,
        points: NDArray[np.float32],
        time: float,
        colors: NDArray[np.uint8] | None,
        pose: RigidTransform | None,
        offsets: NDArray[np.float32] | None,
    ) -> FrameResult:
        """Perceive a frame of the first camera from its pose; where none was given when the
        environment was modelled, from that by which it sees the environment."""
        if scene.motion is not None:
            scene.motion.follow(points, time)
            if scene.motion.doubt and not scene.is_at_home:
                return self._lost(scene.motion, time)
            pose = self._modelled_at.after(scene.motion.way) if self._modelled_at else None
        if pose is not None and self._modelled_at is not None:
            scene.look_from(self._modelled_at.inverse.after(pose))
        result = self._perceive(scene, points, time, colors, scene, offsets=offsets)
        if pose is not None and self._scene is scene:
            self._model_where_it_stands(scene, points, time, pose)
            result = self._with_new_model(scene, result, pose)
        return result

    def _lost(self, motion: SensorMotion, time: float) -> FrameResult:
        """Return the result of a frame of a sensor that has moved and is not found any more; model
        the environment again where that lasts."""
        lasting = motion.lost_for(time)
        reason = f"for {lasting:.1f} s it is not known how the sensor has moved: {motion.doubt}"
        if lasting < (COVERED_TIME if motion.is_covered else self.settings.moved_time):
            return self._unused(time, reason)
        reason += "; the environment is modelled again"
        return self._model_again(time, reason, self._forget_environment())

    def _see_further(
        self,
        camera: str,
        points: NDArray[np.float32],
        time: float,
        colors: NDArray[np.uint8] | None,
        pose: RigidTransform | None,
        offsets: NDArray[np.float32] | None,
    ) -> FrameResult:
        """Perceive a frame of a further camera in the environment of the first."""
        if self._scene is None:
            return self._unused(time, "the first camera has not shown the environment yet")
        if pose is None or self._pose is None:
            problem = "a camera has no pose; expected that of each in one frame that stands still"
            return self._unused(time, problem)
        further = self._further.setdefault(
            camera, FurtherCamera(self.settings, self._rng, self._background)
        )
        seen = self._scene.model.seen_from(self._pose.inverse.after(pose))
        eye = further.look(points, pose, seen)
        if eye is None:
            return FrameResult(time, self.model)
        eye.share_tracking(self._scene)
        return self._perceive(self._scene, points, time, colors, eye, camera, offsets)

    def _model(self, time: float, up: NDArray[np.float64] | None) -> FrameResult:
        """Model the environment once there are frames enough, with up (3,) where it is known."""
        if self.settings.gravity_source == "imu" and up is None:
            self._first_frames.clear()
            return self._unused(time, "up is not known yet; expected an IMU that has rested")
        if len(self._first_frames) < self.settings.environment_frames:
            return FrameResult(time, None)
        frames, self._first_frames = self._first_frames, []
        # Of a sensor that moves the newest frame alone is from where it is now.
        if self._moved_since_first:
            frames = frames[-1:]
        timer = StageTimer(self._clock)
        with timer.stage("environment"):
            try:
                model = model_environment(frames, self.settings, self._rng, up)
            except NoEnvironmentError as error:
                return self._unused(time, str(error))
            self._scene = ModelledScene(
                model,
                frames,
                self.settings,
                self._rng,
                self._next_track,
                measured=up is not None,
                background=self._background,
                follows_sensor=self._pose is None,
            )
            self._modelled_at = RigidTransform() if self._scene.motion else self._pose
        return FrameResult(
            time, self.model, is_new_model=True, diagnostics=FrameDiagnostics(seconds=timer.seconds)
        )

    def _take_first(self, points: NDArray[np.float32], pose: RigidTransform | None) -> None:
        """Collect a frame to model the environment from; whether the sensor moves is seen."""
        if not self._first_frames:
            self._first_pose, self._moved_since_first = pose, False
        elif pose is not None and self._first_pose is not None:
            self._moved_since_first |= not self._noise_hides(self._first_pose.inverse.after(pose))
        self._first_frames.append(points)
        self._pose = pose

    def _up_from_here(self) -> NDArray[np.float64] | None:
        """Up (3,) in the sensor's frame now, where it is known."""
        if self._up is None or self._pose is None or self._up_seen_from is None:
            return self._up
        return self._pose.inverse.after(self._up_seen_from).directions(self._up)

    def _noise_hides(self, way: RigidTransform) -> bool:
        return is_same_view(way, RangeNoise.from_settings(self.settings))

    def _model_where_it_stands(
        self, scene: ModelledScene, points: NDArray[np.float32], time: float, pose: RigidTransform
    ) -> None:
        """Begin to model the environment again where a sensor that has moved stands, if nothing
        moves."""
        if scene.is_at_home:
            self._stands_since = None
            return
        since = self._stands_since
        if since is None or not self._noise_hides(since[1].inverse.after(pose)):
            self._stands_since, self._standing = (time, pose), []
            since = self._stands_since
        self._standing.append(points)
        del self._standing[: -self.settings.environment_frames]
        enough = len(self._standing) == self.settings.environment_frames
        if not enough or time - since[0] < STANDING_TIME or self._modelling is not None:
            return
        if all(track.resting for track in scene.tracker.tracks):
            # A generator of its own: the frames meanwhile draw from the other one.
            (rng,) = self._rng.spawn(1)
            frames = [scene.without_followed(points) for points in self._standing]
            follows = scene.motion is not None
            job = frames, self.settings, rng, scene.model, self._background, follows
            modelled = begun(self._background, _modelled_elsewhere, *job)
            self._modelling = ModelledElsewhere(pose, modelled)
            self._stands_since = None

    def _with_new_model(
        self, scene: ModelledScene, result: FrameResult, pose: RigidTransform
    ) -> FrameResult:
        """Take a new model once it is there, if the sensor has not left the place."""
        modelling = self._modelling
        if modelling is None or not modelling.scene.done():
            return result
        self._modelling, modelled = None, modelling.scene.result()
        if modelled is None or not self._noise_hides(modelling.pose.inverse.after(pose)):
            return result
        modelled.share_tracking(scene)
        modelled.track_in_environment()
        self._scene, self._modelled_at = modelled, modelling.pose
        return replace(result, model=modelled.model, is_new_model=True)

    def _perceive(
        self,
        scene: ModelledScene,
        points: NDArray[np.float32],
        time: float,
        colors: NDArray[np.uint8] | None,
        eye: ModelledScene,
        camera: str = "",
        offsets: NDArray[np.float32] | None = None,
    ) -> FrameResult:
        """Remove the planes, detect objects, track them, end episodes, revise the environment.

        `eye`: the scene as the camera of the frame sees it, which of the first is `scene` itself.
        """
        timer = StageTimer(self._clock)
        with timer.stage("planes"):
            moved = eye.check.moved(points, time) if eye.is_at_home else ""
            if moved and eye.motion is not None and eye.motion.doubt:
                moved += f" (how it has moved is not known: {eye.motion.doubt})"
            if moved:
                return self._model_again(time, moved, self._forget_view(camera))
            clusters = eye.stages.clusters(points)
            eye.look_about(points, clusters)
        budget = self._budget
        budget.begin()
        with timer.stage("spheres"):
            spheres = eye.find_spheres(points, clusters, time, budget)
        with timer.stage("solids"):
            objects_seen = all_objects(points, spheres, eye.stages.solids, colors, budget)
            pixels = [item.pixels(points) for item in objects_seen]
        budget.end()
        with timer.stage("tracking"):
            pose = eye.model.rotation, eye.model.translation
            detections = [item.detection.moved(*pose) for item in objects_seen]
            if offsets is not None:
                detections = [
                    replace(detection, delay=float(offsets.reshape(-1)[seen].mean()))
                    for detection, seen in zip(detections, pixels, strict=True)
                ]
            others = max(sum(clusters.new) - len(detections), 0)
            ended = scene.tracker.update(time, detections, camera, others)
            shown = scene.tracker.objects_among(detections)
            pixels = [pixels[k] for k in shown]
            eye.stages.foreground.expect_objects(pixels)
            if not camera:
                scene.look_at_surfaces(
                    list(zip(objects_seen, detections, strict=True)), points, colors, time
                )
            frame = RecentFrame(time, points, clusters, offsets, scene.tracker.shown)
            eye.look_back(frame, budget)
            objects = tuple(self._perceived(track, scene) for track in scene.tracker.tracks)
        with timer.stage("episodes"):
            now = max(time, self._timeline.newest_begin)
            episodes = scene.episodes.update(now, scene.tracker.tracks, ended)
            up = scene.up_of_flights(episodes)
            if up is not None:
                return self._turn_gravity(scene, up, time)
        with timer.stage("revision"):
            revised = eye.watch(points, time, pixels)
            if revised is None:
                reason = "the support has gone: the environment is modelled again"
                return self._model_again(time, reason, (*episodes, *self._forget_view(camera)))
            if camera and revised:
                # Only what it sees was revised.
                scene.track_in_environment()
                revised = ""
        latest = time + max((detection.delay for detection in detections), default=0.0)
        return FrameResult(
            scene.tracker.newest(latest),
            scene.model,
            is_new_model=bool(revised),
            revised=revised,
            detections=tuple(detections[k] for k in shown),
            objects=objects,
            episodes=episodes,
            diagnostics=FrameDiagnostics(
                waiting=budget.waiting,
                spheres=sum(isinstance(detections[k], DetectedSphere) for k in shown),
                seconds=timer.seconds,
            ),
        )

    def _perceived(self, track: Track, scene: ModelledScene) -> PerceivedObject:
        return PerceivedObject(
            track.scene_object(self.settings),
            track.object_state(scene.model.environment, self.settings),
            track.color,
            detection_at(track, scene.tracker.seen_at(track)),
        )

    def _turn_gravity(
        self, scene: ModelledScene, up: NDArray[np.float64], time: float
    ) -> FrameResult:
        """Model the environment again with the gravity that flights show.

        Episodes under the other gravity are dropped: they would mislead the learner.
        """
        angle = degrees_between(scene.model.rotation[2], up)
        self._up, self._up_seen_from = up, self._pose
        self._forget_environment()
        reason = (
            f"flights show that gravity points {angle:.0f}° beside what the support showed: the "
            "environment is modelled again"
        )
        return self._model_again(time, reason, ())

    def _model_again(self, time: float, reason: str, episodes: tuple[Episode, ...]) -> FrameResult:
        """Return the result of a frame after which the environment is modelled again."""
        return replace(self._unused(time, reason), episodes=episodes, moved=reason)

    def _forget_environment(self) -> tuple[Episode, ...]:
        """Let the next frames model the environment; return what was under way."""
        episodes = self._restarted()
        self._first_frames, self._scene, self._modelling = [], None, None
        self._further.clear()
        return episodes

    def _forget_view(self, camera: str) -> tuple[Episode, ...]:
        """Let the next frames of a camera show its view again; return what was under way."""
        if not camera:
            return self._forget_environment()
        self._further[camera].forget()
        return ()

    def _restarted(self) -> tuple[Episode, ...]:
        """Restart tracking in the same environment; return what was under way."""
        if self._scene is None:
            return ()
        episodes = self._scene.episodes.finish(self._scene.tracker.tracks)
        self._next_track = self._scene.tracker.next_number
        self._scene.restart_tracking(self._next_track)
        for further in self._further.values():
            further.restart()
        return episodes

    def _unused(self, time: float, problem: str) -> FrameResult:
        return FrameResult(time, self.model, diagnostics=FrameDiagnostics(problem=problem))


def _modelled_elsewhere(
    frames: Sequence[NDArray[np.float32]],
    settings: PerceptionSettings,
    rng: np.random.Generator,
    known: EnvironmentModel,
    background: Executor | None,
    follows_sensor: bool,
) -> ModelledScene | None:
    """Model a known environment from elsewhere, with the same up; None where nothing shows it.

    `frames` (height, width, 3) m; `known`: as seen from there.
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
        1,
        measured=True,
        background=background,
        follows_sensor=follows_sensor,
    )
