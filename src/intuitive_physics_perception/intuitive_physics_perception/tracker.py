"""Which object of this frame is which of the last one, and a filter for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment
from intuitive_physics_perception.association import cheapest_pairs
from intuitive_physics_perception.attitude import Attitude
from intuitive_physics_perception.detected_solid import DetectedSolid
from intuitive_physics_perception.detection import Detection, kind_of
from intuitive_physics_perception.motion import (
    POSITION,
    RADIUS,
    SIZE,
    VELOCITY,
    Prediction,
    predicted,
)
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.track import Track

GATE = 25.0
SMALLEST_LOG_DETERMINANT = -80.0
RADIUS_GATE = 4.0
RADIUS_SLACK = 0.003
RESTING_SPEED_DEVIATION = 0.02
TENTATIVE_MISSES = 1
PATIENCE = 4
KNOWN_RADIUS_DEVIATION = 1e-5
RESTING_SPIN_DEVIATION = 0.2
HEIGHT_DEVIATION = 0.01
MEASURED = np.array([0, 1, 2, RADIUS])


class Tracker:
    """Follows the objects of one environment from frame to frame.

    Parameters
    ----------
    environment : what the objects bounce off
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

    def update(self, time: float, detections: Sequence[Detection]) -> list[Track]:
        """Take what a frame shows, in the environment's frame; return tracks that ended.

        Parameters
        ----------
        time : s, later than that of the frame before
        """
        ended = [track for track in self._tracks if self._is_lost(track, time)]
        self._tracks = [track for track in self._tracks if not self._is_lost(track, time)]
        for track in self._tracks:
            self._predict(track, time)
        seen = self._matches(detections)
        for track in self._tracks:
            detection = seen.get(track.number)
            if detection is None:
                track.misses += 1
            else:
                self._correct(track, detection)
            track.close_step(detection)
            track.resting = track.resting or self._has_come_to_rest(track)
        taken = [id(detection) for detection in seen.values()]
        self._tracks += [
            self._new_track(time, detection)
            for detection in detections
            if id(detection) not in taken
        ]
        return [track for track in ended if track.confirmed]

    def _predict(self, track: Track, time: float) -> None:
        duration = time - track.time
        if track.resting:
            track.prediction = _rested(track, duration)
        else:
            track.prediction = predicted(
                track.mean,
                track.covariance,
                duration,
                self.environment,
                restitution=self._settings.bounce_restitution,
                acceleration_noise=self._settings.acceleration_noise,
            )
        if track.attitude is not None:
            self._predict_attitude(track, track.attitude, duration)
        track.mean, track.covariance = track.prediction.mean, track.prediction.covariance
        track.time = time

    def _predict_attitude(self, track: Track, attitude: Attitude, duration: float) -> None:
        """Turn a solid on, and take the height of its centre above its lowest point from that."""
        if track.resting:
            track.attitude = attitude.stopped(RESTING_SPIN_DEVIATION)
        else:
            track.attitude = attitude.after(duration)
        down = self.environment.gravity / max(float(np.linalg.norm(self.environment.gravity)), 1e-9)
        mean, transition = track.prediction.mean.copy(), track.prediction.transition.copy()
        covariance = track.prediction.covariance.copy()
        mean[RADIUS] = track.attitude.reach(down)
        transition[RADIUS] = covariance[RADIUS] = covariance[:, RADIUS] = 0.0
        covariance[RADIUS, RADIUS] = HEIGHT_DEVIATION**2
        track.prediction = Prediction(mean, covariance, transition)

    def _matches(self, detections: Sequence[Detection]) -> dict[int, Detection]:
        """Pair numbers of tracks and detections: by what is likely, then by what a hit or a hand
        could explain."""
        likely = np.full((len(self._tracks), len(detections)), np.inf)
        possible = likely.copy()
        for k, track in enumerate(self._tracks):
            for n, detection in enumerate(detections):
                if kind_of(detection) != track.kind:
                    continue
                innovation, spread = _innovation(track, detection)
                distance2 = float(innovation @ np.linalg.solve(spread, innovation))
                if distance2 < GATE:
                    # As the likelihood has it: a wide guess must not win by its width.
                    width = float(np.linalg.slogdet(spread)[1]) - SMALLEST_LOG_DETERMINANT
                    likely[k, n] = distance2 + max(width, 0.0)
                if self._is_possible(track, innovation, spread):
                    possible[k, n] = float(np.linalg.norm(innovation[:3]))
        pairs = cheapest_pairs(likely)
        for k, n in pairs:
            possible[k, :] = possible[:, n] = np.inf
        pairs += cheapest_pairs(possible)
        return {self._tracks[k].number: detections[n] for k, n in pairs}

    def _is_possible(
        self, track: Track, innovation: NDArray[np.float64], spread: NDArray[np.float64]
    ) -> bool:
        duration = track.time - track.last_seen
        reach = self._settings.max_speed * duration + 3.0 * np.sqrt(np.trace(spread[:3, :3]))
        slack = RADIUS_GATE * np.sqrt(spread[3, 3]) + RADIUS_SLACK
        return bool(np.linalg.norm(innovation[:3]) < reach and abs(innovation[3]) < slack)

    def _correct(self, track: Track, detection: Detection) -> None:
        innovation, spread = _innovation(track, detection)
        if innovation @ np.linalg.solve(spread, innovation) >= GATE:
            self._forget_velocity(track, innovation)
            innovation, spread = _innovation(track, detection)
        gain = np.linalg.solve(spread, track.covariance[MEASURED]).T
        track.mean = track.mean + gain @ innovation
        # Joseph's form keeps the covariance positive definite.
        keep = np.eye(SIZE)
        keep[:, MEASURED] -= gain
        track.covariance = keep @ track.covariance @ keep.T + gain @ detection.covariance @ gain.T
        if isinstance(detection, DetectedSolid) and track.attitude is not None:
            track.attitude = track.attitude.corrected(
                detection, self._settings.angular_velocity_deviation
            )
        track.hits, track.misses, track.last_seen = track.hits + 1, 0, track.time
        self._settle(track)

    def _settle(self, track: Track) -> None:
        """Call it an object as soon as that is clear."""
        if not track.confirmed and self._is_settled(track):
            track.confirmed = True
            self._recognise(track)

    def _is_settled(self, track: Track) -> bool:
        """Whether it was seen often enough, and its radius tells known objects apart."""
        settings = self._settings
        deviation = np.sqrt(track.covariance[RADIUS, RADIUS])
        return track.hits >= settings.confirming_hits and (
            not settings.known_objects
            or track.attitude is not None
            or 2.0 * deviation < settings.known_object_tolerance
            or track.hits >= PATIENCE * settings.confirming_hits
        )

    def _forget_velocity(self, track: Track, innovation: NDArray[np.float64]) -> None:
        """Something unmodelled moved it: what was believed of its velocity is void."""
        if track.resting:
            track.resting, track.moving_since = False, track.last_seen
        duration = max(track.time - track.last_seen, 1e-3)
        jump = float(np.linalg.norm(innovation[:3])) / duration
        wider = track.covariance.copy()
        wider[VELOCITY, VELOCITY] += (jump + 0.5) ** 2 * np.eye(3)
        wider[POSITION, POSITION] += (jump * duration) ** 2 * np.eye(3)
        track.covariance = wider
        track.prediction = replace(track.prediction, covariance=wider)

    def _recognise(self, track: Track) -> None:
        """Give the track the known object nearest in radius, whose radius then holds."""
        known = min(
            self._settings.known_objects,
            key=lambda thing: abs(thing.radius - track.mean[RADIUS]),
            default=None,
        )
        if known is None or track.attitude is not None:
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
        recent = [step for step in track.recent(settings.rest_time) if step.seen is not None]
        if len(recent) < 4 or recent[-1].time - recent[0].time < 0.7 * settings.rest_time:
            return False
        detections = [step.seen for step in recent if step.seen is not None]
        places = np.stack([detection.center for detection in detections])
        noise = np.sqrt(max(np.trace(detection.covariance[:3, :3]) for detection in detections))
        away = np.linalg.norm(places - places.mean(axis=0), axis=1).max()
        return bool(away < 0.5 * settings.rest_speed * settings.rest_time + 2.0 * noise)

    def _is_lost(self, track: Track, time: float) -> bool:
        if not track.confirmed:
            return track.misses > TENTATIVE_MISSES
        return time - track.last_seen > self._settings.coast_time

    def _new_track(self, time: float, detection: Detection) -> Track:
        mean = np.concatenate([detection.center, np.zeros(3), [detection.radius]])
        covariance = np.zeros((SIZE, SIZE))
        covariance[np.ix_(MEASURED, MEASURED)] = detection.covariance
        covariance[VELOCITY, VELOCITY] = (self._settings.max_speed / 3.0) ** 2 * np.eye(3)
        first = Prediction(mean, covariance, np.eye(SIZE))
        attitude = None
        if isinstance(detection, DetectedSolid):
            attitude = Attitude.of(detection, self._settings.angular_velocity_deviation)
        track = Track(
            self.next_number,
            kind_of(detection),
            time,
            mean,
            covariance,
            first,
            attitude,
            last_seen=time,
            moving_since=time,
        )
        self._settle(track)
        track.close_step(detection)
        self.next_number += 1
        return track


def _rested(track: Track, duration: float) -> Prediction:
    """What lies still stays, whatever holds it: that may be no plane of the model."""
    mean, transition = track.mean.copy(), np.eye(SIZE)
    mean[VELOCITY] = 0.0
    transition[VELOCITY, VELOCITY] = 0.0
    covariance = transition @ track.covariance @ transition.T
    covariance[VELOCITY, VELOCITY] += RESTING_SPEED_DEVIATION**2 * np.eye(3)
    covariance[POSITION, POSITION] += (RESTING_SPEED_DEVIATION * duration) ** 2 * np.eye(3)
    return Prediction(mean, covariance, transition)


def _innovation(
    track: Track, detection: Detection
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measured less predicted centre and radius (4,), and its covariance (4, 4)."""
    innovation = np.append(detection.center, detection.radius) - track.mean[MEASURED]
    if track.attitude is not None:
        # Its radius stands for a height that the attitude tells.
        innovation[3] = 0.0
    return innovation, track.covariance[np.ix_(MEASURED, MEASURED)] + detection.covariance
