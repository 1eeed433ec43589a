"""Frames in; environment, object states and finished observations out (Sec. VI-B and VI-C)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment
from intuitive_physics.validation import unit_vector
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.detection.solids import all_objects
from intuitive_physics_perception.environment.environment_model import (
    EnvironmentModel,
    NoEnvironmentError,
    model_environment,
)
from intuitive_physics_perception.environment.gravity import degrees_between
from intuitive_physics_perception.environment.standing import FramesFromOnePlace
from intuitive_physics_perception.frame import Frame
from intuitive_physics_perception.frame_result import (
    FrameDiagnostics,
    FrameResult,
    PerceivedObject,
    StageTimer,
)
from intuitive_physics_perception.further_camera import FurtherCamera
from intuitive_physics_perception.hindsight import RecentFrame
from intuitive_physics_perception.input.frame_order import Timeline
from intuitive_physics_perception.input.reading_times import reading_span
from intuitive_physics_perception.scene import ModelledScene, begun, modelled_elsewhere
from intuitive_physics_perception.sensor_motion.sensor_motion import SensorMotion
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import (
    Episode,
    detection_at,
    observations_from,
)
from intuitive_physics_perception.tracking.followed_objects import FollowedObjects
from intuitive_physics_perception.tracking.track import Track


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
        self._timeline = Timeline()
        self._further: dict[str, FurtherCamera] = {}
        self._newest = FramesFromOnePlace(settings)
        self._pose: RigidTransform | None = None
        # Up (3,) in the sensor's frame, and the sensor's pose when it was measured.
        self._up: tuple[NDArray[np.float64], RigidTransform | None] | None = None
        self._scene: ModelledScene | None = None
        self._followed = FollowedObjects(Environment(), settings, 1)
        self._modelling: Future[ModelledScene | None] | None = None

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
        self._up = unit_vector(up, "up"), self._pose

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
        frame = Frame(time, points, colors, pose, camera, offsets, last - first)
        if not _has_reading(points):
            problem = "the frame has no reading at all; expected points: is the sensor covered?"
            result = self._unused(time, problem)
        elif camera:
            result = self._see_further(frame)
        elif self._scene is None:
            result = self._see_first(frame)
        else:
            result = self._see(self._scene, frame)
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

    def _see_first(self, frame: Frame) -> FrameResult:
        """Collect a frame, and model the environment once there are enough."""
        self._pose = frame.pose
        self._newest.take(frame.points, frame.time, frame.pose)
        up = self._up_from_here()
        if self.settings.gravity_source == "imu" and up is None:
            self._newest.forget()
            problem = "up is not known yet; expected an IMU that has rested"
            return self._unused(frame.time, problem)
        if not self._newest.are_enough:
            return FrameResult(frame.time, None)
        frames = self._newest.frames
        self._newest.forget()
        timer = StageTimer(self._clock)
        with timer.stage("environment"):
            try:
                model = model_environment(frames, self.settings, self._rng, up)
            except NoEnvironmentError as error:
                return self._unused(frame.time, str(error))
            self._scene = ModelledScene(
                model,
                frames,
                self.settings,
                self._rng,
                pose=frame.pose,
                measured=up is not None,
                background=self._background,
                follows_sensor=frame.pose is None,
            )
            self._followed.take_environment(self._scene.model.environment)
        diagnostics = FrameDiagnostics(seconds=timer.seconds)
        return FrameResult(frame.time, self.model, is_new_model=True, diagnostics=diagnostics)

    def _up_from_here(self) -> NDArray[np.float64] | None:
        """Up (3,) in the sensor's frame now, where it is known."""
        if self._up is None:
            return None
        up, seen_from = self._up
        if self._pose is None or seen_from is None:
            return up
        return self._pose.inverse.after(seen_from).directions(up)

    def _see(self, scene: ModelledScene, frame: Frame) -> FrameResult:
        """Perceive a frame of the first camera, from its pose or, where nobody gives that, from
        where it is by what it sees; model the environment again where a camera that has moved
        stands."""
        self._pose = frame.pose
        if scene.motion is not None:
            scene.motion.follow(frame.points, frame.time)
            if scene.motion.doubt and not scene.is_at_home:
                return self._lost(scene.motion, frame.time)
            frame = replace(frame, pose=scene.seen_pose)
        scene.look_from(frame.pose)
        result = self._perceive(scene, scene, frame)
        if frame.pose is None or self._scene is not scene:
            return result
        self._model_where_it_stands(scene, frame)
        return self._with_new_model(result, frame.pose)

    def _lost(self, motion: SensorMotion, time: float) -> FrameResult:
        """The result where a moved sensor is not found; where that lasts all is modelled again."""
        lasting = motion.lost_for(time)
        reason = f"for {lasting:.1f} s it is not known how the sensor has moved: {motion.doubt}"
        if not motion.is_lost(time):
            return self._unused(time, reason)
        reason += "; the environment is modelled again"
        return self._model_again(time, reason, self._forget_environment())

    def _see_further(self, frame: Frame) -> FrameResult:
        """Perceive a frame of a further camera in the environment of the first."""
        if self._scene is None:
            return self._unused(frame.time, "the first camera has not shown the environment yet")
        if frame.pose is None or self._pose is None:
            problem = "a camera has no pose; expected that of each in one frame that stands still"
            return self._unused(frame.time, problem)
        further = self._further.setdefault(
            frame.camera, FurtherCamera(self.settings, self._rng, self._background)
        )
        seen = self._scene.model.seen_from(self._pose.inverse.after(frame.pose))
        eye = further.look(frame, seen)
        if eye is None:
            return FrameResult(frame.time, self.model)
        return self._perceive(self._scene, eye, frame)

    def _model_where_it_stands(self, scene: ModelledScene, frame: Frame) -> None:
        """Begin to model the environment where a moved sensor stands, if no object moves."""
        if scene.is_at_home:
            self._newest.forget()
            return
        self._newest.take(frame.points, frame.time, frame.pose)
        if not self._newest.stands(frame.time) or self._modelling is not None:
            return
        if all(track.resting for track in self._followed.tracker.tracks):
            # A generator of its own: the frames meanwhile draw from the other one.
            (rng,) = self._rng.spawn(1)
            frames = [
                self._followed.removed_from(points, scene.model) for points in self._newest.frames
            ]
            follows = scene.motion is not None
            job = frames, scene.model, frame.pose, self.settings, rng, self._background, follows
            self._modelling = begun(self._background, modelled_elsewhere, *job)
            self._newest.forget()

    def _with_new_model(self, result: FrameResult, pose: RigidTransform) -> FrameResult:
        """Take a new model once it is there, if the sensor has not left the place."""
        if self._modelling is None or not self._modelling.done():
            return result
        modelled, self._modelling = self._modelling.result(), None
        if modelled is None:
            return result
        modelled.look_from(pose)
        if not modelled.is_at_home:
            return result
        self._followed.take_environment(modelled.model.environment)
        self._scene = modelled
        return replace(result, model=modelled.model, is_new_model=True)

    def _perceive(self, scene: ModelledScene, eye: ModelledScene, frame: Frame) -> FrameResult:
        """Remove the planes, detect objects, track them, end episodes, revise the environment.

        `scene`: that of the first camera; `eye`: that of the frame's.
        """
        points, time, budget = frame.points, frame.time, self._budget
        tracker = self._followed.tracker
        timer = StageTimer(self._clock)
        with timer.stage("planes"):
            moved = eye.moved(points, time)
            if moved:
                return self._model_again(time, moved, self._forget_view(frame.camera))
            clusters = eye.stages.clusters(points)
            eye.look_about(points, clusters, self._followed)
        budget.begin()
        with timer.stage("spheres"):
            expected = [
                start.seen_from(eye.model) for start in tracker.expected_spheres(time, frame.scan)
            ]
            spheres = eye.stages.spheres.find(points, clusters, expected, budget, frame.scan)
        with timer.stage("solids"):
            seen = all_objects(points, spheres, eye.stages.solids, frame.colors, budget)
            pixels = [item.pixels(points) for item in seen]
        budget.end()
        with timer.stage("tracking"):
            pose = eye.model.rotation, eye.model.translation
            detections = [
                replace(
                    item.detection.moved(*pose),
                    delay=item.detection.delay or frame.delay_of(readings),
                )
                for item, readings in zip(seen, pixels, strict=True)
            ]
            others = max(sum(clusters.new) - len(detections), 0)
            ended = tracker.update(time, detections, frame.camera, others)
            shown = tracker.objects_among(detections)
            pixels = [pixels[k] for k in shown]
            eye.stages.foreground.expect_objects(pixels)
            if scene is eye:
                pairs = list(zip(seen, detections, strict=True))
                self._followed.look_at_surfaces(pairs, frame, eye.model)
            if eye.is_at_home:
                eye.hindsight.keep(RecentFrame(frame, clusters, tracker.shown))
            eye.hindsight.search(tracker, eye.stages, budget)
            objects = tuple(self._perceived(track, scene) for track in tracker.tracks)
        with timer.stage("episodes"):
            now = max(time, self._timeline.newest_begin)
            episodes = self._followed.episodes.update(now, tracker.tracks, ended)
            up = scene.up_of_flights(episodes)
            if up is not None:
                return self._turn_gravity(scene, up, time)
        with timer.stage("revision"):
            try:
                revised = eye.watch(points, time, pixels)
            except NoEnvironmentError as gone:
                ended_episodes = *episodes, *self._forget_view(frame.camera)
                return self._model_again(time, str(gone), ended_episodes)
            # Of what a further camera sees only its own view was revised.
            revised = revised if scene is eye else ""
            if revised:
                self._followed.take_environment(scene.model.environment)
        latest = time + max((detection.delay for detection in detections), default=0.0)
        return FrameResult(
            tracker.newest(latest),
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
            detection_at(track, self._followed.tracker.seen_at(track)),
        )

    def _turn_gravity(
        self, scene: ModelledScene, up: NDArray[np.float64], time: float
    ) -> FrameResult:
        """Model the environment again with the gravity that flights show.

        Episodes under the other gravity are dropped: they would mislead the learner.
        """
        angle = degrees_between(scene.model.rotation[2], up)
        self._up = up, self._pose
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
        self._scene, self._modelling = None, None
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
        self._newest.forget()
        if self._scene is None:
            return ()
        episodes = self._followed.finish()
        first_track = self._followed.tracker.next_number
        environment = self._scene.model.environment
        self._followed = FollowedObjects(environment, self.settings, first_track)
        self._scene.restart()
        for further in self._further.values():
            further.restart()
        return episodes

    def _unused(self, time: float, problem: str) -> FrameResult:
        return FrameResult(time, self.model, diagnostics=FrameDiagnostics(problem=problem))


def _has_reading(points: NDArray[np.float32]) -> bool:
    """Whether `points` (height, width, 3) m have any reading: in most frames the first row has."""
    return any(np.isfinite(row).any() for row in points[..., 2])
