"""One object over time: what is believed of it, and how that came about."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import takewhile

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
from intuitive_physics_perception.detection.detection import Detection
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_perception.tracking.attitude import Attitude, with_attitude
from intuitive_physics_perception.tracking.motion import (
    POSITION,
    RADIUS,
    SUPPORT_DISTANCE,
    VELOCITY,
    Prediction,
    supporting_planes,
)
from intuitive_physics_perception.tracking.smoother import FilterStep
from intuitive_physics_perception.tracking.spin import (
    ROLLING_TIME,
    loses_no_speed,
    rolling_spin,
    unknown_spin,
)

MAX_STEPS = 4000
LIFT_SIGMAS = 3.0
NEW_COLOR = 0.25
"""Weight of the newest frame in a track's colour."""


@dataclass(eq=False)
class Track:
    """One object over time.

    Parameters
    ----------
    number : unique over a run
    kind : of its shape
    time : s, of `mean` and `covariance`
    mean, covariance : (7,) and (7, 7) of position, velocity and radius; of a box or capsule the
        radius stands for the height of its centre above its lowest point
    attitude : how a box or capsule lies and turns
    prediction : what the frame before made expect
    known : the known object it turned out to be
    resting : whether it did not move for `rest_time`
    color : (3,) mean red, green and blue of late, 0 to 1; None while it is not told
    moving_since : s, when it was first seen or left its rest
    steps : all frames since it was first seen
    """

    number: int
    kind: str
    time: float
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    prediction: Prediction
    attitude: Attitude | None
    last_seen: float
    moving_since: float
    hits: int = 1
    misses: int = 0
    confirmed: bool = False
    resting: bool = False
    known: KnownObject | None = None
    color: NDArray[np.float64] | None = None
    steps: deque[FilterStep] = field(default_factory=lambda: deque(maxlen=MAX_STEPS))

    def take_color(self, color: NDArray[np.float64] | None) -> None:
        """Average the colour of what was seen of it; late frames count most, as light changes."""
        if color is None:
            return
        self.color = color if self.color is None else self.color + NEW_COLOR * (color - self.color)

    def close_step(self, seen: Detection | None) -> None:
        """Keep what is believed after a frame in which `seen` was seen of it."""
        self.steps.append(
            FilterStep(self.time, self.prediction, self.mean, self.covariance, seen, self.attitude)
        )

    def recent(self, duration: float) -> list[FilterStep]:
        """Steps of the last `duration` s, oldest first."""
        newest = takewhile(lambda s: s.time >= self.time - duration, reversed(self.steps))
        return list(newest)[::-1]

    def scene_object(self, settings: PerceptionSettings) -> SceneObject:
        """What it is; its dimensions are averages over the track (Sec. VI-C)."""
        name = self.known.name if self.known else self.kind
        material = self.known.material if self.known else settings.object_material
        shape = self.attitude.shape if self.attitude else Sphere(float(self.mean[RADIUS]))
        return SceneObject(f"{name}_{self.number}", material, shape)

    def object_state(self, environment: Environment, settings: PerceptionSettings) -> ObjectState:
        """θ_d at `time`; a sphere's turning is not seen, but a rolling one's follows."""
        covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
        blocks = ((STATE_POSITION, POSITION), (LINEAR_VELOCITY, VELOCITY))
        for rows, own_rows in blocks:
            for columns, own_columns in blocks:
                covariance[rows, columns] = self.covariance[own_rows, own_columns]
        if self.attitude is not None:
            return with_attitude(
                self.mean[POSITION], self.mean[VELOCITY], covariance, self.attitude
            )
        spin, covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = self._spin(environment, settings)
        return ObjectState(
            self.mean[POSITION],
            linear_velocity=self.mean[VELOCITY],
            angular_velocity=spin,
            covariance=covariance,
        )

    def _spin(
        self, environment: Environment, settings: PerceptionSettings
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self.resting:
            return unknown_spin(settings.rest_speed / float(self.mean[RADIUS]))
        steps = self.recent(ROLLING_TIME)
        normal = self._rolls_on(steps, environment)
        if normal is None:
            return unknown_spin(settings.angular_velocity_deviation)
        return rolling_spin(
            self.mean[VELOCITY],
            self.covariance[VELOCITY, VELOCITY],
            float(self.mean[RADIUS]),
            normal,
            settings.angular_velocity_deviation,
        )

    def _rolls_on(
        self, steps: list[FilterStep], environment: Environment
    ) -> NDArray[np.float64] | None:
        """Normal of the plane it has rolled on during all of some steps, None for none."""
        if len(steps) < 4 or steps[-1].time - steps[0].time < 0.7 * ROLLING_TIME:
            return None
        for plane in supporting_planes(
            environment, self.mean[POSITION], float(self.mean[RADIUS]), SUPPORT_DISTANCE
        ):
            lifts = [float(plane.signed_distances(s.mean[POSITION])) for s in steps]
            noise = max(float(np.sqrt(np.trace(s.covariance[POSITION, POSITION]))) for s in steps)
            stays = np.ptp(lifts) < SUPPORT_DISTANCE + LIFT_SIGMAS * noise
            times = np.array([step.time for step in steps])
            velocities = np.stack([step.mean[VELOCITY] for step in steps])
            if stays and loses_no_speed(times, velocities):
                return plane.normal
        return None
