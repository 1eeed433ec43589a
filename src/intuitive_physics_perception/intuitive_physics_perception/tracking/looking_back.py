"""Where a followed ball must have been earlier, by what was seen of it later."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.detections import Detection
from intuitive_physics_perception.tracking.motion_fits import (
    HAND_ACCELERATION,
    MIN_POINTS,
    fitted_motion,
    free_evidence,
    grown_count,
    shows_acceleration,
)
from intuitive_physics_perception.tracking.track import path_of

FLIGHT_TIME = 0.105
"""Time, s, of a flight from which it is extrapolated: four frames at 30 Hz. In a longer one a ball
is more likely to bounce."""

SHORTEST_BASE = 0.002
"""Time, s, that two places must be apart to show a velocity: several sensors may see a ball at one
time. Set by hand: of one camera, frames are farther apart up to 500 Hz."""


@dataclass(frozen=True, eq=False)
class EarlierPlace:
    """Where a ball must have been.

    Parameters
    ----------
    place : (3,) m, of its centre
    velocity : (3,) m/s
    bend : m, standard deviation of each component of the place by unknown accelerations since
    spread : (3, 3) m², covariance of the place, that part included
    """

    place: NDArray[np.float64]
    velocity: NDArray[np.float64]
    bend: float
    spread: NDArray[np.float64]


def earlier_place(
    later: Sequence[tuple[float, Detection]], time: float, gravity: NDArray[np.float64]
) -> EarlierPlace | None:
    """Return where a ball was before its next detections; None where these show no velocity.

    If they are those of a flight, it flew before, too; else it moved straight. The spread has what
    the acceleration by a hand may change of that.

    `later`: times, s, and detections, oldest first; `time` in s, before them; `gravity` (3,) m/s².
    """
    return _before_flight(later, time, gravity) or _on_a_line(later, time)


def _before_flight(
    later: Sequence[tuple[float, Detection]], time: float, gravity: NDArray[np.float64]
) -> EarlierPlace | None:
    """The place by all detections of `FLIGHT_TIME`; None where they are not clearly of a flight.

    An acceleration σ of a hand until the first of them at t₁ moves the place by σ (t₁ - t)² / 2.
    """
    path = path_of([pair for pair in later if pair[0] - later[0][0] <= FLIGHT_TIME])
    count, _ = grown_count(path, gravity) if len(path.times) >= MIN_POINTS else (0, None)
    flies = 0 < count == len(path.times) and shows_acceleration(path)
    if not flies or free_evidence(path, gravity) < 0.0:
        return None
    motion, covariance = fitted_motion(path, gravity)
    since = time - float(path.times[0])
    onward = np.hstack([np.eye(3), since * np.eye(3)])
    bend = 0.5 * HAND_ACCELERATION * since**2
    return EarlierPlace(
        onward @ motion + 0.5 * since**2 * gravity,
        motion[3:] + since * gravity,
        bend,
        onward @ covariance @ onward.T + bend**2 * np.eye(3),
    )


def _on_a_line(later: Sequence[tuple[float, Detection]], time: float) -> EarlierPlace | None:
    """The place on the straight line through the next two detections, at t₁ and t₂.

    An acceleration σ, of a hand or gravity, bends that by σ (t₁ - t) (t₂ - t) / 2.
    """
    apart = [pair for pair in later if pair[0] - later[0][0] > SHORTEST_BASE]
    if not apart:
        return None
    path = path_of([later[0], apart[0]])
    first, second = path.times
    velocity = (path.places[1] - path.places[0]) / (second - first)
    part = (time - first) / (second - first)
    bend = 0.5 * HAND_ACCELERATION * float((first - time) * (second - time))
    spread = (1.0 - part) ** 2 * path.noise[0] + part**2 * path.noise[1]
    return EarlierPlace(
        path.places[0] + (time - first) * velocity, velocity, bend, spread + bend**2 * np.eye(3)
    )
