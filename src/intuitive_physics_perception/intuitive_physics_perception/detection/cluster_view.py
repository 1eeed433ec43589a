"""Where a cluster lies in the image, and which readings are about a sphere it is part of."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

AROUND = 1.8
"""Radii of the sphere, from its centre, that a window holds."""

MOST_READINGS = 32_768
"""Of a window. More would tell no better whether a sphere is one, and take the time of a frame."""


class ClusterView:
    """One cluster of a frame as the sensor sees it.

    Parameters
    ----------
    points : (height, width, 3) of the frame
    cluster : (n,) indices of its points
    """

    def __init__(self, points: NDArray[np.float32], cluster: NDArray[np.int64]) -> None:
        self._points = points
        self._cluster = cluster

    def readings_in_outline(self, sphere: NDArray[np.float64]) -> float:
        """Return how many pixels the outline of a sphere (4,) has; 0 in an unorganised cloud."""
        if self._points.shape[0] == 1:
            return 0.0
        sine = min(float(sphere[3]) / float(np.linalg.norm(sphere[:3])), 1.0)
        return np.pi * (sine / self._pitch) ** 2

    def around(self, sphere: NDArray[np.float64]) -> tuple[NDArray[np.float32], int]:
        """Return readings (n, 3) about a sphere (4,) that the cluster is part of, and how many
        each stands for.

        All of an unorganised cloud; of an organised one a window that holds the sphere's outline.
        """
        height, width = self._points.shape[:2]
        if height == 1:
            return self._points[0], 1
        distance = float(np.linalg.norm(sphere[:3]))
        away = np.linalg.norm(self._directions - sphere[:3] / distance, axis=1)
        nearest = int(away.argmin())
        row, column = divmod(int(self._cluster[nearest]), width)
        reach = float(away[nearest]) + AROUND * float(sphere[3]) / distance
        half = int(min(reach / self._pitch, max(height, width))) + 2
        rows = slice(max(row - half, 0), row + half + 1)
        columns = slice(max(column - half, 0), column + half + 1)
        window = self._points[rows, columns]
        every = int(np.ceil(np.sqrt(window.shape[0] * window.shape[1] / MOST_READINGS)))
        window = window[::every, ::every]
        return np.ascontiguousarray(window).reshape(-1, 3), every * every

    @cached_property
    def _directions(self) -> NDArray[np.float32]:
        own = self._points.reshape(-1, 3)[self._cluster]
        return np.asarray(own / np.linalg.norm(own, axis=1, keepdims=True))

    @cached_property
    def _pitch(self) -> float:
        """Angle between neighbouring pixels, rad."""
        rows, columns = np.divmod(self._cluster, self._points.shape[1])
        pixels = float(np.hypot(np.ptp(rows), np.ptp(columns)))
        extent = float(np.linalg.norm(np.ptp(self._directions, axis=0)))
        return max(extent / max(pixels, 1.0), 1e-6)
