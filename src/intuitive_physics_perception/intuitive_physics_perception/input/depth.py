"""From raw depth images to points in the sensor's frame.

A *frame of points* is a C-contiguous float32 array of shape (height, width, 3) in m in the
sensor's frame, the sensor at the origin; a reading that is missing is NaN in all three. An
unorganised cloud has height 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.kernels import allocating_entry
from intuitive_physics_perception.input.raw_data import checked_bytes

MILLIMETRES = 0.001
"""Metres in the unit of a uint16 depth image (REP 118)."""

IMAGE_TYPES: dict[str, np.dtype[Any]] = {
    "16UC1": np.dtype("<u2"),
    "mono16": np.dtype("<u2"),
    "32FC1": np.dtype("<f4"),
}
"""Encodings of a depth image (REP 118): uint16 in millimetres, float32 in metres."""


def points_from_depth(depth: NDArray[Any], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the frame of points (height, width, 3) of a depth image.

    Parameters
    ----------
    depth : (height, width) depth along the optical axis, uint16 in mm or float32 in m; zero,
        negative or not finite means that the reading is missing
    rays : (height, width, 3) of `Intrinsics.rays`

    Raises
    ------
    InvalidInputError
        When the image and the camera differ in size, or the type is another one.
    """
    check_size(depth.shape[1], depth.shape[0], rays.shape[1], rays.shape[0])
    if depth.dtype not in (np.uint16, np.float32):
        raise InvalidInputError(
            f"depth image is of {depth.dtype}; expected uint16 (mm) or float32 (m)"
        )
    scale = MILLIMETRES if depth.dtype == np.uint16 else 1.0
    image = np.ascontiguousarray(depth).view()
    # To the compiler an array that cannot be written to is another type.
    image.flags.writeable = False
    return _scaled_rays(image, rays, scale)


def check_size(width: int, height: int, camera_width: int, camera_height: int) -> None:
    """Refuse an image that is not of its camera's size.

    Raises
    ------
    InvalidInputError
        When they differ.
    """
    if (width, height) != (camera_width, camera_height):
        raise InvalidInputError(
            f"depth image has {(width, height)} pixels (width, height) and the camera "
            f"{(camera_width, camera_height)}; expected the same size"
        )


def depth_of_image(image: Any) -> NDArray[Any]:
    """Return a (height, width) view of the raw data of a depth Image message.

    Raises
    ------
    InvalidInputError
        When the encoding is no depth, the data is big-endian, or its length does not fit.
    """
    if image.encoding not in IMAGE_TYPES:
        raise InvalidInputError(
            f"image encoding is {image.encoding!r:.60}; expected a depth image, "
            f"{', '.join(IMAGE_TYPES)}"
        )
    dtype, step = IMAGE_TYPES[image.encoding], image.step
    view = checked_bytes(
        image,
        pixel_step=dtype.itemsize,
        row_step=step,
        what="image",
        is_bigendian=bool(image.is_bigendian),
    )
    shape = image.height, image.width
    if not all(shape):
        return np.empty(shape, dtype)
    return np.ndarray(shape, dtype, view.data, strides=(step, dtype.itemsize))


@allocating_entry
def _scaled_rays(depth: Any, rays: Any, scale: Any) -> Any:
    height, width = depth.shape
    points = np.empty((height, width, 3), dtype=np.float32)
    for v in range(height):
        for u in range(width):
            z = np.float32(depth[v, u] * scale)
            if not (z > 0.0 and z < np.inf):
                z = np.float32(np.nan)
            points[v, u, 0] = rays[v, u, 0] * z
            points[v, u, 1] = rays[v, u, 1] * z
            points[v, u, 2] = rays[v, u, 2] * z
    return points
