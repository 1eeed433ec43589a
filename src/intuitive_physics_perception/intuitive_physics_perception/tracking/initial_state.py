"""The initial state θ_d of an observed object: least squares over a stretch of free motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.state import ObjectState
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.attitude import object_state
from intuitive_physics_perception.tracking.free_motion import FreeMotion, Record, Stretch
from intuitive_physics_perception.tracking.rolling import (
    ROLLING_TIME,
    rolling_angular_velocity,
    unknown_angular_velocity,
)


def state_at(
    record: Record, time: float, free: FreeMotion, settings: PerceptionSettings
) -> ObjectState | None:
    """Estimate an object's state from the stretch of free motion that holds `time`, s.

    Position and velocity come from weighted least squares with the acceleration known; their
    covariance grows with the misfit.

    Parameters
    ----------
    record : detections of the object
    time : s
    free : motion of the record
    settings : of perception

    Returns
    -------
    None where no stretch of free motion holds `time`.
    """
    stretch = free.stretch_at(time)
    if stretch is None:
        return None
    mean, spread = stretch.at(time)
    if record.attitudes is not None:
        # The end of the stretch knows the angular velocity best, and nothing changed it before.
        last = record.attitudes[stretch.end - 1].after(time - float(record.times[stretch.end - 1]))
        return object_state(mean, spread, last)
    spin = _angular_velocity(record, stretch, mean[3:], spread[3:, 3:], settings)
    return object_state(mean, spread, spin)


def _angular_velocity(
    record: Record,
    stretch: Stretch,
    velocity: NDArray[np.float64],
    covariance: NDArray[np.float64],
    settings: PerceptionSettings,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular velocity of a ball that keeps its speed on a plane, where it rolls; else unknown."""
    lasted = record.times[stretch.end - 1] - record.times[stretch.start]
    if stretch.plane is None or lasted < ROLLING_TIME:
        return unknown_angular_velocity(settings.angular_velocity_deviation)
    return rolling_angular_velocity(
        velocity,
        covariance,
        record.object.shape.bounding_radius,
        stretch.plane.normal,
        settings.angular_velocity_deviation,
    )
