"""One cluster of a frame as the sensor sees it."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, entry
from intuitive_physics_perception.frame import Scan

WINDOW_RADII = 1.8
"""Distance from its centre that is inspected around a sphere, in radii."""

WINDOW_READINGS = 32768
"""Readings around a sphere that are inspected: bounds the time."""

CONE_WIDENING = 1.25
"""Angle of the cone in which readings are gathered, in that which a sphere needs: fits that follow
move and grow by less. It takes time alone."""


class ClusterView:
    """One cluster of a frame as the sensor sees it.

    `points` (height, width, 3) of the frame; `cluster` (n,) indices of its points; `marks`
    (height, width) of its points, as `Clusters` has them; None where nothing is known of what was
    there before; `scan`: when its points were read; None where all are of one time; `middle` in s,
    the time of the frame to which motions are reduced; None: the mean of the cluster's points.
    """

    def __init__(
        self,
        points: NDArray[np.float32],
        cluster: NDArray[np.int64],
        marks: NDArray[np.uint8] | None = None,
        scan: Scan | None = None,
        middle: float | None = None,
    ) -> None:
        self.marks = marks
        self.scan = scan
        if middle is None:
            middle = 0.0 if scan is None else float(scan.offsets[cluster].mean())
        self.middle = middle
        self._last_cone: tuple[NDArray[np.float64], float, NDArray[np.int64]] | None = None
        self.points = points
        self.cluster = cluster

    def part(self, chosen: NDArray[np.bool_]) -> ClusterView:
        """Return the view of those of the cluster's points that are chosen, (n,)."""
        return ClusterView(self.points, self.cluster[chosen], self.marks, self.scan, self.middle)

    @cached_property
    def readings(self) -> NDArray[np.float64]:
        """The cluster's points (n, 3) m."""
        return self.points.reshape(-1, 3)[self.cluster].astype(np.float64)

    def times_of(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the times (n,) of some of the frame's points after `middle`, in durations of the
        scan; NaN where none are known.

        `indices` (n,) of the points.
        """
        if self.scan is None:
            return np.full(indices.size, np.nan)
        return (self.scan.offsets[indices].astype(np.float64) - self.middle) / self.scan.duration

    @property
    def is_organised(self) -> bool:
        """Whether neighbours in the array are neighbours in the image."""
        return self.points.shape[0] > 1

    def readings_in_outline(self, sphere: NDArray[np.float64]) -> float:
        """Return how many pixels the outline of a sphere (4,) has; 0 in an unorganised cloud."""
        if not self.is_organised:
            return 0.0
        sine = min(float(sphere[3]) / float(np.linalg.norm(sphere[:3])), 1.0)
        return np.pi * (sine / self.pixel) ** 2

    def around(self, sphere: NDArray[np.float64]) -> tuple[NDArray[np.float32], int]:
        """Return readings (n, 3) about a sphere (4,) that the cluster is part of, and how many
        each stands for.

        Those in a cone round the sphere of an unorganised cloud, those in a window that holds the
        sphere's outline of an organised one.
        """
        near, each = self._near(sphere)
        return self._read(near), each

    def surroundings(
        self, sphere: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.uint8], int]:
        """Return readings (n, 3) m about a sphere (4,), which of them (n,) are the cluster's,
        their marks (n,), 0 where nothing is known, and how many each stands for."""
        near, each = self._near(sphere)
        own = self._in_cluster[near].ravel()
        marks = np.zeros(own.size, np.uint8) if self.marks is None else self.marks[near].ravel()
        return self._read(near), own, marks, each

    def _near(self, sphere: NDArray[np.float64]) -> tuple[tuple[Any, Any], int]:
        """Rows and columns of what is about a sphere, and how many readings each stands for."""
        return self._window(sphere) if self.is_organised else ((0, self._cone(sphere)), 1)

    def _read(self, near: tuple[Any, Any]) -> NDArray[np.float32]:
        """Readings (n, 3) m at some rows and columns."""
        return np.ascontiguousarray(self.points[near]).reshape(-1, 3)

    def _window(self, sphere: NDArray[np.float64]) -> tuple[tuple[slice, slice], int]:
        """Rows and columns that hold what is about a sphere, and what each reading stands for."""
        height, width = self.points.shape[:2]
        distance = float(np.linalg.norm(sphere[:3]))
        axis = sphere[:3] / distance
        nearest = int((self._directions @ axis.astype(np.float32)).argmax())
        row, column = divmod(int(self.cluster[nearest]), width)
        away = float(np.linalg.norm(self._directions[nearest] - axis))
        reach = away + WINDOW_RADII * float(sphere[3]) / distance
        half = int(min(reach / self.pixel, max(height, width))) + 5
        top, bottom = max(row - half, 0), min(row + half + 1, height)
        left, right = max(column - half, 0), min(column + half + 1, width)
        every = int(np.ceil(np.sqrt((bottom - top) * (right - left) / WINDOW_READINGS)))
        return (slice(top, bottom, every), slice(left, right, every)), every * every

    def _cone(self, sphere: NDArray[np.float64]) -> NDArray[np.int64]:
        """Indices (n,) of the readings of an unorganised cloud whose rays pass near a sphere.

        One wider cone serves all spheres that are fitted in turn to one thing.
        """
        distance = float(np.linalg.norm(sphere[:3]))
        axis = sphere[:3] / distance
        angle = float(np.arcsin(min(WINDOW_RADII * float(sphere[3]) / distance, 1.0)))
        if self._last_cone is not None:
            last_axis, last_angle, indices = self._last_cone
            if float(np.arccos(np.clip(axis @ last_axis, -1.0, 1.0))) + angle <= last_angle:
                return indices
        angle = min(CONE_WIDENING * angle, 0.5 * np.pi)
        cosine2 = np.float32(np.cos(angle) ** 2)
        indices = readings_in_cone(self.points[0], axis.astype(np.float32), cosine2)
        self._last_cone = axis, angle, indices
        return np.asarray(indices)

    @cached_property
    def _in_cluster(self) -> NDArray[np.bool_]:
        """Marks (height, width) of the cluster's points."""
        marks = np.zeros(self.points.shape[:2], dtype=bool)
        marks.ravel()[self.cluster] = True
        return marks

    @cached_property
    def _directions(self) -> NDArray[np.float32]:
        return np.asarray(directions_of(self.points.reshape(-1, 3), self.cluster))

    @cached_property
    def pixel(self) -> float:
        """Angle between neighbouring pixels, rad."""
        top, bottom, left, right = outline_of(self.cluster, self.points.shape[1])
        pixels = float(np.hypot(bottom - top, right - left))
        extent = float(np.linalg.norm(extent_of(self._directions, np.arange(len(self.cluster)))))
        return max(extent / max(pixels, 1.0), 1e-6)


@entry
def outline_of(cluster: Any, width: int) -> tuple[int, int, int, int]:
    """Return the first and the last row and column of some pixels.

    `cluster` (n,) indices of pixels in row-major order; `width` of the image.
    """
    top = left = np.iinfo(np.int64).max
    bottom = right = -1
    for pixel in cluster:
        row, column = pixel // width, pixel % width
        top, bottom = min(top, row), max(bottom, row)
        left, right = min(left, column), max(right, column)
    return top, bottom, left, right


@allocating_entry
def extent_of(points: Any, chosen: Any) -> Any:
    """Return how far some points reach along each axis, (3,), as their unit.

    `points` (n, 3) float32; `chosen` (m,) indices of them.
    """
    low, high = np.full(3, np.inf, dtype=np.float32), np.full(3, -np.inf, dtype=np.float32)
    for i in chosen:
        for axis in range(3):
            low[axis] = min(low[axis], points[i, axis])
            high[axis] = max(high[axis], points[i, axis])
    return high - low


@allocating_entry
def directions_of(points: Any, chosen: Any) -> Any:
    """Return unit vectors (m, 3) float32 to some points.

    `points` (n, 3) float32 m; `chosen` (m,) indices of them.
    """
    directions = np.empty((chosen.size, 3), dtype=np.float32)
    for k in range(chosen.size):
        x, y, z = points[chosen[k], 0], points[chosen[k], 1], points[chosen[k], 2]
        length = np.sqrt(x * x + y * y + z * z)
        directions[k, 0], directions[k, 1], directions[k, 2] = x / length, y / length, z / length
    return directions


@allocating_entry
def readings_in_cone(points: Any, axis: Any, cosine2: float) -> Any:
    """Return the indices (m,) of readings whose rays are near a direction.

    `points` (n, 3) float32 m, may hold NaN; `axis` (3,) float32, unit vector; `cosine2`: squared
    cosine of the cone's half angle, below 90°.
    """
    inside = np.empty(points.shape[0], dtype=np.bool_)
    count = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        along = x * axis[0] + y * axis[1] + z * axis[2]
        inside[i] = (along > 0.0) & (along * along >= cosine2 * (x * x + y * y + z * z))
        count += inside[i]
    indices = np.empty(count, dtype=np.int64)
    found = 0
    for i in range(points.shape[0]):
        if inside[i]:
            indices[found] = i
            found += 1
    return indices
