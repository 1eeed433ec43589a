"""Vectors, points, quaternions, poses and stamps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_float

MakeMessage = Callable[[str], Callable[..., Any]]
"""Gives, by the name of a type, what makes its messages from all their fields by name."""

NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""

LAST_SECOND = 2**31 - 1
"""s; `builtin_interfaces/Time` counts seconds as a signed 32-bit number."""


class StampSeconds(float):
    """The time of a stamp in s that keeps the stamp's nanoseconds; sums of it are plain floats.

    Parameters
    ----------
    seconds : s, to a quarter of a microsecond today, as a double holds it
    nanoseconds : exactly
    """

    __slots__ = ("nanoseconds",)
    nanoseconds: int

    def __new__(cls, seconds: float, nanoseconds: int) -> StampSeconds:
        made = super().__new__(cls, seconds)
        made.nanoseconds = nanoseconds
        return made

    def __getnewargs__(self) -> tuple[float, int]:  # type: ignore[override]
        return float(self), self.nanoseconds


def vector_to_message(vector: ArrayLike, make: MakeMessage) -> Any:
    """Return a vector of shape (3,) as a message."""
    x, y, z = np.asarray(vector, dtype=np.float64).tolist()
    return make("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)


def point_to_message(point: ArrayLike, make: MakeMessage) -> Any:
    """Return a point of shape (3,), m, as a message."""
    x, y, z = np.asarray(point, dtype=np.float64).tolist()
    return make("geometry_msgs/msg/Point")(x=x, y=y, z=z)


def quaternion_to_message(quaternion: ArrayLike, make: MakeMessage) -> Any:
    """Return a quaternion (x, y, z, w), shape (4,), as a message."""
    x, y, z, w = np.asarray(quaternion, dtype=np.float64).tolist()
    return make("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)


def pose_to_message(position: ArrayLike, orientation: ArrayLike, make: MakeMessage) -> Any:
    """Return a pose as a message: position (3,) in m, orientation (4,) as (x, y, z, w)."""
    return make("geometry_msgs/msg/Pose")(
        position=point_to_message(position, make),
        orientation=quaternion_to_message(orientation, make),
    )


def identity_pose(make: MakeMessage) -> Any:
    """Return the pose at the origin, not turned, as a message."""
    return pose_to_message((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), make)


def xyz(message: Any) -> tuple[float, float, float]:
    """Return the numbers of a vector or point; they are not checked."""
    return message.x, message.y, message.z


def xyzw(message: Any) -> tuple[float, float, float, float]:
    """Return the numbers of a quaternion; they are not checked."""
    return message.x, message.y, message.z, message.w


def points_array(messages: Sequence[Any]) -> NDArray[np.float64]:
    """Return points as an array of shape (n, 3); they are not checked."""
    return np.array([xyz(message) for message in messages], dtype=np.float64).reshape(-1, 3)


def stamp_nanoseconds(seconds: float, name: str = "time is") -> int:
    """Return the ns since time zero that the stamp nearest to a time counts.

    Parameters
    ----------
    seconds : s, from 0 to 2038-01-19 as a stamp allows; one of `seconds_from_stamp` gives the ns
        of that stamp
    name : what the time is of, as an error begins

    Raises
    ------
    InvalidInputError
        When no stamp reaches that far.
    """
    if isinstance(seconds, StampSeconds):
        nanoseconds = seconds.nanoseconds
    else:
        nanoseconds = round(finite_float(seconds, "time") * NANOSECONDS)
    if not 0 <= nanoseconds < (LAST_SECOND + 1) * NANOSECONDS:
        raise InvalidInputError(f"{name} {seconds:g} s; expected 0 to {LAST_SECOND} s")
    return nanoseconds


def stamp_from_seconds(seconds: float, make: MakeMessage) -> Any:
    """Return the stamp nearest to a time in s, from 0 to 2038-01-19 as the message allows."""
    sec, nanosec = divmod(stamp_nanoseconds(seconds), NANOSECONDS)
    return make("builtin_interfaces/msg/Time")(sec=sec, nanosec=nanosec)


def seconds_from_stamp(stamp: Any) -> StampSeconds:
    """Return a stamp in s, from which `stamp_from_seconds` makes the same stamp."""
    return StampSeconds(
        stamp.sec + stamp.nanosec / NANOSECONDS, stamp.sec * NANOSECONDS + stamp.nanosec
    )


def header_to_message(stamp: Any, frame_id: str, make: MakeMessage) -> Any:
    """Return a header; no stamp is time zero."""
    if stamp is None:
        stamp = make("builtin_interfaces/msg/Time")(sec=0, nanosec=0)
    return make("std_msgs/msg/Header")(stamp=stamp, frame_id=frame_id)
