"""Convex polygons in space, as arrays of corners; `clipping` has the kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def clip_polygon(
    corners: NDArray[np.float64], normal: NDArray[np.float64], offset: float
) -> NDArray[np.float64]:
    """Return the part of a convex polygon with normal · p ≥ offset (Sutherland-Hodgman).

    Parameters
    ----------
    corners : (n, 3) m
    normal : (3,) unit vector
    offset : m

    Returns
    -------
    array
        (k, 3) m; k < 3 where nothing is left
    """
    corners_left = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        from_a, from_b = a @ normal - offset, b @ normal - offset
        if from_a >= 0.0:
            corners_left.append(a)
        if (from_a > 0.0 > from_b) or (from_a < 0.0 < from_b):
            corners_left.append(a + (b - a) * from_a / (from_a - from_b))
    return np.array(corners_left).reshape(-1, 3)


def plane_square(
    normal: NDArray[np.float64], offset: float, center: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Return the corners of a square in a plane.

    Parameters
    ----------
    normal : (3,) unit normal of the plane
    offset : m; points p of the plane satisfy normal · p = offset
    center : (3,) m, a point whose projection onto the plane is the square's centre
    reach : half of the square's edge length, m

    Returns
    -------
    array
        (4, 3) m, counter-clockwise about the normal
    """
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    middle = center + normal * (offset - normal @ center)
    return np.array(
        [middle + reach * (a * u + b * v) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    )
