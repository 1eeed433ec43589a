"""Boxes and capsules in clusters that hold no sphere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.box_fit import fit_box
from intuitive_physics_perception.capsule_fit import fit_capsule
from intuitive_physics_perception.cluster_memory import ClusterMemory
from intuitive_physics_perception.detected_solid import DetectedSolid
from intuitive_physics_perception.noise import RangeNoise
from intuitive_physics_perception.planes import DetectedPlane
from intuitive_physics_perception.settings import PerceptionSettings

FITTED_POINTS = 800
STILLNESS = 0.1


class SolidFinder:
    """Finds boxes and capsules.

    Parameters
    ----------
    noise : of the range readings
    planes : of the environment, in the sensor's frame; what stands on one reaches down to it
    rng : decides which points and hypotheses are tried
    """

    def __init__(
        self,
        noise: RangeNoise,
        planes: Sequence[DetectedPlane],
        settings: PerceptionSettings,
        rng: np.random.Generator,
    ) -> None:
        self._noise = noise
        self._planes = planes
        self._settings = settings
        self._rng = rng
        self._memory: ClusterMemory[DetectedSolid] = ClusterMemory(STILLNESS * settings.min_radius)

    def find(
        self, points: NDArray[np.float32], clusters: Sequence[NDArray[np.int64]]
    ) -> list[DetectedSolid | None]:
        """Return the solid of each cluster of a frame of points (height, width, 3)."""
        found = [self._solid_of(points, cluster) for cluster in clusters]
        self._memory.end_frame()
        return found

    def _solid_of(
        self, points: NDArray[np.float32], cluster: NDArray[np.int64]
    ) -> DetectedSolid | None:
        if not self._may_be_whole(points, cluster):
            return None
        own = points.reshape(-1, 3)[cluster].astype(np.float64)
        known = self._memory.recall(own)
        solid = self._solid(own) if known.deserves_a_search else known.found
        self._memory.keep(known, solid)
        return solid

    def _may_be_whole(self, points: NDArray[np.float32], cluster: NDArray[np.int64]) -> bool:
        """Large enough to show faces, small enough, and not cut off by the image's edge."""
        if len(cluster) < self._settings.min_solid_points:
            return False
        height, width = points.shape[:2]
        if height > 1:
            rows, columns = np.divmod(cluster, width)
            if min(rows.min(), columns.min()) == 0 or (
                rows.max() == height - 1 or columns.max() == width - 1
            ):
                return False
        extent = np.ptp(points.reshape(-1, 3)[cluster], axis=0)
        return bool(np.linalg.norm(extent) < 2.0 * self._settings.max_solid_size)

    def _solid(self, own: NDArray[np.float64]) -> DetectedSolid | None:
        """The box or the capsule that explains a cluster, whichever does so better."""
        total = len(own)
        if total > FITTED_POINTS:
            own = own[self._rng.choice(total, FITTED_POINTS, replace=False)]
        deviations = self._noise.deviation(np.linalg.norm(own, axis=1))
        capsule = fit_capsule(own, deviations, self._noise.lateral)
        box = fit_box(own, deviations, self._planes, self._rng)
        fits = [
            fit
            for fit in (capsule, box)
            if fit is not None
            and fit.misfit < self._settings.max_misfit
            and self._settings.min_radius <= fit.radius
            and fit.shape.bounding_radius <= 0.5 * self._settings.max_solid_size
        ]
        if not fits:
            return None
        best = min(fits, key=lambda fit: fit.misfit)
        # The fit took part of the points: the rest tells as much again.
        doubt = self._settings.correlated_readings * len(own) / total
        return best.doubted(doubt, total)
