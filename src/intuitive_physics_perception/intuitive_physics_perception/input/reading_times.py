"""When each reading of a frame was made: of spinning and scanning LiDARs and rolling shutters."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform

TIME_FIELDS = ("t", "time", "timestamp", "offset_time")
"""Names of the field with the time of a point: of Ouster, of Velodyne, of Hesai, RoboSense and
Livox, and of Livox clouds that are made of its own messages."""

AFTER_STAMP, ABSOLUTE = False, True

TIME_TYPES: dict[int, tuple[str, tuple[tuple[float, bool], ...]]] = {
    6: ("<u4", ((1e-9, AFTER_STAMP),)),
    7: ("<f4", ((1.0, AFTER_STAMP),)),
    8: ("<f8", ((1.0, ABSOLUTE), (1e-9, ABSOLUTE), (1.0, AFTER_STAMP))),
}
"""NumPy's type, and possible units in s and beginnings, by sensor_msgs/PointField datatype: UINT32
in ns (Ouster's t, Livox's offset_time), FLOAT32 in s (Velodyne's time), FLOAT64 in s (Hesai,
RoboSense) or in ns (timestamp of livox_ros_driver2)."""

LONGEST = 1.0
"""Largest time, s, between a frame's stamp and a point of it: a field of other times is none of
these. Set by hand: LiDARs send frames 5 to 50 times a second."""


def times_of_cloud(cloud: Any) -> NDArray[np.float32] | None:
    """Return the time of each point after the stamp, (height, width) s, of a PointCloud2 message
    of which the points have been read.

    Times may be counted from the stamp or be absolute; of the units that a type may have, the one
    holds that gives times near the stamp. None where there is no such field, or its times are of
    another clock than the stamp.
    """
    stamp = cloud.header.stamp.sec + 1e-9 * cloud.header.stamp.nanosec
    for field in cloud.fields:
        if (
            field.name not in TIME_FIELDS
            or field.datatype not in TIME_TYPES
            or field.count not in (0, 1)
            or not (cloud.width and cloud.height)
        ):
            continue
        kind, units = TIME_TYPES[field.datatype]
        if not 0 <= field.offset <= cloud.point_step - np.dtype(kind).itemsize:
            continue
        raw = np.ndarray(
            (cloud.height, cloud.width),
            kind,
            memoryview(cloud.data).cast("B"),
            offset=field.offset,
            strides=(cloud.row_step, cloud.point_step),
        ).astype(np.float64)
        is_known = np.isfinite(raw)
        for unit, is_absolute in units if is_known.any() else ():
            offsets = np.where(is_known, unit * raw - (stamp if is_absolute else 0.0), 0.0)
            if np.abs(offsets).max() < LONGEST:
                return offsets.astype(np.float32)
    return None


def times_of_rows(height: int, width: int, row_time: float) -> NDArray[np.float32]:
    """Return the time of each pixel after that of the first row, (height, width) s.

    `row_time` from row to row, s; below zero: the shutter begins at the last row.
    """
    rows = np.arange(height, dtype=np.float32) * np.float32(row_time)
    return np.broadcast_to((rows - min(rows[-1], 0.0))[:, None], (height, width))


def reading_span(
    points: NDArray[np.float32], offsets: NDArray[np.float32] | None
) -> tuple[float, float]:
    """Return the times of a frame's first and last readings after its stamp, s; zeros without any.

    `points` (height, width, 3) m, NaN where nothing was read; `offsets` (height, width) s, time of
    each reading after the stamp; None: all are of the stamp's.

    Raises
    ------
    InvalidInputError
        When these do not fit together.
    """
    if offsets is None:
        return 0.0, 0.0
    if offsets.shape != points.shape[:2]:
        raise InvalidInputError(
            f"times of readings are {offsets.shape} and points {points.shape}; expected one for "
            "each point"
        )
    read = offsets[np.isfinite(points[..., 2])]
    return (float(read.min()), float(read.max())) if read.size else (0.0, 0.0)


def as_of_start(
    points: NDArray[np.float32],
    offsets: NDArray[np.float32],
    times: NDArray[np.float64],
    poses: Sequence[RigidTransform],
) -> NDArray[np.float32]:
    """Return a frame of a sensor that moved as it would have read it at one time.

    Between two known poses a point moves straight from where the one would have it to where the
    other would; over 10 ms at 1 rad/s that is 0.1 mm off at 10 m.

    Parameters
    ----------
    points : (height, width, 3) m in the sensor's frame at the time of each reading
    offsets : (height, width) s, time of each
    times : (n,) s, increasing, from the first reading to the last
    poses : n of the sensor, in a frame that stands still, at these times

    Returns
    -------
    (height, width, 3) m in the sensor's frame at the first of the times
    """
    ways = [poses[0].inverse.after(pose) for pose in poses]
    flat, when = points.reshape(-1, 3), offsets.reshape(-1)
    part = np.clip(np.searchsorted(times, when, side="right") - 1, 0, len(times) - 2)
    moved = np.empty_like(flat)
    for k, (before, after) in enumerate(pairwise(ways)):
        chosen = part == k
        weight = ((when[chosen] - times[k]) / (times[k + 1] - times[k]))[:, None]
        at = flat[chosen].astype(np.float64)
        moved[chosen] = (1.0 - weight) * before.points(at) + weight * after.points(at)
    return moved.reshape(points.shape)
