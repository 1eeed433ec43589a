"""What is no plane: points off all planes, in clusters that may be objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from intuitive_physics_perception.detection.clustering import grid_clusters, neighbour_labels
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.planes import DetectedPlane
from intuitive_physics_perception.settings import PerceptionSettings

ITERATIONS = 8


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
        self._noise = model.noise
        noise = model.noise
        # Single precision halves the time of a frame and is far below the noise.
        self._limits = np.array(
            [
                settings.min_range**2,
                settings.max_range**2,
                noise.constant**2,
                noise.quadratic**2,
                noise.limit**2,
            ],
            dtype=np.float32,
        )
        self._free = np.zeros((0, 0), dtype=np.float32)
        self._known = np.zeros((0, 0), dtype=bool)

    def find(self, points: NDArray[np.float32]) -> Clusters:
        """Cluster the foreground of a frame of points (height, width, 3)."""
        mask, readings = _foreground(points, self._free_of(points), self._limits)
        if points.shape[0] > 1:
            indices = self._organised_clusters(points, mask)
        else:
            indices = self._unorganised_clusters(points[0], mask[0])
        return Clusters(indices, int(np.count_nonzero(mask)), readings)

    def _free_of(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Squared range at which each ray comes to a plane, (height, width) m².

        A pixel of an organised cloud always looks the same way, so it is asked only once.
        """
        organised = points.shape[0] > 1
        if not organised or self._free.shape != points.shape[:2]:
            self._free = np.zeros(points.shape[:2], dtype=np.float32)
            self._known = np.zeros(points.shape[:2], dtype=bool)
        new = np.isfinite(points[:, :, 2]) & ~self._known
        if new.any():
            free = free_ranges(points[new], self._planes, self._noise, self._settings)
            self._free[new] = np.square(free)
            self._known |= new
        return self._free

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


def free_ranges(
    directions: NDArray[np.float32],
    planes: Sequence[DetectedPlane],
    noise: RangeNoise,
    settings: PerceptionSettings,
) -> NDArray[np.float32]:
    """Range up to which a reading along each ray lies off and before all planes, (n,) m.

    The reading at range ρ of a ray that meets a plane at an angle of cosine c, inside the plane's
    outline, lies before it when its distance exceeds √((s σ(ρ) c)² + t²): s deviations of the noise
    and the unevenness t.

    Parameters
    ----------
    directions : (n, 3) of any length, from the sensor
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    free = np.full(len(unit), settings.max_range, dtype=np.float32)
    for plane in planes:
        cosine = -(unit @ plane.normal.astype(unit.dtype))
        meets = np.flatnonzero(cosine > 1e-6)
        cosine = cosine[meets]
        inside = plane.outlines(unit[meets] * (-plane.offset / cosine)[:, None])
        meets, cosine = meets[inside], cosine[inside]
        begins = -plane.offset / cosine
        # A contraction: what the noise lets pass grows far slower with range than the distance.
        for _ in range(ITERATIONS):
            spread = settings.plane_sigmas * noise.deviation(begins) * cosine
            margin = np.hypot(spread, settings.plane_tolerance)
            begins = np.maximum((-plane.offset - margin) / cosine, 0.0)
        free[meets] = np.minimum(free[meets], begins)
    return free


@njit(nogil=True, cache=True, error_model="numpy")
def _foreground(points: Any, free: Any, limits: Any) -> tuple[Any, int]:
    """Mark points in range and before all planes, which begin at the squared range `free`.

    No branch, which the compiler turns into vector code.
    """
    height, width = free.shape
    min_range2, max_range2 = limits[0], limits[1]
    mask = np.empty((height, width), dtype=np.uint8)
    readings = 0
    for v in range(height):
        for u in range(width):
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            range2 = x * x + y * y + z * z
            # NaN compares false with everything.
            read = (range2 >= min_range2) & (range2 <= max_range2)
            mask[v, u] = read & (range2 < free[v, u])
            readings += read
    return mask, readings
