"""One cluster of a frame as the sensor sees it."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.settings import SphereDetectionSettings


class ClusterView:
    """One cluster of a frame as the sensor sees it.

    Parameters
    ----------
    points : (height, width, 3) of the frame
    cluster : (n,) indices of its points
    settings : tuned numbers
    before : (height, width) m, what was read when the environment was modelled, if that is known
    """

    def __init__(
        self,
        points: NDArray[np.float32],
        cluster: NDArray[np.int64],
        settings: SphereDetectionSettings,
        before: NDArray[np.float32] | None = None,
    ) -> None:
        self._before = before
        self._settings = settings
        self.points = points
        self.cluster = cluster

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

        All of an unorganised cloud; of an organised one a window that holds the sphere's outline.
        """
        if not self.is_organised:
            return self.points[0], 1
        window = self.points[self._window(sphere)]
        every = int(
            np.ceil(np.sqrt(window.shape[0] * window.shape[1] / self._settings.window_readings))
        )
        window = window[::every, ::every]
        return np.ascontiguousarray(window).reshape(-1, 3), every * every

    def surroundings(
        self, sphere: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]:
        """Return readings (n, 3) m about a sphere (4,), which of them (n,) are the cluster's, and
        the range (n,) m read there when the environment was modelled, NaN where it is unknown."""
        own = np.zeros(self.points.shape[:2], dtype=bool)
        own.ravel()[self.cluster] = True
        window = self._window(sphere)
        points = np.ascontiguousarray(self.points[window]).reshape(-1, 3)
        before = np.full(len(points), np.nan, dtype=np.float32)
        if self._before is not None:
            before = self._before[window].ravel()
        return points, own[window].ravel(), before

    def _window(self, sphere: NDArray[np.float64]) -> tuple[slice, slice]:
        """Rows and columns of an organised cloud that hold a sphere's outline and what is round it;
        all of an unorganised one."""
        height, width = self.points.shape[:2]
        if height == 1:
            return slice(None), slice(None)
        distance = float(np.linalg.norm(sphere[:3]))
        away = np.linalg.norm(self._directions - sphere[:3] / distance, axis=1)
        nearest = int(away.argmin())
        row, column = divmod(int(self.cluster[nearest]), width)
        reach = float(away[nearest]) + self._settings.window_radii * float(sphere[3]) / distance
        half = int(min(reach / self.pixel, max(height, width))) + 5
        rows = slice(max(row - half, 0), row + half + 1)
        columns = slice(max(column - half, 0), column + half + 1)
        return rows, columns

    @cached_property
    def _directions(self) -> NDArray[np.float32]:
        own = self.points.reshape(-1, 3)[self.cluster]
        return np.asarray(own / np.linalg.norm(own, axis=1, keepdims=True))

    @cached_property
    def pixel(self) -> float:
        """Angle between neighbouring pixels, rad."""
        rows, columns = np.divmod(self.cluster, self.points.shape[1])
        pixels = float(np.hypot(np.ptp(rows), np.ptp(columns)))
        extent = float(np.linalg.norm(np.ptp(self._directions, axis=0)))
        return max(extent / max(pixels, 1.0), 1e-6)


def passing(points: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far from a place (3,) m the rays to points (n, 3) m pass, (n,) m."""
    along = points @ place / np.linalg.norm(points, axis=1)
    return np.asarray(np.sqrt(np.maximum(place @ place - along**2, 0.0)))
