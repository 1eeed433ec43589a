"""From raw depth images to points in the sensor's frame.

A *frame of points* is a C-contiguous float32 array of shape (height, width, 3) in m in the
sensor's frame, the sensor at the origin; a reading that is missing is NaN in all three. An
unorganised cloud has height 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array, positive_float
from intuitive_physics_perception.input.raw_data import MAX_PIXELS, RawData, checked_bytes
from intuitive_physics_perception.input.undistortion import (
    DISTORTION_TERMS,
    check_invertible,
    undistorted,
)

MILLIMETRES = 0.001
CHECKED = 24
"""Rows and columns of points at which a distortion is tried out."""

IMAGE_TYPES: dict[str, np.dtype[Any]] = {
    "16UC1": np.dtype("<u2"),
    "mono16": np.dtype("<u2"),
    "32FC1": np.dtype("<f4"),
}
"""Encodings of a depth image (REP 118): uint16 in millimetres, float32 in metres."""


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A pinhole camera.

    Parameters
    ----------
    width, height : pixels
    matrix : (3, 3) or (9,) camera matrix K, in pixels
    distortion : coefficients in OpenCV's order; empty means none
    distortion_model : "plumb_bob" or "rational_polynomial"

    Raises
    ------
    InvalidInputError
        When the camera is not calibrated (focal length zero), the model is another one or the
        distortion cannot be inverted for more than a tenth of the image.
    """

    width: int
    height: int
    matrix: NDArray[np.float64]
    distortion: NDArray[np.float64]
    distortion_model: str

    def __init__(
        self,
        width: int,
        height: int,
        matrix: ArrayLike,
        distortion: ArrayLike = (),
        distortion_model: str = "plumb_bob",
    ) -> None:
        if width <= 0 or height <= 0 or width * height > MAX_PIXELS:
            raise InvalidInputError(
                f"camera has {width} x {height} pixels; expected both above 0 and at most "
                f"{MAX_PIXELS:,} in all"
            )
        k = finite_array(np.ravel(np.asarray(matrix)), "camera matrix", (9,)).reshape(3, 3)
        positive_float(k[0, 0], "focal length fx of the camera matrix")
        positive_float(k[1, 1], "focal length fy of the camera matrix")
        d = finite_array(distortion, "distortion", (None,))
        if d.any() and d.size not in DISTORTION_TERMS.get(distortion_model, ()):
            raise InvalidInputError(
                f"distortion is {distortion_model!r} with {d.size} terms; expected plumb_bob with "
                "4 or 5, rational_polynomial with 8, or an image without distortion"
            )
        object.__setattr__(self, "width", int(width))
        object.__setattr__(self, "height", int(height))
        object.__setattr__(self, "matrix", k)
        object.__setattr__(self, "distortion", d if d.any() else np.zeros(0))
        object.__setattr__(self, "distortion_model", distortion_model)
        if self.distortion.size:
            u, v = np.meshgrid(
                np.linspace(0, width - 1, CHECKED), np.linspace(0, height - 1, CHECKED)
            )
            check_invertible(*self._at_unit_depth(u, v), self.distortion)

    def part(
        self, *, left: int = 0, top: int = 0, width: int, height: int, binning: int = 1
    ) -> Intrinsics:
        """Return the camera of a rectangle of the image whose pixels are then joined.

        Parameters
        ----------
        left, top, width, height : of the rectangle, in pixels of the whole image
        binning : pixels along x, and along y, that are joined to one
        """
        # In pixels of the whole image a joined pixel u has its centre at left + b u + (b - 1) / 2.
        shift = np.array([left, top]) + (binning - 1) / 2.0
        matrix = self.matrix.copy()
        matrix[:2, 2] -= shift
        matrix[:2] /= binning
        return Intrinsics(
            width // binning, height // binning, matrix, self.distortion, self.distortion_model
        )

    def rays(self) -> NDArray[np.float32]:
        """Return (height, width, 3): where each pixel looks, scaled to z = 1.

        NaN in all three where the distortion cannot be inverted.
        """
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        x, y = self._at_unit_depth(u, v)
        if self.distortion.size:
            x, y = undistorted(x, y, self.distortion)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        rays[np.isnan(x)] = np.nan
        return np.ascontiguousarray(rays, dtype=np.float32)

    def _at_unit_depth(
        self, u: NDArray[Any], v: NDArray[Any]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the x and y of pixels on the plane z = 1, distorted as in the image."""
        y = (v - self.matrix[1, 2]) / self.matrix[1, 1]
        return (u - self.matrix[0, 2] - self.matrix[0, 1] * y) / self.matrix[0, 0], y


def points_from_depth(depth: NDArray[Any], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the frame of points of a depth image.

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


def depth_from_image_data(
    data: RawData,
    *,
    width: int,
    height: int,
    encoding: str,
    step: int,
    is_bigendian: bool,
) -> NDArray[Any]:
    """Return a (height, width) view of the raw data of a depth Image message.

    Raises
    ------
    InvalidInputError
        When the encoding is no depth, the data is big-endian, or its length does not fit.
    """
    if encoding not in IMAGE_TYPES:
        raise InvalidInputError(
            f"image encoding is {encoding!r:.60}; expected a depth image, {', '.join(IMAGE_TYPES)}"
        )
    dtype = IMAGE_TYPES[encoding]
    view = checked_bytes(
        data,
        width=width,
        height=height,
        pixel_step=dtype.itemsize,
        row_step=step,
        is_bigendian=is_bigendian,
        what="image",
    )
    if not width or not height:
        return np.empty((height, width), dtype)
    return np.ndarray((height, width), dtype, view.data, strides=(step, dtype.itemsize))


@njit(nogil=True, cache=True, error_model="numpy")
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
