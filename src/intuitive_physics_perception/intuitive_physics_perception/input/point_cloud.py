"""From the raw data of PointCloud2 messages to frames of points (see `depth`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.kernels import entry
from intuitive_physics_perception.input.raw_data import checked_bytes

FIELD_TYPES: dict[int, np.dtype[Any]] = {7: np.dtype("<f4"), 8: np.dtype("<f8")}
"""sensor_msgs/PointField datatypes a coordinate may have: FLOAT32 and FLOAT64."""


def points_of_cloud(cloud: Any) -> NDArray[np.float32]:
    """Return the frame of points, (height, width, 3), of a PointCloud2 message.

    Fields other than x, y, z are skipped; x, y, z may come in any order, each float32 or float64. A
    point with a coordinate that is not finite, or with zeros in all three as some drivers write
    where nothing was read, is NaN in all three.

    Raises
    ------
    InvalidInputError
        When x, y or z is missing, of another type or outside the point, when the data is
        big-endian, or when its length does not fit width, height and steps.
    """
    row_step, point_step = cloud.row_step, cloud.point_step
    coordinates = _coordinates(cloud.fields, point_step)
    view = checked_bytes(
        cloud,
        pixel_step=point_step,
        row_step=row_step,
        what="cloud",
        is_bigendian=bool(cloud.is_bigendian),
    )
    points = np.empty((cloud.height, cloud.width, 3), dtype=np.float32)
    if not points.size:
        return points
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, field in enumerate(coordinates):
            points[:, :, axis] = np.ndarray(
                points.shape[:2],
                FIELD_TYPES[field.datatype],
                view.data,
                offset=field.offset,
                strides=(row_step, point_step),
            )
    _blank_unreadable(points.reshape(-1, 3))
    return points


def _coordinates(fields: Sequence[Any], point_step: int) -> list[Any]:
    """Return the fields of x, y and z after checking that they can be read."""
    by_name = {field.name: field for field in fields}
    missing = [name for name in "xyz" if name not in by_name]
    if missing:
        raise InvalidInputError(
            f"cloud has the fields {sorted(by_name)!s:.200}; expected x, y and z "
            f"({', '.join(missing)} missing)"
        )
    for name in "xyz":
        field = by_name[name]
        if field.datatype not in FIELD_TYPES or field.count not in (0, 1):
            raise InvalidInputError(
                f"field {name} of the cloud has datatype {field.datatype} and count {field.count}; "
                "expected one FLOAT32 (7) or FLOAT64 (8)"
            )
        end = field.offset + FIELD_TYPES[field.datatype].itemsize
        if field.offset < 0 or end > point_step:
            raise InvalidInputError(
                f"field {name} of the cloud lies at bytes {field.offset} to {end} of a point; "
                f"expected them within its {point_step} bytes"
            )
    return [by_name[name] for name in "xyz"]


@entry
def _blank_unreadable(points: Any) -> None:
    """Make points (n, 3) NaN that have a coordinate which is not finite, or zeros in all three."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not np.isfinite(x + y + z) or x == y == z == 0.0:
            points[i, :] = np.nan
