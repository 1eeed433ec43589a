"""One object over time: its estimate, how that came about, and the filter that carries it on."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice, takewhile

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import SeenSpin
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_perception.appearance.surface_spin import SurfaceSpin
from intuitive_physics_perception.detection.detections import (
    DetectedSolid,
    Detection,
    frame_covariance,
)
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_perception.tracking.attitude import (
    Attitude,
    object_state,
    rolling_angular_velocity,
    rolls,
    unknown_angular_velocity,
)
from intuitive_physics_perception.tracking.motion import (
    FRAME_TIME,
    GATE,
    LIFT_SIGMAS,
    PLACED,
    POSITION,
    RADIUS,
    ROLLING_INERTIA,
    SIZE,
    SUPPORT_DISTANCE,
    VELOCITY,
    Prediction,
    carrying,
    corrected,
    downward,
    predicted,
    white_acceleration,
)
from intuitive_physics_perception.tracking.motion_fits import SeenPath
from intuitive_physics_perception.tracking.size_classes import SizeClass
from intuitive_physics_perception.tracking.supports import supported_acceleration

ROLLING_MEMORY = 0.6
"""Time for which that is looked back at most, where noise hides what friction takes in a shorter
one, s."""

RESTING_SPEED_DEVIATION = 0.02
"""Standard deviation of the velocity of an object at rest, m/s."""

RESTING_ANGULAR_VELOCITY_DEVIATION = 0.2
"""Standard deviation of the angular velocity of a box or capsule at rest, rad/s."""

HEIGHT_DEVIATION = 0.01
"""Standard deviation of the height of a solid's centre above its lowest point, m."""

INSTANT = 1e-6
"""Time, s, between two steps of a track that are of one time: numerical."""

MAX_STEPS = 4000
"""Newest frames of a track that are kept: bounds its memory. At 90 Hz they last 44 s."""


@dataclass(frozen=True, eq=False)
class FilterStep:
    """State of the filters at one frame.

    Parameters
    ----------
    time : s
    prediction : from the frame before
    mean, covariance : (7,) and (7, 7) once the frame was taken into account
    detection : of it in this frame, in the environment's frame; None where it was not detected
    attitude : how it lies and turns; None of a sphere
    """

    time: float
    prediction: Prediction
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    detection: Detection | None
    attitude: Attitude | None = None


@dataclass(eq=False)
class Track:
    """One object over time.

    Parameters
    ----------
    number : unique over a run
    time : s, of `mean` and `covariance`
    mean, covariance : (7,) and (7, 7), less what all frames share, of position, velocity and
        radius; of a box or capsule the radius stands for the height of its centre above its lowest
        point
    attitude : how a box or capsule lies and turns
    systematic : (4, 4) m² of centre and radius, what the errors of all frames share
    prediction : what the frame before made expect
    known_object : the known object it turned out to be
    size : of a sphere that is none; None while that is unknown
    resting : whether it did not move for `rest_time`
    color : (3,) mean red, green and blue, a recent mean, 0 to 1; None while unknown
    moving_since : s, when it was first seen or left its rest
    seen_time : s for which it was seen, at most `FRAME_TIME` for each detection
    steps : all frames since it was first seen
    earlier : detections in frames in which it was not seen at first, with their times (s), as long
        as they are looked for; None else
    jumped : s, when it was last seen farther from where it was expected than noise explains, until
        it is looked for in the frames before that; None else
    identity : the object that it is, where that is known from elsewhere
    surface : what its surface has shown of its spin since its last contact; None while nothing
    camera : name of the one whose frame showed it last
    missed : whether that camera's newest frame did not
    prior : log odds that it is an object before it was seen, nats
    """

    number: int
    time: float
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    systematic: NDArray[np.float64]
    prediction: Prediction
    attitude: Attitude | None
    last_seen: float
    moving_since: float
    seen_time: float = 0.0
    confirmed: bool = False
    resting: bool = False
    known_object: KnownObject | None = None
    size: SizeClass | None = None
    color: NDArray[np.float64] | None = None
    steps: deque[FilterStep] = field(default_factory=lambda: deque(maxlen=MAX_STEPS))
    earlier: list[tuple[float, Detection]] | None = field(default_factory=list)
    jumped: float | None = None
    identity: SceneObject | None = None
    surface: SurfaceSpin | None = None
    camera: str = ""
    missed: bool = False
    prior: float = 0.0

    def take_color(self, color: NDArray[np.float64] | None, weight: float) -> None:
        """Average the colour of its detections; late frames count most, as light changes.

        `color` (3,) mean red, green and blue of the newest detection, 0 to 1; None: unknown.
        """
        if color is None:
            return
        self.color = color if self.color is None else self.color + weight * (color - self.color)

    @property
    def kind(self) -> str:
        """Of its shape."""
        return "sphere" if self.attitude is None else self.attitude.shape.kind

    @property
    def seen_spin(self) -> SeenSpin | None:
        """Its spin as its surface shows it, None where that is unknown."""
        if self.surface is None or self.surface.spin is None:
            return None
        spin = self.surface.spin
        return SeenSpin(spin.mean, spin.covariance, self.surface.since)

    def leave_rest(
        self, since: float, velocity: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> None:
        """Take up the motion that the frames up to the last one show.

        `since` in s, when it began; `velocity` (3,) m/s; `covariance` (3, 3) m²/s², of the
        velocity.
        """
        self.resting, self.moving_since = False, since
        self.mean, self.covariance = self.mean.copy(), self.covariance.copy()
        self.mean[VELOCITY] = velocity
        self.covariance[VELOCITY] = 0.0
        self.covariance[:, VELOCITY] = 0.0
        self.covariance[VELOCITY, VELOCITY] = covariance
        self.steps[-1] = replace(self.steps[-1], mean=self.mean, covariance=self.covariance)

    @property
    def radius_variance(self) -> float:
        """m², with what the errors of all frames share."""
        return float(self.covariance[RADIUS, RADIUS] + self.systematic[3, 3])

    def close_step(self, detection: Detection | None) -> None:
        """Append the state after a frame in which `detection` was detected of it."""
        self.steps.append(
            FilterStep(
                self.time, self.prediction, self.mean, self.covariance, detection, self.attitude
            )
        )

    @property
    def detections(self) -> list[tuple[float, Detection]]:
        """Detections with their times (s), oldest first, those that were found later among them."""
        return self.seen_after(-np.inf)

    def seen_after(self, time: float) -> list[tuple[float, Detection]]:
        """Return the detections later than a time (s), with theirs, oldest first."""
        earlier = [pair for pair in self.earlier or [] if pair[0] > time]
        return sorted([*earlier, *detections_of(self.after(time))], key=lambda pair: pair[0])

    def recent(self, duration: float) -> list[FilterStep]:
        """Steps of the last `duration` s, oldest first."""
        return self.since(self.time - duration)

    def after(self, time: float) -> list[FilterStep]:
        """Steps later than a time (s), oldest first."""
        return list(takewhile(lambda step: step.time > time, reversed(self.steps)))[::-1]

    def forget_until(self, time: float) -> None:
        """Drop all that was seen up to a time, s: it was another object."""
        self.steps = deque(self.after(time), maxlen=MAX_STEPS)
        self.earlier = [pair for pair in self.earlier or [] if pair[0] > time]
        self.moving_since = max(self.moving_since, self.steps[0].time)

    def seen_at(self, time: float) -> Detection | None:
        """Return what was seen of the track at a time (s), None for nothing."""
        return next((step.detection for step in self.since(time) if step.time == time), None)

    def since(self, time: float) -> list[FilterStep]:
        """Steps not before a time (s), oldest first."""
        return list(takewhile(lambda step: step.time >= time, reversed(self.steps)))[::-1]

    def scene_object(self, settings: PerceptionSettings) -> SceneObject:
        """Return the object; its dimensions are averages over the track (Sec. VI-C)."""
        if self.identity is not None:
            return self.identity
        name = self.known_object.name if self.known_object else self.kind
        material = settings.object_material
        if self.known_object is not None:
            material = self.known_object.material
        elif self.size is not None:
            material = self.size.material(settings.object_material)
        shape = self.attitude.shape if self.attitude else Sphere(float(self.mean[RADIUS]))
        return SceneObject(f"{name}_{self.number}", material, shape)

    def object_state(self, environment: Environment, settings: PerceptionSettings) -> ObjectState:
        """θ_d at `time`; a sphere's turning is not seen, but a rolling one's follows."""
        covariance = self.covariance[:6, :6].copy()
        covariance[POSITION, POSITION] += self.systematic[:3, :3]
        turning = self.attitude or self._angular_velocity(environment, settings)
        return object_state(self.mean, covariance, turning)

    def _angular_velocity(
        self, environment: Environment, settings: PerceptionSettings
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self.resting:
            return unknown_angular_velocity(settings.rest_speed / float(self.mean[RADIUS]))
        normal = self._rolls_on(environment)
        if normal is None:
            mean, spread = unknown_angular_velocity(settings.angular_velocity_deviation)
            if (seen := self.seen_spin) is None:
                return mean, spread
            return corrected(mean, spread, np.arange(3), seen.mean - mean, seen.covariance)
        return rolling_angular_velocity(
            self.mean[VELOCITY],
            self.covariance[VELOCITY, VELOCITY],
            float(self.mean[RADIUS]),
            normal,
            settings.angular_velocity_deviation,
        )

    def _rolls_on(self, environment: Environment) -> NDArray[np.float64] | None:
        """Normal of the surface it has rolled on for a while up to the last frame, or None."""
        for plane in carrying(self.mean, self.covariance, environment):
            newest_first = reversed(self.recent(ROLLING_MEMORY))
            steps = list(takewhile(partial(self._is_on, plane), newest_first))[::-1]
            expected = supported_acceleration(environment.gravity, [plane], ROLLING_INERTIA)
            if rolls(path_of(detections_of(steps)), expected):
                return plane.normal
        return None

    def _is_on(self, plane: Plane, step: FilterStep) -> bool:
        """Whether the ball touched a plane then, as it does at the last frame."""
        lift = float(plane.normal @ (step.mean[POSITION] - self.mean[POSITION]))
        noise = float(np.sqrt(plane.normal @ step.covariance[POSITION, POSITION] @ plane.normal))
        return abs(lift) < SUPPORT_DISTANCE + LIFT_SIGMAS * noise and bool(
            plane.covers(step.mean[POSITION])
        )


class TrackFilter:
    """Kalman filter of position, velocity and radius, and of a solid's attitude beside it."""

    def __init__(self, environment: Environment, settings: PerceptionSettings) -> None:
        self._environment = environment
        self._settings = settings

    def begin(self, number: int, time: float, detection: Detection) -> Track:
        """Return the track of what is seen for the first time."""
        mean = np.concatenate([detection.center, np.zeros(3), [detection.radius]])
        covariance = np.zeros((SIZE, SIZE))
        covariance[np.ix_(PLACED, PLACED)] = frame_covariance(detection)
        covariance[VELOCITY, VELOCITY] = (self._settings.max_speed / 3.0) ** 2 * np.eye(3)
        first = Prediction(mean, covariance, np.eye(SIZE))
        attitude = None
        if isinstance(detection, DetectedSolid):
            attitude = Attitude.of(detection, self._settings.angular_velocity_deviation)
        return Track(
            number,
            time,
            mean,
            covariance,
            detection.systematic,
            first,
            attitude,
            last_seen=time,
            moving_since=time,
        )

    def predict(self, track: Track, time: float) -> None:
        """Carry a track on to the time of the next frame."""
        duration = time - track.time
        if track.resting:
            track.prediction = _rested(track, duration)
        else:
            track.prediction = predicted(
                track.mean,
                track.covariance,
                duration,
                self._environment,
                acceleration_noise=self._settings.acceleration_noise,
                rolls=track.attitude is None,
            )
        if track.attitude is not None:
            self._predict_attitude(track, track.attitude, duration)
        track.mean, track.covariance = track.prediction.mean, track.prediction.covariance
        track.time = time
        if track.surface is not None and track.prediction.contact:
            track.surface.forget()

    def at_earlier(self, track: Track, time: float) -> Track | None:
        """Return a track as it was at an earlier time, in s, without what was seen of it since.

        None where what it is now does not follow from what it was: since then it has begun, has
        turned out to be of another kind, or has left its rest.
        """
        since = track.after(time)
        # A rest predicts no velocity from that before, another kind nothing at all.
        carried = POSITION if track.resting else VELOCITY
        follows = all(step.prediction.transition[carried, carried].any() for step in since)
        if not follows or len(since) == len(track.steps):
            return None
        earlier = _after_steps(track, len(track.steps) - len(since))
        self.predict(earlier, max(time, earlier.time + INSTANT))
        return earlier

    def before(self, track: Track, time: float) -> Track | None:
        """Return a track as it was after its last step before a time, s; None where it has none."""
        count = sum(step.time < time for step in track.steps)
        return replace(_after_steps(track, count), resting=False) if count else None

    def moved_back(self, track: Track, time: float) -> Track:
        """Return a track where it must have been at an earlier time, in s, if it moved straight."""
        duration = time - track.time
        back = np.eye(SIZE)
        back[POSITION, VELOCITY] = duration * np.eye(3)
        covariance = back @ track.covariance @ back.T
        noise = white_acceleration(duration, self._settings.acceleration_noise)
        covariance[:6, :6] += np.kron(noise, np.eye(3))
        return replace(track, time=time, mean=back @ track.mean, covariance=covariance)

    def go_on(self, track: Track, seen: Iterable[tuple[float, Detection | None]]) -> None:
        """Carry a track on over times (s), in each of which it was detected or not."""
        for time, detection in seen:
            self.predict(track, max(time, track.steps[-1].time + INSTANT))
            if detection is not None:
                self.correct(track, detection)
            track.close_step(detection)

    def _predict_attitude(self, track: Track, attitude: Attitude, duration: float) -> None:
        """Turn a solid on, and take the height of its centre above its lowest point from that."""
        if track.resting:
            track.attitude = attitude.stopped(RESTING_ANGULAR_VELOCITY_DEVIATION)
        else:
            track.attitude = attitude.after(duration)
        mean, transition = track.prediction.mean.copy(), track.prediction.transition.copy()
        covariance = track.prediction.covariance.copy()
        mean[RADIUS] = track.attitude.reach(downward(self._environment))
        transition[RADIUS] = covariance[RADIUS] = covariance[:, RADIUS] = 0.0
        covariance[RADIUS, RADIUS] = HEIGHT_DEVIATION**2
        track.prediction = Prediction(mean, covariance, transition)

    def correct(self, track: Track, detection: Detection) -> None:
        """Take into account what was seen of a track at its time."""
        innovation, spread = innovation_of(track, detection)
        track.systematic = detection.systematic
        if innovation @ np.linalg.solve(spread, innovation) >= GATE:
            track.jumped = track.time
            self._forget_velocity(track, innovation)
            innovation, _ = innovation_of(track, detection)
        noise = frame_covariance(detection)
        track.mean, track.covariance = corrected(
            track.mean, track.covariance, PLACED, innovation, noise
        )
        if isinstance(detection, DetectedSolid) and track.attitude is not None:
            track.attitude = track.attitude.corrected(
                detection, self._settings.angular_velocity_deviation
            )
        self._was_seen(track)

    def change_kind(self, track: Track, detection: Detection) -> None:
        """Go on with an object that turned out to be of another kind, as fast as it was."""
        fresh = self.begin(track.number, track.time, detection)
        fresh.mean[VELOCITY] = track.mean[VELOCITY]
        fresh.covariance[VELOCITY, VELOCITY] = track.covariance[VELOCITY, VELOCITY]
        track.attitude, track.systematic = fresh.attitude, fresh.systematic
        track.mean, track.covariance = fresh.mean, fresh.covariance
        # Nothing that is found out later says where it was as the other kind.
        track.prediction = Prediction(fresh.mean, fresh.covariance, np.zeros((SIZE, SIZE)))
        track.size, track.known_object, track.earlier = None, None, None
        self._was_seen(track)

    def _was_seen(self, track: Track) -> None:
        track.seen_time += min(track.time - track.last_seen, FRAME_TIME)
        track.last_seen = track.time

    def _forget_velocity(self, track: Track, innovation: NDArray[np.float64]) -> None:
        """Something unmodelled moved it: the estimate of its velocity is void."""
        if track.resting:
            track.resting, track.moving_since = False, track.last_seen
        duration = max(track.time - track.last_seen, 1e-3)
        jump = float(np.linalg.norm(innovation[:3])) / duration
        wider = track.covariance.copy()
        wider[VELOCITY, VELOCITY] += (jump + 0.5) ** 2 * np.eye(3)
        wider[POSITION, POSITION] += (jump * duration) ** 2 * np.eye(3)
        track.covariance = wider
        track.prediction = replace(track.prediction, covariance=wider)
        if track.surface is not None:
            track.surface.forget()


def _after_steps(track: Track, count: int) -> Track:
    """A track as it was after the first of its steps, one at least."""
    steps = deque(islice(track.steps, count), maxlen=MAX_STEPS)
    since, step = list(islice(track.steps, count, None)), steps[-1]
    last_seen = next((s.time for s in reversed(steps) if s.detection is not None), step.time)
    seen = [last_seen, *(s.time for s in since if s.detection is not None)]
    return replace(
        track,
        time=step.time,
        mean=step.mean,
        covariance=step.covariance,
        prediction=step.prediction,
        attitude=step.attitude,
        last_seen=last_seen,
        seen_time=track.seen_time - float(np.minimum(np.diff(seen), FRAME_TIME).sum()),
        steps=steps,
        # Its contacts have been noticed already.
        surface=None,
    )


def detections_of(steps: Iterable[FilterStep]) -> list[tuple[float, Detection]]:
    """Return the detections of some steps with their times (s)."""
    return [(step.time, step.detection) for step in steps if step.detection is not None]


def path_of(detections: Sequence[tuple[float, Detection]]) -> SeenPath:
    """Return the path of the centres, with the covariances of each frame."""
    return SeenPath(
        np.array([time for time, _ in detections]),
        np.array([detection.center for _, detection in detections]),
        np.array([frame_covariance(detection)[:3, :3] for _, detection in detections]),
    )


def innovation_of(
    track: Track, detection: Detection
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measured less predicted centre and radius (4,), and its covariance (4, 4): what all frames
    share makes no difference."""
    innovation = np.append(detection.center, detection.radius) - track.mean[PLACED]
    if track.attitude is not None:
        # Its radius stands for a height that follows from the attitude.
        innovation[3] = 0.0
    return innovation, track.covariance[np.ix_(PLACED, PLACED)] + frame_covariance(detection)


def _rested(track: Track, duration: float) -> Prediction:
    """Prediction of an object at rest: it stays, whatever holds it, as that may be no plane of the
    model."""
    mean, transition = track.mean.copy(), np.eye(SIZE)
    mean[VELOCITY] = 0.0
    transition[VELOCITY, VELOCITY] = 0.0
    covariance = transition @ track.covariance @ transition.T
    covariance[VELOCITY, VELOCITY] += RESTING_SPEED_DEVIATION**2 * np.eye(3)
    # As much as at 30 Hz, whatever the frame rate.
    covariance[POSITION, POSITION] += RESTING_SPEED_DEVIATION**2 * duration * FRAME_TIME * np.eye(3)
    return Prediction(mean, covariance, transition)
