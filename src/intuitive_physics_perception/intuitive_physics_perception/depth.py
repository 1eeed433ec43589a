"""From raw depth images and raw PointCloud2 data to points in the sensor's frame.

A *frame of points* is a C-contiguous float32 array of shape (height, width, 3) in m in the
sensor's frame, the sensor at the origin; a reading that is missing is NaN in all three. An
unorganised cloud has height 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array, positive_float

MILLIMETRES = 0.001

FIELD_TYPES: dict[int, np.dtype[Any]] = {7: np.dtype("<f4"), 8: np.dtype("<f8")}
"""sensor_msgs/PointField datatypes a coordinate may have: FLOAT32 and FLOAT64."""

IMAGE_TYPES: dict[str, np.dtype[Any]] = {
    "16UC1": np.dtype("<u2"),
    "mono16": np.dtype("<u2"),
    "32FC1": np.dtype("<f4"),
}
"""Encodings of a depth image (REP 118): uint16 in millimetres, float32 in metres."""

DISTORTION_TERMS = {"plumb_bob": (0, 4, 5), "rational_polynomial": (0, 8)}
UNDISTORTION_STEPS = 20
MAX_PIXELS = 50_000_000


@dataclass(frozen=True)
class Field:
    """One entry of a PointCloud2's field description, named as in the message."""

    name: str
    offset: int
    datatype: int
    count: int


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
        When the camera is not calibrated (focal length zero) or the model is another one.
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

    def rays(self) -> NDArray[np.float32]:
        """Return (height, width, 3): where each pixel looks, scaled to z = 1."""
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        y = (v - self.matrix[1, 2]) / self.matrix[1, 1]
        x = (u - self.matrix[0, 2] - self.matrix[0, 1] * y) / self.matrix[0, 0]
        if self.distortion.size:
            x, y = _undistorted(x, y, self.distortion)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        return np.ascontiguousarray(rays, dtype=np.float32)


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
    if depth.shape != rays.shape[:2]:
        raise InvalidInputError(
            f"depth image has {depth.shape[::-1]} pixels (width, height) and the camera "
            f"{rays.shape[1::-1]}; expected the same size"
        )
    if depth.dtype == np.uint16:
        return _scaled_rays(np.ascontiguousarray(depth), rays, MILLIMETRES)
    if depth.dtype == np.float32:
        return _scaled_rays(np.ascontiguousarray(depth), rays, 1.0)
    raise InvalidInputError(f"depth image is of {depth.dtype}; expected uint16 (mm) or float32 (m)")


def depth_from_image_data(
    data: bytes | memoryview | NDArray[np.uint8],
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
            f"image encoding is {encoding!r}; expected a depth image, {', '.join(IMAGE_TYPES)}"
        )
    dtype = IMAGE_TYPES[encoding]
    _check_layout(
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
    return np.ndarray((height, width), dtype, _buffer(data), strides=(step, dtype.itemsize))


def points_from_cloud_data(
    data: bytes | memoryview | NDArray[np.uint8],
    *,
    width: int,
    height: int,
    point_step: int,
    row_step: int,
    fields: Sequence[Field],
    is_bigendian: bool,
) -> NDArray[np.float32]:
    """Return the frame of points, (height, width, 3), of the raw data of a PointCloud2 message.

    Fields other than x, y, z are skipped; x, y, z may come in any order, each float32 or float64.
    A point with a coordinate that is not finite is NaN in all three.

    Raises
    ------
    InvalidInputError
        When x, y or z is missing, of another type or outside the point, when the data is
        big-endian, or when its length does not fit width, height and steps.
    """
    coordinates = _coordinates(fields, point_step)
    _check_layout(
        data,
        width=width,
        height=height,
        pixel_step=point_step,
        row_step=row_step,
        is_bigendian=is_bigendian,
        what="cloud",
    )
    points = np.empty((height, width, 3), dtype=np.float32)
    if not points.size:
        return points
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, field in enumerate(coordinates):
            points[:, :, axis] = np.ndarray(
                (height, width),
                FIELD_TYPES[field.datatype],
                _buffer(data),
                offset=field.offset,
                strides=(row_step, point_step),
            )
    _blank_unreadable(points.reshape(-1, 3))
    return points


def _coordinates(fields: Sequence[Field], point_step: int) -> list[Field]:
    """Return the fields of x, y and z after checking that they can be read."""
    known = {field.name: field for field in fields}
    missing = [name for name in "xyz" if name not in known]
    if missing:
        raise InvalidInputError(
            f"cloud has the fields {sorted(known)}; expected x, y and z "
            f"({', '.join(missing)} missing)"
        )
    for name in "xyz":
        field = known[name]
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
    return [known[name] for name in "xyz"]


def _check_layout(
    data: Any,
    *,
    width: int,
    height: int,
    pixel_step: int,
    row_step: int,
    is_bigendian: bool,
    what: str,
) -> None:
    if width < 0 or height < 0:
        raise InvalidInputError(f"{what} has {width} x {height} pixels; expected no negative size")
    if is_bigendian:
        raise InvalidInputError(
            f"{what} is big-endian; expected little-endian data: convert it where it is published"
        )
    if row_step < width * pixel_step:
        raise InvalidInputError(
            f"{what} has rows of {row_step} bytes; expected at least {width * pixel_step} "
            f"for {width} times {pixel_step} bytes"
        )
    if len(data) < height * row_step:
        raise InvalidInputError(
            f"{what} has {len(data)} bytes of data; expected {height * row_step} for {height} "
            f"rows of {row_step} bytes: it is truncated"
        )


def _buffer(data: Any) -> memoryview:
    return memoryview(data).cast("B")


def _undistorted(
    x_distorted: NDArray[np.float64],
    y_distorted: NDArray[np.float64],
    distortion: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Invert the Brown-Conrady model by fixed-point iteration; inputs and outputs at z = 1."""
    k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(distortion, (0, 8 - distortion.size))
    x, y = x_distorted, y_distorted
    for _ in range(UNDISTORTION_STEPS):
        r2 = x * x + y * y
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        dx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        dy = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        x, y = (x_distorted - dx) / radial, (y_distorted - dy) / radial
    return x, y


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
            points[v, u, 2] = z
    return points


@njit(nogil=True, cache=True, error_model="numpy")
def _blank_unreadable(points: Any) -> None:
    for i in range(points.shape[0]):
        if not np.isfinite(points[i, 0] + points[i, 1] + points[i, 2]):
            points[i, :] = np.nan
