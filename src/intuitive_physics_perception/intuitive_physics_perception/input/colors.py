"""Colours of readings, where the sensor has them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.input.point_cloud import Field
from intuitive_physics_perception.input.raw_data import RawData, checked_bytes

CHANNELS: dict[str, tuple[int, tuple[int, int, int]]] = {
    "rgb8": (3, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "rgba8": (4, (0, 1, 2)),
    "bgra8": (4, (2, 1, 0)),
    "mono8": (1, (0, 0, 0)),
}
"""Bytes of a pixel, and where red, green and blue are in it, by encoding."""

PACKED_FIELDS, PACKED_TYPES = ("rgb", "rgba"), (6, 7)
"""Fields of a cloud that hold 0xAARRGGBB, as UINT32 or as the bits of a FLOAT32."""


def colors_from_image_data(
    data: RawData, *, width: int, height: int, encoding: str, step: int
) -> NDArray[np.uint8]:
    """Return red, green and blue, (height, width, 3), of the raw data of a colour Image message.

    Raises
    ------
    InvalidInputError
        When the encoding is no colour or the data's length does not fit.
    """
    if encoding not in CHANNELS:
        raise InvalidInputError(
            f"image encoding is {encoding!r:.60}; expected a colour image, {', '.join(CHANNELS)}"
        )
    size, order = CHANNELS[encoding]
    view = checked_bytes(
        data,
        width=width,
        height=height,
        pixel_step=size,
        row_step=step,
        # Single bytes have no order.
        is_bigendian=False,
        what="image",
    )
    if not width or not height:
        return np.empty((height, width, 3), np.uint8)
    pixels = np.ndarray((height, width, size), np.uint8, view.data, strides=(step, size, 1))
    return pixels[:, :, order]


def colors_from_cloud_data(
    data: RawData,
    *,
    width: int,
    height: int,
    point_step: int,
    row_step: int,
    fields: Sequence[Field],
) -> NDArray[np.uint8] | None:
    """Return red, green and blue, (height, width, 3), of a PointCloud2 message that can be read.

    None where it has no field `rgb` or `rgba` of packed bytes.
    """
    for field in fields:
        if (
            field.name in PACKED_FIELDS
            and field.datatype in PACKED_TYPES
            and field.count in (0, 1)
            and 0 <= field.offset <= point_step - 4
            and width
            and height
        ):
            packed = np.ndarray(
                (height, width, 4),
                np.uint8,
                memoryview(data).cast("B"),
                offset=field.offset,
                strides=(row_step, point_step, 1),
            )
            # Little-endian: blue comes first.
            return packed[:, :, 2::-1]
    return None
