"""What is no plane: points off all planes, in clusters that may be objects."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from intuitive_physics_perception.clustering import grid_clusters, neighbour_labels
from intuitive_physics_perception.environment_model import EnvironmentModel
from intuitive_physics_perception.planes import DetectedPlane
from intuitive_physics_perception.settings import PerceptionSettings

OUTLINE_MARGIN = 0.03


@dataclass(frozen=True, eq=False)
class Clusters:
    """Foreground points by cluster, largest first.

    Parameters
    ----------
    indices : for each cluster (n,) indices into the frame's points in row-major order
    foreground : number of points off all planes
    readings : number of points in range
    """

    indices: list[NDArray[np.int64]]
    foreground: int
    readings: int


class ForegroundFinder:
    """Takes the planes of one environment out of frames and clusters what is left."""

    def __init__(self, model: EnvironmentModel, settings: PerceptionSettings) -> None:
        self._settings = settings
        self._planes = model.detected
        noise = model.noise
        # Single precision halves the time of a frame and is far below the noise.
        self._limits = np.array(
            [
                settings.min_range**2,
                settings.max_range**2,
                noise.constant**2,
                noise.quadratic**2,
                noise.limit**2,
                settings.plane_tolerance**2,
                settings.plane_sigmas**2,
            ],
            dtype=np.float32,
        )
        self._coefficients = np.array(
            [[*plane.normal, plane.offset] for plane in model.detected], dtype=np.float32
        )
        self._cover = np.zeros((0, 0), dtype=np.uint16)
        self._covered = np.zeros((0, 0), dtype=bool)

    def find(self, points: NDArray[np.float32]) -> Clusters:
        """Cluster the foreground of a frame of points (height, width, 3)."""
        mask, readings = _foreground(
            points, self._cover_of(points), self._coefficients, self._limits
        )
        if points.shape[0] > 1:
            indices = self._organised_clusters(points, mask)
        else:
            indices = self._unorganised_clusters(points[0], mask[0])
        return Clusters(indices, int(np.count_nonzero(mask)), readings)

    def _cover_of(self, points: NDArray[np.float32]) -> NDArray[np.uint16]:
        """Bit k of each point says whether its ray meets plane k inside the plane's outline.

        A pixel of an organised cloud always looks the same way, so it is asked only once.
        """
        organised = points.shape[0] > 1
        if not organised or self._cover.shape != points.shape[:2]:
            self._cover = np.zeros(points.shape[:2], dtype=np.uint16)
            self._covered = np.zeros(points.shape[:2], dtype=bool)
        new = np.isfinite(points[:, :, 2]) & ~self._covered
        if new.any():
            self._cover[new] = covering_planes(points[new], self._planes)
            self._covered |= new
        return self._cover

    def _organised_clusters(
        self, points: NDArray[np.float32], mask: NDArray[np.uint8]
    ) -> list[NDArray[np.int64]]:
        order, starts = grid_clusters(points, mask, self._limits, self._settings.min_points)
        parts = [order[a:b] for a, b in pairwise(starts)]
        return sorted(parts, key=len, reverse=True)

    def _unorganised_clusters(
        self, points: NDArray[np.float32], mask: NDArray[np.uint8]
    ) -> list[NDArray[np.int64]]:
        indices = np.flatnonzero(mask)
        labels = neighbour_labels(points[indices].astype(np.float64), self._settings.cluster_angle)
        sizes = np.bincount(labels, minlength=1)
        largest_first = np.argsort(-sizes, kind="stable")
        return [
            indices[labels == k] for k in largest_first if sizes[k] >= self._settings.min_points
        ]


def covering_planes(
    directions: NDArray[Any], planes: tuple[DetectedPlane, ...]
) -> NDArray[np.uint16]:
    """Return (n,) bit masks: bit k is set where a ray meets plane k inside its outline.

    Parameters
    ----------
    directions : (n, 3) of any length, from the sensor
    """
    cover = np.zeros(len(directions), dtype=np.uint16)
    for k, plane in enumerate(planes):
        along = directions @ plane.normal.astype(directions.dtype)
        meets = np.flatnonzero(along < -1e-6)
        reach = plane.offset / along[meets]
        met = directions[meets] * reach[:, None]
        margin = OUTLINE_MARGIN * np.linalg.norm(met, axis=1)
        inside = np.ones(meets.size, dtype=bool)
        for outward, bound in zip(*_edges(plane), strict=True):
            inside &= met @ outward.astype(directions.dtype) <= bound + margin
        cover[meets[inside]] |= np.uint16(1 << k)
    return cover


def _edges(plane: DetectedPlane) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half spaces outward · p ≤ bound that together are the plane's convex outline."""
    along = np.roll(plane.corners, -1, axis=0) - plane.corners
    outward = np.cross(along, plane.normal)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return outward, (outward * plane.corners).sum(axis=1)


@njit(nogil=True, cache=True, error_model="numpy")
def _foreground(points: Any, cover: Any, planes: Any, limits: Any) -> tuple[Any, int]:
    """Mark points in range that are off all planes (n, 4) covering them, and not behind one.

    Whole rows go through each step without a branch, which the compiler turns into vector code.
    """
    height, width = cover.shape
    min_range2, max_range2, constant2, quadratic2, limit2, tolerance2, sigmas2 = limits
    mask = np.zeros((height, width), dtype=np.uint8)
    range2 = np.empty(width, dtype=np.float32)
    variance = np.empty(width, dtype=np.float32)
    readings = 0
    for v in range(height):
        for u in range(width):
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            range2[u] = x * x + y * y + z * z
            grown = constant2 + quadratic2 * range2[u] * range2[u]
            variance[u] = sigmas2 * (grown if grown < limit2 else limit2)
            # NaN compares false with everything.
            mask[v, u] = (range2[u] >= min_range2) & (range2[u] <= max_range2)
            readings += mask[v, u]
        for k in range(planes.shape[0]):
            nx, ny, nz, offset = planes[k, 0], planes[k, 1], planes[k, 2], planes[k, 3]
            bit = np.uint16(1 << k)
            for u in range(width):
                along = points[v, u, 0] * nx + points[v, u, 1] * ny + points[v, u, 2] * nz
                distance = along - offset
                # Both sides times range², which spares a division for every pixel.
                spread = tolerance2 * range2[u] + variance[u] * along * along
                before = (distance > np.float32(0.0)) & (distance * distance * range2[u] > spread)
                mask[v, u] &= np.uint8(before) | np.uint8((cover[v, u] & bit) == 0)
    return mask, readings
