"""A pinhole camera: the ray of each pixel, lens distortion removed.

Lens distortion is Brown-Conrady with a rational radial part, as in OpenCV.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array, positive_float, set_fields
from intuitive_physics_perception.input.raw_data import MAX_PIXELS

DISTORTION_TERMS = {"plumb_bob": (4, 5), "rational_polynomial": (8,)}
"""Distortion models of sensor_msgs/CameraInfo that are known, with how many terms they have."""

STEPS = 60
"""Fixed-point iterations at most: numerical."""

CONVERGED = 1e-7
"""Error at z = 1 below which an iteration has converged: numerical, far below a pixel."""

MAX_LOST = 0.1
"""Part of the image in which a distortion may lack an inverse, at the rim of wide lenses. Set by
hand."""


CHECKED = 24
"""Rows and columns of points at which a distortion is checked."""


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A pinhole camera.

    Parameters
    ----------
    width, height : pixels
    matrix : (3, 3) or (9,) camera matrix K, in pixels
    distortion : (n,) coefficients in OpenCV's order; empty means none
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
        set_fields(
            self,
            width=int(width),
            height=int(height),
            matrix=k,
            distortion=d if d.any() else np.zeros(0),
            distortion_model=distortion_model,
        )
        if self.distortion.size:
            u, v = np.meshgrid(
                np.linspace(0, width - 1, CHECKED), np.linspace(0, height - 1, CHECKED)
            )
            _check_invertible(*self._at_unit_depth(u, v), self.distortion)

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
        """Return the ray of each pixel, (height, width, 3), scaled to z = 1.

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


def _check_invertible(x: NDArray[np.float64], y: NDArray[np.float64], terms: ArrayLike) -> None:
    """Refuse a distortion that is that of no lens, by points (...,) all over the image at z = 1."""
    lost = float(np.isnan(undistorted(x, y, terms)[0]).mean())
    if lost > MAX_LOST:
        raise InvalidInputError(
            f"distortion {np.asarray(terms).tolist()} cannot be inverted for {lost:.0%} of the "
            "image; expected that of a calibrated camera: check the terms and their order"
        )


def undistorted(
    x_distorted: NDArray[np.float64], y_distorted: NDArray[np.float64], terms: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return undistorted x and y, (...,) each, by fixed-point iteration; all at z = 1.

    Where the lens model cannot be inverted, at the rim of wide lenses if at all, both are NaN.

    `x_distorted` (...,) and `y_distorted` (...,) points of the image at z = 1; `terms` (n,) k1, k2,
    p1, p2 and, where there are more, k3, k4, k5, k6.
    """
    k = np.zeros(8)
    k[: np.size(terms)] = terms
    x, y = x_distorted, y_distorted
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            radial, dx, dy = _bent(x, y, k)
            error = np.hypot(x * radial + dx - x_distorted, y * radial + dy - y_distorted)
            good = (error < CONVERGED) & (radial > 0.0)
            if good.all():
                break
            x, y = (x_distorted - dx) / radial, (y_distorted - dy) / radial
    return np.where(good, x, np.nan), np.where(good, y, np.nan)


def _bent(
    x: NDArray[np.float64], y: NDArray[np.float64], terms: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Radial factor and tangential shifts, in x and y, at undistorted points."""
    k1, k2, p1, p2, k3, k4, k5, k6 = terms
    r2 = x * x + y * y
    radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    dx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    dy = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return radial, dx, dy
