"""Colours of readings, where the sensor has them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.input.raw_data import checked_bytes

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


def colors_of_image(image: Any) -> NDArray[np.uint8]:
    """Return red, green and blue, (height, width, 3), of a colour Image message.

    Raises
    ------
    InvalidInputError
        When the encoding is no colour or the data's length does not fit.
    """
    if image.encoding not in CHANNELS:
        raise InvalidInputError(
            f"image encoding is {image.encoding!r:.60}; expected a colour image, "
            f"{', '.join(CHANNELS)}"
        )
    size, order = CHANNELS[image.encoding]
    # Single bytes have no order.
    view = checked_bytes(image, pixel_step=size, row_step=image.step, what="image")
    width, height = image.width, image.height
    if not width or not height:
        return np.empty((height, width, 3), np.uint8)
    pixels = np.ndarray((height, width, size), np.uint8, view.data, strides=(image.step, size, 1))
    return pixels[:, :, order]


def colors_of_cloud(cloud: Any) -> NDArray[np.uint8] | None:
    """Return red, green and blue, (height, width, 3), of a PointCloud2 message of which the points
    have been read.

    None where it has no field `rgb` or `rgba` of packed bytes.
    """
    for field in cloud.fields:
        if (
            field.name in PACKED_FIELDS
            and field.datatype in PACKED_TYPES
            and field.count in (0, 1)
            and 0 <= field.offset <= cloud.point_step - 4
            and cloud.width
            and cloud.height
        ):
            packed = np.ndarray(
                (cloud.height, cloud.width, 4),
                np.uint8,
                memoryview(cloud.data).cast("B"),
                offset=field.offset,
                strides=(cloud.row_step, cloud.point_step, 1),
            )
            # Little-endian: blue comes first.
            return packed[:, :, 2::-1]
    return None
