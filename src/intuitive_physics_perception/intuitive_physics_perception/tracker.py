"""Which sphere of this frame is which of the last one, and a filter for each."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    ObjectState,
)
from intuitive_physics.state import POSITION as STATE_POSITION
from intuitive_physics_perception.motion import POSITION, RADIUS, SIZE, VELOCITY, predicted
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_perception.spheres import DetectedSphere

GATE = 25.0
RADIUS_GATE = 4.0
RADIUS_SLACK = 0.003
RESTING_SPEED_DEVIATION = 0.02
TENTATIVE_MISSES = 1
PATIENCE = 4
KNOWN_RADIUS_DEVIATION = 1e-5
MAX_HISTORY = 4000
MEASURED = np.array([0, 1, 2, RADIUS])


@dataclass(frozen=True, eq=False)
class TrackPoint:
    """One detection of a track: time in s, the sphere in the environment's frame."""

    time: float
    sphere: DetectedSphere


@dataclass(eq=False)
class Track:
    """One ball over time.

    Parameters
    ----------
    number : unique over a run
    time : s, of `mean` and `covariance`
    mean, covariance : (7,) and (7, 7) of position, velocity and radius
    known : the known object it turned out to be
    resting : whether it did not move for `rest_time`
    moving_since : s, when it was first seen or left its rest
    """

    number: int
    time: float
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    last_seen: float
    moving_since: float
    hits: int = 1
    misses: int = 0
    confirmed: bool = False
    resting: bool = False
    known: KnownObject | None = None
    history: deque[TrackPoint] = field(default_factory=lambda: deque(maxlen=MAX_HISTORY))

    def scene_object(self, settings: PerceptionSettings) -> SceneObject:
        """What it is; its radius is the average over the track (Sec. VI-C)."""
        name = self.known.name if self.known else "sphere"
        material = self.known.material if self.known else settings.object_material
        return SceneObject(f"{name}_{self.number}", material, Sphere(float(self.mean[RADIUS])))

    def object_state(self, settings: PerceptionSettings) -> ObjectState:
        """θ_d at `time`; a sphere's turning is not seen, so its spin has a wide covariance."""
        covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
        blocks = ((STATE_POSITION, POSITION), (LINEAR_VELOCITY, VELOCITY))
        for rows, own_rows in blocks:
            for columns, own_columns in blocks:
                covariance[rows, columns] = self.covariance[own_rows, own_columns]
        covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = (
            settings.angular_velocity_deviation** 2 * np.eye(3)
        )
        return ObjectState(
            self.mean[POSITION], linear_velocity=self.mean[VELOCITY], covariance=covariance
        )


class Tracker:
    """Follows the spheres of one environment from frame to frame.

    Parameters
    ----------
    environment : what the spheres bounce off
    first_number : number of the first track, so that numbers stay unique over restarts
    """

    def __init__(
        self, environment: Environment, settings: PerceptionSettings, first_number: int = 1
    ) -> None:
        self.environment = environment
        self.next_number = first_number
        self._settings = settings
        self._tracks: list[Track] = []

    @property
    def tracks(self) -> list[Track]:
        """Tracks that are alive and were seen often enough to be an object."""
        return [track for track in self._tracks if track.confirmed]

    def update(self, time: float, spheres: Sequence[DetectedSphere]) -> list[Track]:
        """Take the spheres of a frame, in the environment's frame; return tracks that ended.

        Parameters
        ----------
        time : s, later than that of the frame before
        """
        ended = [track for track in self._tracks if self._is_lost(track, time)]
        self._tracks = [track for track in self._tracks if not self._is_lost(track, time)]
        for track in self._tracks:
            self._predict(track, time)
        free = list(spheres)
        for track, sphere in self._matches(free):
            self._correct(track, sphere)
            free.remove(sphere)
        for track in self._tracks:
            if track.last_seen < time:
                track.misses += 1
            track.resting = track.resting or self._has_come_to_rest(track)
        self._tracks += [self._new_track(time, sphere) for sphere in free]
        return [track for track in ended if track.confirmed]

    def _predict(self, track: Track, time: float) -> None:
        duration = time - track.time
        if track.resting:
            # What holds it may be no plane of the model: it simply stays.
            track.covariance[VELOCITY, :] = track.covariance[:, VELOCITY] = 0.0
            track.covariance[VELOCITY, VELOCITY] = RESTING_SPEED_DEVIATION**2 * np.eye(3)
            track.covariance[POSITION, POSITION] += (
                RESTING_SPEED_DEVIATION * duration
            ) ** 2 * np.eye(3)
            track.mean[VELOCITY] = 0.0
        else:
            track.mean, track.covariance = predicted(
                track.mean,
                track.covariance,
                duration,
                self.environment,
                restitution=self._settings.bounce_restitution,
                acceleration_noise=self._settings.acceleration_noise,
            )
        track.time = time

    def _matches(self, spheres: list[DetectedSphere]) -> list[tuple[Track, DetectedSphere]]:
        """Pair tracks and spheres, likeliest first; then those a hit or a hand could explain."""
        likely, possible = [], []
        for track in self._tracks:
            for sphere in spheres:
                innovation, spread = _innovation(track, sphere)
                distance2 = float(innovation @ np.linalg.solve(spread, innovation))
                if distance2 < GATE:
                    likely.append((distance2, track, sphere))
                elif self._is_possible(track, innovation, spread):
                    possible.append((float(np.linalg.norm(innovation[:3])), track, sphere))
        matches: list[tuple[Track, DetectedSphere]] = []
        for candidates in (likely, possible):
            for _, track, sphere in sorted(candidates, key=lambda candidate: candidate[0]):
                if all(track is not other and sphere is not seen for other, seen in matches):
                    matches.append((track, sphere))
        return matches

    def _is_possible(
        self, track: Track, innovation: NDArray[np.float64], spread: NDArray[np.float64]
    ) -> bool:
        duration = track.time - track.last_seen
        reach = self._settings.max_speed * duration + 3.0 * np.sqrt(np.trace(spread[:3, :3]))
        slack = RADIUS_GATE * np.sqrt(spread[3, 3]) + RADIUS_SLACK
        return bool(np.linalg.norm(innovation[:3]) < reach and abs(innovation[3]) < slack)

    def _correct(self, track: Track, sphere: DetectedSphere) -> None:
        innovation, spread = _innovation(track, sphere)
        if innovation @ np.linalg.solve(spread, innovation) >= GATE:
            self._forget_velocity(track, innovation)
            innovation, spread = _innovation(track, sphere)
        gain = np.linalg.solve(spread, track.covariance[MEASURED]).T
        track.mean = track.mean + gain @ innovation
        # Joseph's form keeps the covariance positive definite.
        keep = np.eye(SIZE)
        keep[:, MEASURED] -= gain
        track.covariance = keep @ track.covariance @ keep.T + gain @ sphere.covariance @ gain.T
        track.hits, track.misses, track.last_seen = track.hits + 1, 0, track.time
        track.history.append(TrackPoint(track.time, sphere))
        if not track.confirmed and self._is_settled(track):
            track.confirmed = True
            self._recognise(track)

    def _is_settled(self, track: Track) -> bool:
        """Whether it was seen often enough, and its radius tells known objects apart."""
        settings = self._settings
        deviation = np.sqrt(track.covariance[RADIUS, RADIUS])
        return track.hits >= settings.confirming_hits and (
            not settings.known_objects
            or 2.0 * deviation < settings.known_object_tolerance
            or track.hits >= PATIENCE * settings.confirming_hits
        )

    def _forget_velocity(self, track: Track, innovation: NDArray[np.float64]) -> None:
        """Something unmodelled moved it: what was believed of its velocity is void."""
        if track.resting:
            track.resting, track.moving_since = False, track.last_seen
        duration = max(track.time - track.last_seen, 1e-3)
        jump = float(np.linalg.norm(innovation[:3])) / duration
        track.covariance[VELOCITY, VELOCITY] += (jump + 0.5) ** 2 * np.eye(3)
        track.covariance[POSITION, POSITION] += (jump * duration) ** 2 * np.eye(3)

    def _recognise(self, track: Track) -> None:
        """Give the track the known object nearest in radius, whose radius then holds."""
        known = min(
            self._settings.known_objects,
            key=lambda thing: abs(thing.radius - track.mean[RADIUS]),
            default=None,
        )
        if known is None:
            return
        tolerance = self._settings.known_object_tolerance
        if abs(known.radius - track.mean[RADIUS]) > tolerance:
            return
        track.known = known
        # A measurement of the radius alone, as good as a known one: it moves the centre, too.
        variance = track.covariance[RADIUS, RADIUS] + KNOWN_RADIUS_DEVIATION**2
        gain = track.covariance[:, RADIUS] / variance
        track.mean = track.mean + gain * (known.radius - track.mean[RADIUS])
        track.covariance = track.covariance - np.outer(gain, gain) * variance

    def _has_come_to_rest(self, track: Track) -> bool:
        """Whether it stayed, within noise and `rest_speed`, where it was for `rest_time`."""
        settings = self._settings
        recent = [p for p in track.history if p.time >= track.time - settings.rest_time]
        if len(recent) < 4 or recent[-1].time - recent[0].time < 0.7 * settings.rest_time:
            return False
        places = np.stack([point.sphere.center for point in recent])
        noise = np.sqrt(max(np.trace(point.sphere.covariance[:3, :3]) for point in recent))
        away = np.linalg.norm(places - places.mean(axis=0), axis=1).max()
        return bool(away < 0.5 * settings.rest_speed * settings.rest_time + 2.0 * noise)

    def _is_lost(self, track: Track, time: float) -> bool:
        if not track.confirmed:
            return track.misses > TENTATIVE_MISSES
        return time - track.last_seen > self._settings.coast_time

    def _new_track(self, time: float, sphere: DetectedSphere) -> Track:
        mean = np.concatenate([sphere.center, np.zeros(3), [sphere.radius]])
        covariance = np.zeros((SIZE, SIZE))
        covariance[np.ix_(MEASURED, MEASURED)] = sphere.covariance
        covariance[VELOCITY, VELOCITY] = (self._settings.max_speed / 3.0) ** 2 * np.eye(3)
        track = Track(self.next_number, time, mean, covariance, time, time)
        track.history.append(TrackPoint(time, sphere))
        if self._is_settled(track):
            track.confirmed = True
            self._recognise(track)
        self.next_number += 1
        return track


def _innovation(
    track: Track, sphere: DetectedSphere
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measured less predicted centre and radius (4,), and its covariance (4, 4)."""
    innovation = np.append(sphere.center, sphere.radius) - track.mean[MEASURED]
    return innovation, track.covariance[np.ix_(MEASURED, MEASURED)] + sphere.covariance
