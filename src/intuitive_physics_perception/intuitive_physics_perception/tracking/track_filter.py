"""The filter of one object: what is expected of the next frame, and what the frame makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment
from intuitive_physics_perception.detection.detected_solid import DetectedSolid
from intuitive_physics_perception.detection.detection import Detection, kind_of
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.attitude import Attitude
from intuitive_physics_perception.tracking.motion import (
    POSITION,
    RADIUS,
    SIZE,
    VELOCITY,
    Prediction,
    downward,
    predicted,
)
from intuitive_physics_perception.tracking.track import Track

GATE = 25.0
RESTING_SPEED_DEVIATION = 0.02
RESTING_SPIN_DEVIATION = 0.2
HEIGHT_DEVIATION = 0.01
MEASURED = np.array([0, 1, 2, RADIUS])


class TrackFilter:
    """Kalman filter of position, velocity and radius, and of a solid's attitude beside it."""

    def __init__(self, environment: Environment, settings: PerceptionSettings) -> None:
        self._environment = environment
        self._settings = settings

    def begin(self, number: int, time: float, detection: Detection) -> Track:
        """Return the track of what is seen for the first time."""
        mean = np.concatenate([detection.center, np.zeros(3), [detection.radius]])
        covariance = np.zeros((SIZE, SIZE))
        covariance[np.ix_(MEASURED, MEASURED)] = detection.covariance
        covariance[VELOCITY, VELOCITY] = (self._settings.max_speed / 3.0) ** 2 * np.eye(3)
        first = Prediction(mean, covariance, np.eye(SIZE))
        attitude = None
        if isinstance(detection, DetectedSolid):
            attitude = Attitude.of(detection, self._settings.angular_velocity_deviation)
        return Track(
            number,
            kind_of(detection),
            time,
            mean,
            covariance,
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
        mean, transition = track.prediction.mean.copy(), track.prediction.transition.copy()
        covariance = track.prediction.covariance.copy()
        mean[RADIUS] = track.attitude.reach(downward(self._environment))
        transition[RADIUS] = covariance[RADIUS] = covariance[:, RADIUS] = 0.0
        covariance[RADIUS, RADIUS] = HEIGHT_DEVIATION**2
        track.prediction = Prediction(mean, covariance, transition)

    def correct(self, track: Track, detection: Detection) -> None:
        """Take into account what was seen of a track at its time."""
        innovation, spread = innovation_of(track, detection)
        if innovation @ np.linalg.solve(spread, innovation) >= GATE:
            self._forget_velocity(track, innovation)
            innovation, spread = innovation_of(track, detection)
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


def innovation_of(
    track: Track, detection: Detection
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measured less predicted centre and radius (4,), and its covariance (4, 4)."""
    innovation = np.append(detection.center, detection.radius) - track.mean[MEASURED]
    if track.attitude is not None:
        # Its radius stands for a height that the attitude tells.
        innovation[3] = 0.0
    return innovation, track.covariance[np.ix_(MEASURED, MEASURED)] + detection.covariance


def _rested(track: Track, duration: float) -> Prediction:
    """What lies still stays, whatever holds it: that may be no plane of the model."""
    mean, transition = track.mean.copy(), np.eye(SIZE)
    mean[VELOCITY] = 0.0
    transition[VELOCITY, VELOCITY] = 0.0
    covariance = transition @ track.covariance @ transition.T
    covariance[VELOCITY, VELOCITY] += RESTING_SPEED_DEVIATION**2 * np.eye(3)
    covariance[POSITION, POSITION] += (RESTING_SPEED_DEVIATION * duration) ** 2 * np.eye(3)
    return Prediction(mean, covariance, transition)
