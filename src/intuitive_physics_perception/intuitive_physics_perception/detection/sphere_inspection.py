"""Kernels that judge whether a sphere is one, by what is seen in its outline.

Lengths in m, the sensor at the origin; `noise` as in `sphere_fit`.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import njit

from intuitive_physics_perception.detection.sphere_fit import BEHIND_SIGMAS, surface_error

LATTICE = 0.15
LATTICE_REACH = 6
LATTICE_SIDE = 2 * LATTICE_REACH + 1
EDGE_PART = 0.9
OCCLUDER_DEPTH = 0.5


@njit(nogil=True, cache=True, error_model="numpy")
def inspect_sphere(
    points: Any, sphere: Any, sigmas: float, noise: Any
) -> tuple[int, int, float, float]:
    """Judge a sphere by every reading in its outline, whatever cluster it belongs to.

    What lies well before the sphere hides it and says nothing. What lies behind its surface could
    not have been seen through it; what lies close before it is a part of something larger.

    Parameters
    ----------
    points : (n, 3), may hold NaN

    Returns
    -------
    on : readings on the surface
    against : readings that contradict it
    visible : part of the outline's disc that has a reading on the surface within LATTICE radii.
        Two scan lines of a LiDAR, which fit a sphere on any round thing, make at most 0.4
    density : part of the disc between readings on the surface that has any reading so near. Two
        scan lines make at most 0.7; a sphere cut off by the image's edge makes one
    """
    cx, cy, cz, r = sphere[0], sphere[1], sphere[2], sphere[3]
    across, upwards = _across(sphere)
    seen = np.zeros((LATTICE_SIDE, LATTICE_SIDE), dtype=np.bool_)
    read = np.zeros((LATTICE_SIDE, LATTICE_SIDE), dtype=np.bool_)
    on, against = 0, 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        toward = x * cx + y * cy + z * cz
        if not toward > 0.0:
            continue
        error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
        if sine > 1.0:
            continue
        # Where the ray passes the centre nearest, in radii across the line of sight.
        scale = toward / ((x * x + y * y + z * z) * r)
        a = (x * across[0] + y * across[1] + z * across[2]) * scale
        b = (x * upwards[0] + y * upwards[1] + z * upwards[2]) * scale
        _mark(read, a, b)
        if error * error < sigmas * sigmas * variance and ahead > -BEHIND_SIGMAS * deviation:
            on += 1
            _mark(seen, a, b)
        elif sine < EDGE_PART:
            before = ahead - r * sqrt(1.0 - sine * sine)
            if before < max(BEHIND_SIGMAS * deviation, OCCLUDER_DEPTH * r):
                against += 1
    visible, density = _marked_parts(seen, read)
    return on, against, visible, density


@njit(nogil=True, cache=True, error_model="numpy")
def _across(sphere: Any) -> tuple[Any, Any]:
    """Two unit vectors across the line of sight to a sphere."""
    toward = sphere[:3] / sqrt(np.sum(sphere[:3] ** 2))
    helper = np.zeros(3)
    helper[np.argmin(np.abs(toward))] = 1.0
    across = helper - np.sum(helper * toward) * toward
    across /= sqrt(np.sum(across**2))
    return across, np.cross(toward, across)


@njit(nogil=True, cache=True, error_model="numpy")
def _mark(seen: Any, a: float, b: float) -> None:
    """Mark what of the lattice over the unit disc lies within LATTICE of (a, b)."""
    i, j = round(a / LATTICE), round(b / LATTICE)
    for k in range(max(i - 1, -LATTICE_REACH), min(i + 1, LATTICE_REACH) + 1):
        for m in range(max(j - 1, -LATTICE_REACH), min(j + 1, LATTICE_REACH) + 1):
            if (k * LATTICE - a) ** 2 + (m * LATTICE - b) ** 2 <= LATTICE**2:
                seen[k + LATTICE_REACH, m + LATTICE_REACH] = True


@njit(nogil=True, cache=True, error_model="numpy")
def _marked_parts(seen: Any, read: Any) -> tuple[float, float]:
    """Part of the disc that is seen, and part of what lies between seen places that is read."""
    marked, total, filled, enclosed = 0, 0, 0, 0
    for k in range(LATTICE_SIDE):
        for m in range(LATTICE_SIDE):
            i, j = k - LATTICE_REACH, m - LATTICE_REACH
            if (i * i + j * j) * LATTICE**2 > EDGE_PART**2:
                continue
            total += 1
            marked += seen[k, m]
            in_row = np.any(seen[k, : m + 1]) and np.any(seen[k, m:])
            in_column = np.any(seen[: k + 1, m]) and np.any(seen[k:, m])
            if in_row or in_column:
                enclosed += 1
                filled += read[k, m]
    return marked / total, filled / max(enclosed, 1)
