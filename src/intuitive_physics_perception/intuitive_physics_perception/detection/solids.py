"""Boxes and capsules in clusters that spheres do not explain; all objects of a frame together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import StaticBox
from intuitive_physics_perception.detection.box_fit import fit_box
from intuitive_physics_perception.detection.capsule_fit import fit_capsule
from intuitive_physics_perception.detection.cluster_memory import ClusterMemory
from intuitive_physics_perception.detection.detections import (
    DetectedSolid,
    Detection,
    without_doubles,
)
from intuitive_physics_perception.detection.spheres import ClusterSpheres
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.input.colors import with_color
from intuitive_physics_perception.settings import PerceptionSettings

PIXELS_REACH = 1.2
"""Radii from a sphere's centre within which readings may be of it. Set by hand."""


class SolidFinder:
    """Finds boxes and capsules.

    Parameters
    ----------
    model : the environment: what stands on one of its planes reaches down to it, and what is one
        of its static boxes is no object
    rng : decides which points and hypotheses are tried
    """

    def __init__(
        self,
        model: EnvironmentModel,
        settings: PerceptionSettings,
        rng: np.random.Generator,
    ) -> None:
        self._model = model
        self._settings = settings
        self._rng = rng
        self._memory: ClusterMemory[DetectedSolid] = ClusterMemory(
            settings.clusters.movement * settings.min_radius, settings.clusters, model.noise
        )

    @property
    def spheres_leave(self) -> float:
        """Part of a cluster that spheres may leave unexplained before a solid is looked for."""
        return self._settings.solids.spheres_leave

    def find(
        self, points: NDArray[np.float32], clusters: Sequence[NDArray[np.int64]]
    ) -> list[DetectedSolid | None]:
        """Return the solid of each cluster of a frame, None where there is none.

        Parameters
        ----------
        points : (height, width, 3) m, of the frame
        clusters : each (n,) indices of its points
        """
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
        limits = self._settings.solids
        total = len(own)
        if total > limits.fitted_points:
            own = own[self._rng.choice(total, limits.fitted_points, replace=False)]
        deviations = self._model.noise.deviation(np.linalg.norm(own, axis=1))
        capsule = fit_capsule(own, deviations, self._model.noise.lateral, limits)
        box = fit_box(own, deviations, self._model.detected, limits, self._rng)
        fits = [
            fit
            for fit in (capsule, box)
            if fit is not None
            and fit.misfit < self._settings.max_misfit
            and self._settings.min_radius <= fit.radius
            and fit.shape.bounding_radius <= 0.5 * self._settings.max_solid_size
            and not self._is_static(fit)
        ]
        if not fits:
            return None
        best = min(fits, key=lambda fit: fit.misfit)
        # Of the readings that share one error the fit took as large a part as of all.
        doubt = 1.0 + (self._model.noise.correlated - 1.0) * len(own) / total
        # An uneven surface is uneven in the same way in every frame.
        return best.doubted(doubt, total, limits.surface_deviation)

    def _is_static(self, fit: DetectedSolid) -> bool:
        """Whether its centre lies in a static box of the environment."""
        center = self._model.to_environment(fit.center)
        return any(holds(box, center) for box in self._model.environment.boxes)


def holds(box: StaticBox, place: NDArray[np.float64]) -> bool:
    """Return whether a place (3,) of the environment's frame lies in a box."""
    local = (place - box.center) @ rotation_matrix(box.orientation)
    return bool((np.abs(local) <= 0.5 * box.edge_lengths).all())


@dataclass(frozen=True, eq=False)
class SeenObject:
    """An object in a frame.

    Parameters
    ----------
    detection : what it is and where, in the sensor's frame
    cluster : (n,) indices of the points of the cluster it was found in
    """

    detection: Detection
    cluster: NDArray[np.int64]

    def pixels(self, points: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return which points (m,) of the frame (height, width, 3) show it."""
        if isinstance(self.detection, DetectedSolid):
            return self.cluster
        center = self.detection.center.astype(np.float32)
        away = np.linalg.norm(points.reshape(-1, 3)[self.cluster] - center, axis=1)
        return self.cluster[away < PIXELS_REACH * self.detection.radius]


def all_objects(
    points: NDArray[np.float32],
    found: Sequence[ClusterSpheres],
    solids: SolidFinder | None,
    colors: NDArray[np.uint8] | None = None,
) -> list[SeenObject]:
    """Return the objects of a frame of points (height, width, 3), in the sensor's frame.

    One solid that explains a whole cluster is likelier than a sphere that explains a part of it:
    the near end of a capsule is one.

    Parameters
    ----------
    found : the spheres of each cluster
    solids : finds boxes and capsules; None to leave them out
    colors : (height, width, 3) of the points, where they are known
    """
    unexplained = [part for part in found if part.rest > solids.spheres_leave] if solids else []
    by_cluster = solids.find(points, [part.cluster for part in unexplained]) if solids else []
    whole = [
        SeenObject(solid, part.cluster)
        for part, solid in zip(unexplained, by_cluster, strict=True)
        if solid is not None
    ]
    replaced = {id(seen.cluster) for seen in whole}
    clusters = {
        id(sphere): part.cluster
        for part in found
        if id(part.cluster) not in replaced
        for sphere in part.spheres
    }
    spheres = [sphere for part in found for sphere in part.spheres if id(sphere) in clusters]
    seen = [SeenObject(one, clusters[id(one)]) for one in without_doubles(spheres)] + whole
    if colors is None:
        return seen
    return [
        replace(one, detection=_colored(one.detection, one.cluster, points, colors)) for one in seen
    ]


def _colored(
    detection: Detection,
    cluster: NDArray[np.int64],
    points: NDArray[np.float32],
    colors: NDArray[np.uint8],
) -> Detection:
    # Colours may be a view of a message, so only those asked for are copied.
    rows, columns = np.divmod(cluster, points.shape[1])
    return with_color(detection, points[rows, columns], colors[rows, columns])
