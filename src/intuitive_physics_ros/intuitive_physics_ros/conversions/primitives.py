"""Vectors, points, quaternions, poses and stamps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_float

NANOSECONDS = 1_000_000_000
"""In a second."""
LAST_SECOND = 2**31 - 1
"""s; `builtin_interfaces/Time` counts seconds as a signed 32-bit number."""


def vector_to_message(vector: ArrayLike) -> Vector3:
    """Return a vector of shape (3,) as a message."""
    x, y, z = np.asarray(vector, dtype=np.float64).tolist()
    return Vector3(x=x, y=y, z=z)


def point_to_message(point: ArrayLike) -> Point:
    """Return a point of shape (3,), m, as a message."""
    x, y, z = np.asarray(point, dtype=np.float64).tolist()
    return Point(x=x, y=y, z=z)


def quaternion_to_message(quaternion: ArrayLike) -> Quaternion:
    """Return a quaternion (x, y, z, w), shape (4,), as a message."""
    x, y, z, w = np.asarray(quaternion, dtype=np.float64).tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def pose_to_message(position: ArrayLike, orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    """Return a pose as a message: position (3,) in m, orientation (4,) as (x, y, z, w)."""
    return Pose(position=point_to_message(position), orientation=quaternion_to_message(orientation))


def rotated(quaternion: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a vector (3,) turned by a unit quaternion (x, y, z, w)."""
    axis, w = quaternion[:3], quaternion[3]
    # v' = v + 2 w (q × v) + 2 q × (q × v)
    across = np.cross(axis, vector)
    return vector + 2.0 * (w * across + np.cross(axis, across))


def xyz(message: Vector3 | Point) -> tuple[float, float, float]:
    """Return the numbers of a vector or point; they are not checked."""
    return message.x, message.y, message.z


def xyzw(message: Quaternion) -> tuple[float, float, float, float]:
    """Return the numbers of a quaternion; they are not checked."""
    return message.x, message.y, message.z, message.w


def points_array(messages: Sequence[Point]) -> NDArray[np.float64]:
    """Return points as an array of shape (n, 3); they are not checked."""
    return np.array([xyz(message) for message in messages], dtype=np.float64).reshape(-1, 3)


def stamp_from_seconds(seconds: float) -> Time:
    """Return the stamp nearest to a time in s, from 0 to 2038-01-19 as the message allows."""
    nanoseconds = round(finite_float(seconds, "time") * NANOSECONDS)
    if not 0 <= nanoseconds <= LAST_SECOND * NANOSECONDS:
        raise InvalidInputError(f"time is {seconds:g} s; expected 0 to {LAST_SECOND} s")
    return Time(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def seconds_from_stamp(stamp: Time) -> float:
    """Return a stamp in s: to a quarter of a microsecond today, as a double holds it."""
    return stamp.sec + stamp.nanosec / NANOSECONDS
