"""One object as several kinds: a fast ball that resembles a capsule, a capsule seen end-on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.shapes import Capsule
from intuitive_physics_perception.detection.detections import (
    DetectedSolid,
    DetectedSphere,
    Detection,
    kind_of,
)
from intuitive_physics_perception.tracking.attitude import Attitude
from intuitive_physics_perception.tracking.motion import GATE, POSITION, RADIUS
from intuitive_physics_perception.tracking.track import Track, innovation_of

RADIUS_GATE = 4.0
"""Standard deviations by which a radius may differ within one track."""

RADIUS_SLACK = 0.003
"""Difference of radii, m, that is allowed beyond `RADIUS_GATE`."""

ALONG = 0.35
"""Sine of the angle between a capsule's axis and the way between two frames up to which it may be a
swept ball. Set by hand: the axis of a short capsule is known to 10°, and gravity bends the way."""

LENGTH_SLACK = 1.3
"""Part of the way between two frames that a sweep may have. Set by hand: none is longer than the
way, but both are measured, and the way is from where the filter has the ball."""

UNKNOWN_TURN = np.pi
"""Standard deviation of a rotation that a detection does not show, rad."""


def as_part_of(track: Track, detection: Detection, doubted: float) -> Detection | None:
    """Return what a detection shows of a followed object; None where it is of another one.

    `doubted` in s: for how long frames must show a capsule in place of a confirmed ball until it
    is one. Till then it is the ball, somewhere on its axis: at a far range noise gives a ball a
    side now and then.

    Where the returned detection is of another kind than the track, the object turned out to be of
    that kind. A capsule where it is expected, along the way since it was last seen, and no longer
    than that, is a ball swept by the exposure. A sphere in a capsule is that capsule seen end-on,
    and says nothing of the place along its axis.
    """
    axis = _axis_of(detection)
    if axis is None and track.kind == kind_of(detection):
        return detection
    if not _are_of_one_radius(track, detection):
        # A capsule's radius does not decide which capsule it is.
        return detection if track.kind == kind_of(detection) else None
    way = detection.center - track.steps[-1].mean[POSITION]
    if axis is not None and track.kind in ("sphere", "capsule"):
        is_swept = _may_be_swept(way, axis) and _was_always_swept(track, way)
        if is_swept and _is_expected_on(track, detection, axis):
            return _swept(detection, axis)
        if track.kind == "capsule":
            return detection
        if _is_in(track.mean[POSITION], detection):
            is_doubted = track.confirmed and track.time - _long_since(track) < doubted
            return _swept(detection, axis) if is_doubted else detection
    if isinstance(detection, DetectedSphere) and track.attitude is not None:
        if _was_always_swept(track, way):
            return detection
        if _is_inside(detection.center, track.mean[POSITION], track.attitude):
            return _end_on(detection, track.attitude)
    return None


def _long_since(track: Track) -> float:
    """Time in s since when all that was seen of a ball was as long as if swept; now if nothing."""
    since = track.time
    for step in reversed(track.steps):
        if isinstance(step.detection, DetectedSphere):
            if not step.detection.sweep.any():
                break
            since = step.time
    return since


def _is_in(place: NDArray[np.float64], detection: Detection) -> bool:
    return isinstance(detection, DetectedSolid) and _is_inside(
        place, detection.center, Attitude.of(detection, 0.0)
    )


def _axis_of(detection: Detection) -> NDArray[np.float64] | None:
    """Vector (3,) m from one end of a capsule's cylinder to the other; None of other kinds."""
    if isinstance(detection, DetectedSolid) and isinstance(detection.shape, Capsule):
        return np.asarray(detection.shape.length * detection.rotation[:, 2])
    return None


def _are_of_one_radius(track: Track, detection: Detection) -> bool:
    radius, variance = float(track.mean[RADIUS]), float(track.covariance[RADIUS, RADIUS])
    if track.attitude is not None:
        if not isinstance(track.attitude.shape, Capsule):
            return False
        radius, variance = track.attitude.shape.radius, 0.0
    deviation = np.sqrt(variance + detection.covariance[3, 3])
    return bool(abs(detection.radius - radius) < RADIUS_GATE * deviation + RADIUS_SLACK)


def _may_be_swept(way: NDArray[np.float64], axis: NDArray[np.float64]) -> bool:
    """Whether a capsule's axis (3,) m may be what a ball goes during an exposure that goes a way
    (3,) m between two frames."""
    gone, length = float(np.linalg.norm(way)), float(np.linalg.norm(axis))
    sine = float(np.linalg.norm(np.cross(way, axis))) / max(gone * length, 1e-12)
    return sine < ALONG and length < LENGTH_SLACK * gone


def _is_expected_on(track: Track, detection: Detection, axis: NDArray[np.float64]) -> bool:
    """Whether a track is expected somewhere on the axis (3,) m of a capsule."""
    innovation, spread = innovation_of(track, detection)
    along = float(np.clip(innovation[:3] @ axis / (axis @ axis), -0.5, 0.5))
    innovation[:3] -= along * axis
    return bool(innovation @ np.linalg.solve(spread, innovation) < GATE)


def _was_always_swept(track: Track, way: NDArray[np.float64]) -> bool:
    """Whether a ball that moves as the track does now may be all that was seen of it."""
    if track.kind == "sphere":
        return True
    axes = (_axis_of(step.detection) for step in track.steps if step.detection is not None)
    return all(axis is None or _may_be_swept(way, axis) for axis in axes)


def _swept(detection: Detection, axis: NDArray[np.float64]) -> DetectedSphere:
    """The ball that a capsule is, somewhere on its axis (3,) m."""
    covariance = detection.covariance
    # Where in its sweep the stamp finds it is unknown: the variance of a uniform density.
    covariance[:3, :3] += np.outer(axis, axis) / 12.0
    return DetectedSphere(
        detection.center,
        detection.radius,
        covariance,
        detection.points,
        float(np.linalg.norm(detection.center)),
        detection.color,
        detection.systematic,
        axis,
    )


def _is_inside(place: NDArray[np.float64], center: NDArray[np.float64], attitude: Attitude) -> bool:
    """Whether a place (3,) is in a capsule about `center` (3,) m; False of other shapes.

    No other object has its centre there, as two share no space.
    """
    if not isinstance(attitude.shape, Capsule):
        return False
    away, axis, half = place - center, attitude.rotation[:, 2], 0.5 * attitude.shape.length
    off = away - float(np.clip(away @ axis, -half, half)) * axis
    return bool(np.linalg.norm(off) < attitude.shape.radius)


def _end_on(sphere: DetectedSphere, attitude: Attitude) -> DetectedSolid | None:
    """A capsule of which one end is seen, somewhere on its axis."""
    if not isinstance(attitude.shape, Capsule):
        return None
    axis = attitude.shape.length * attitude.rotation[:, 2]
    covariance = sphere.covariance[:3, :3] + np.outer(axis, axis) / 12.0
    return DetectedSolid(
        attitude.shape,
        sphere.center,
        attitude.rotation,
        covariance,
        UNKNOWN_TURN**2 * np.eye(3),
        float(sphere.covariance[3, 3]),
        sphere.points,
        1.0,
        sphere.color,
    )
