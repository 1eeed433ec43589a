"""Boxes and capsules in clusters that spheres do not explain; all objects of a frame together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import StaticBox
from intuitive_physics_perception.detection.box_fit import SURFACE_DEVIATION, cloud_of_box, fit_box
from intuitive_physics_perception.detection.capsule_fit import fit_capsule
from intuitive_physics_perception.detection.cluster_memory import ClusterMemory
from intuitive_physics_perception.detection.cluster_view import extent_of, outline_of
from intuitive_physics_perception.detection.detections import (
    DetectedSolid,
    DetectedSphere,
    Detection,
    without_doubles,
)
from intuitive_physics_perception.detection.fitted_sphere import EXPECTED_REACH, MAX_MISFIT
from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.detection.spheres import ClusterSpheres
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.settings import PerceptionSettings

FEWEST_POINTS = 120
"""Points that a box or capsule needs at least."""

FITTED_POINTS = 500
"""Points that a box or capsule is fitted to."""

SPHERES_LEAVE = 0.1
"""Part of a cluster that spheres may leave unexplained: noise, a shadow's edge, a finger."""

COLORED_REACH = 1.15
"""Radii from a sphere's centre within which a reading of its cluster shows its colour."""


class SolidFinder:
    """Finds boxes and capsules.

    `model`: the environment: what stands on one of its planes reaches down to it, and what is one
    of its static boxes is no object.
    """

    def __init__(
        self, model: EnvironmentModel, settings: PerceptionSettings, rng: np.random.Generator
    ) -> None:
        self._model = model
        self._settings = settings
        self._rng = rng
        self._memory = ClusterMemory(settings.min_radius, model.noise)
        self.look_from(model)

    def look_from(self, model: EnvironmentModel) -> None:
        """Take the same environment as the sensor sees it now."""
        self._model = model
        self._memory.look_from(model.sensor_pose)

    def find(
        self,
        points: NDArray[np.float32],
        clusters: Sequence[NDArray[np.int64]],
        budget: FrameBudget | None = None,
    ) -> list[DetectedSolid | None]:
        """Return the solid of each cluster of a frame, None where there is none.

        `points` (height, width, 3) m, of the frame; `clusters` (n,) each, indices of its points;
        `budget`: when it is spent, what was found last counts. None has no end.
        """
        budget = budget or FrameBudget()
        solids = [self._solid_of(points, cluster, budget) for cluster in clusters]
        self._memory.end_frame()
        return solids

    def _solid_of(
        self, points: NDArray[np.float32], cluster: NDArray[np.int64], budget: FrameBudget
    ) -> DetectedSolid | None:
        if not self._may_be_whole(points, cluster):
            return None
        readings = points.reshape(-1, 3)[cluster].astype(np.float64)
        (remembered,) = self._memory.recall(
            readings.mean(axis=0, keepdims=True), np.array([len(readings)])
        )
        if not remembered.deserves_a_search:
            solid = remembered.result
        elif budget.is_spent:
            budget.waiting += 1
            self._memory.postpone(remembered)
            return remembered.result
        else:
            solid = self._solid(readings)
        self._memory.keep(remembered, solid)
        return solid

    def _may_be_whole(self, points: NDArray[np.float32], cluster: NDArray[np.int64]) -> bool:
        """Large enough to show faces, small enough, and not cut off by the image's edge."""
        if len(cluster) < FEWEST_POINTS:
            return False
        height, width = points.shape[:2]
        if height > 1:
            top, bottom, left, right = outline_of(cluster, width)
            if 0 in (top, left) or bottom == height - 1 or right == width - 1:
                return False
        extent = extent_of(points.reshape(-1, 3), cluster)
        return bool(np.linalg.norm(extent) < 2.0 * self._settings.max_solid_size)

    def _solid(self, readings: NDArray[np.float64]) -> DetectedSolid | None:
        """The box or the capsule that explains a cluster, whichever does so better."""
        total = len(readings)
        if total > FITTED_POINTS:
            readings = readings[self._rng.choice(total, FITTED_POINTS, replace=False)]
        cloud = cloud_of_box(readings, self._model.noise)
        capsule = fit_capsule(readings, cloud.deviations, self._model.noise.lateral)
        box = fit_box(cloud, self._model.detected, self._rng)
        fits = [
            fit
            for fit in (capsule, box)
            if fit is not None
            and fit.misfit < MAX_MISFIT
            and self._settings.min_radius <= fit.radius
            and fit.shape.bounding_radius <= 0.5 * self._settings.max_solid_size
            and not self._is_static(fit)
        ]
        if not fits:
            return None
        best = min(fits, key=lambda fit: fit.misfit)
        # Of the readings that share one error the fit took as large a part as of all.
        doubt = 1.0 + (self._model.noise.correlated - 1.0) * len(readings) / total
        # An uneven surface is uneven in the same way in every frame.
        return best.doubted(doubt, total, SURFACE_DEVIATION)

    def _is_static(self, fit: DetectedSolid) -> bool:
        """Whether its centre lies in a static box of the environment."""
        center = self._model.to_environment(fit.center)
        return any(holds(box, center) for box in self._model.environment.boxes)


def holds(box: StaticBox, place: NDArray[np.float64]) -> bool:
    """Return whether a place (3,) of the environment's frame lies in a box."""
    local = (place - box.center) @ rotation_matrix(box.orientation)
    return bool((np.abs(local) <= 0.5 * box.edge_lengths).all())


@dataclass(frozen=True, eq=False)
class ObjectInFrame:
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
        away = self.detection.distances(points.reshape(-1, 3)[self.cluster])
        return self.cluster[away < EXPECTED_REACH * self.detection.radius]


def all_objects(
    points: NDArray[np.float32],
    spheres_by_cluster: Sequence[ClusterSpheres],
    solids: SolidFinder | None,
    colors: NDArray[np.uint8] | None = None,
    budget: FrameBudget | None = None,
) -> list[ObjectInFrame]:
    """Return the objects of a frame of points (height, width, 3), in the sensor's frame.

    One solid that explains a whole cluster is likelier than a sphere that explains a part of it:
    the near end of a capsule is one.

    `solids`: finds boxes and capsules; None to leave them out; `colors` (height, width, 3) of the
    points, where they are known; `budget`: of the frame, None has no end.
    """
    objects: list[ObjectInFrame] = []
    if solids is not None:
        clusters = [part.cluster for part in spheres_by_cluster if part.rest > SPHERES_LEAVE]
        found = zip(solids.find(points, clusters, budget), clusters, strict=True)
        objects = [ObjectInFrame(solid, cluster) for solid, cluster in found if solid is not None]
    explained = {id(item.cluster) for item in objects}
    cluster_of = {
        sphere: part.cluster
        for part in spheres_by_cluster
        if id(part.cluster) not in explained
        for sphere in part.spheres
    }
    spheres = without_doubles(list(cluster_of))
    objects = [*(ObjectInFrame(sphere, cluster_of[sphere]) for sphere in spheres), *objects]
    if colors is None:
        return objects
    return [
        replace(item, detection=with_color(item.detection, item.cluster, points, colors))
        for item in objects
    ]


def with_color(
    detection: Detection,
    cluster: NDArray[np.int64],
    points: NDArray[np.float32],
    colors: NDArray[np.uint8],
) -> Detection:
    """Return a detection with the mean colour of the readings of its cluster on it.

    `cluster` (n,) indices into `points` (height, width, 3) m and `colors` (height, width, 3).
    """
    # Colours may be a view of a message, so only those asked for are copied.
    rows, columns = np.divmod(cluster, points.shape[1])
    chosen = colors[rows, columns]
    if isinstance(detection, DetectedSphere):
        away = detection.distances(points[rows, columns])
        chosen = chosen[away < COLORED_REACH * detection.radius]
    return replace(detection, color=chosen.mean(axis=0) / 255.0) if len(chosen) else detection
