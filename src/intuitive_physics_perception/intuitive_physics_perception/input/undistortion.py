"""Rays of a lens that bends them: Brown-Conrady with a rational radial part, as in OpenCV."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError

DISTORTION_TERMS = {"plumb_bob": (4, 5), "rational_polynomial": (8,)}
"""Distortion models of sensor_msgs/CameraInfo that are known, with how many terms they have."""

STEPS = 60
CONVERGED = 1e-7
MAX_LOST = 0.1


def check_invertible(x: NDArray[np.float64], y: NDArray[np.float64], terms: ArrayLike) -> None:
    """Refuse a distortion that is that of no lens.

    Parameters
    ----------
    x, y : distorted points all over the image, at z = 1
    terms : as of `undistorted`

    Raises
    ------
    InvalidInputError
        When it cannot be inverted for more than a tenth of the points.
    """
    lost = float(np.isnan(undistorted(x, y, terms)[0]).mean())
    if lost > MAX_LOST:
        raise InvalidInputError(
            f"distortion {np.asarray(terms).tolist()} cannot be inverted for {lost:.0%} of the "
            "image; expected that of a calibrated camera: check the terms and their order"
        )


def undistorted(
    x_distorted: NDArray[np.float64], y_distorted: NDArray[np.float64], terms: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Invert the distortion by fixed-point iteration; inputs and outputs are at z = 1.

    Where the lens model cannot be inverted, at the rim of wide lenses if at all, both are NaN.

    Parameters
    ----------
    terms : k1, k2, p1, p2 and, where there are more, k3, k4, k5, k6
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
