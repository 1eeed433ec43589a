"""Spheres in clusters: RANSAC with MSAC scoring, refinement, and tests that reject what is none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.cluster_memory import ClusterMemory
from intuitive_physics_perception.detection.cluster_view import ClusterView
from intuitive_physics_perception.detection.detected_sphere import DetectedSphere
from intuitive_physics_perception.detection.foreground import Clusters
from intuitive_physics_perception.detection.known_radius import with_known_radius
from intuitive_physics_perception.detection.sphere_fit import readings_beyond, refine_sphere
from intuitive_physics_perception.detection.sphere_inspection import inspect_sphere
from intuitive_physics_perception.detection.sphere_ransac import (
    outline_sphere,
    ransac_spheres,
    spheres_of_radius,
)
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.settings import PerceptionSettings

SCORED_POINTS = 512
FITTED_POINTS = 1000
REFINED_HYPOTHESES = 3
SPHERES_IN_CLUSTER = 3
INLIER_SIGMAS = 3.0
STRAY_SIGMAS = 5.0
ROUGHLY_ON, ROUGHLY_SEEN = 0.6, 0.5
MIN_DENSITY = 0.9
STILLNESS = 0.2
SYSTEMATIC_ERROR = 0.0005


@dataclass(frozen=True, eq=False)
class ClusterSpheres:
    """The spheres of one cluster.

    Parameters
    ----------
    cluster : (n,) indices of its points
    spheres : in it
    rest : part of its points that lie on none of them
    """

    cluster: NDArray[np.int64]
    spheres: list[DetectedSphere]
    rest: float


class SphereFinder:
    """Finds spheres in the foreground of frames.

    Parameters
    ----------
    noise : of the range readings
    settings : limits of what is a sphere
    rng : decides which hypotheses are tried
    """

    def __init__(
        self, noise: RangeNoise, settings: PerceptionSettings, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._rng = rng
        self._memory: ClusterMemory[None] = ClusterMemory(STILLNESS * settings.min_radius)
        self._known_radii = [thing.radius for thing in settings.known_objects]
        self._deviation = noise.deviation
        self._noise = np.square([noise.constant, noise.quadratic, noise.limit, noise.lateral])

    def find(
        self, points: NDArray[np.float32], clusters: Clusters, searches: int | None = None
    ) -> list[ClusterSpheres]:
        """Return the spheres by cluster of a frame of points (height, width, 3), in the sensor's
        frame.

        Parameters
        ----------
        searches : clusters, the smallest first, that are searched at random when their outline
            suggests no sphere; the others wait for the next frame. None searches all
        """
        found = []
        left = len(clusters.indices) if searches is None else searches
        for cluster in reversed(clusters.indices):
            own = points.reshape(-1, 3)[cluster].astype(np.float64)
            known = self._memory.recall(own)
            if not known.deserves_a_search:
                self._memory.keep(known, None)
                found.append(ClusterSpheres(cluster, [], 1.0))
                continue
            inside = self._spheres_in(points, cluster, own, thorough=left > 0)
            found.append(inside)
            if inside.spheres:
                continue
            if left > 0:
                self._memory.keep(known, None)
                left -= 1
            else:
                self._memory.postpone(known)
        self._memory.end_frame()
        return found

    def _spheres_in(
        self,
        points: NDArray[np.float32],
        cluster: NDArray[np.int64],
        own: NDArray[np.float64],
        *,
        thorough: bool,
    ) -> ClusterSpheres:
        found: list[DetectedSphere] = []
        left = cluster
        while len(found) < SPHERES_IN_CLUSTER and len(own) >= self._settings.min_points:
            sphere = self._best_sphere(ClusterView(points, left), own, thorough=thorough)
            if sphere is None:
                break
            found.append(sphere)
            # Noise must not make a second sphere of the readings that stray farthest.
            reach = 1.2 * sphere.radius + STRAY_SIGMAS * self._deviation(sphere.range)
            off = np.linalg.norm(own - sphere.center, axis=1) > reach
            left, own = left[off], own[off]
        return ClusterSpheres(cluster, found, len(own) / len(cluster))

    def _best_sphere(
        self, view: ClusterView, own: NDArray[np.float64], *, thorough: bool
    ) -> DetectedSphere | None:
        fitted = self._some(own, FITTED_POINTS)
        for hypothesis in self._hypotheses(fitted, len(own), thorough):
            if len(own) < self._fewest(view, hypothesis):
                continue
            sphere, covariance, misfit = self._refined(view, fitted, hypothesis)
            # The fit took part of the points: the rest tells as much again.
            covariance = covariance * self._settings.correlated_readings * len(fitted) / len(own)
            sphere, covariance = with_known_radius(
                sphere, covariance, self._known_radii, self._settings.known_object_tolerance
            )
            if misfit < self._settings.max_misfit and self._is_plausible(sphere, covariance):
                detected = self._inspected(view, sphere, covariance)
                if detected is not None:
                    return detected
        return None

    def _fewest(self, view: ClusterView, sphere: NDArray[np.float64]) -> float:
        """Points below which a cluster is far too little of a sphere to be seen as one: cheaper to
        tell than by a fit."""
        least = min(self._settings.min_visible_fraction, self._settings.min_partly_visible)
        return ROUGHLY_SEEN * least * view.readings_in_outline(sphere)

    def _refined(
        self,
        view: ClusterView,
        fitted: NDArray[np.float64],
        sphere: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Fit twice: only the first fit tells well where the outline is."""
        limits = self._settings.min_radius, self._settings.max_radius
        for _ in range(2):
            around, _ = view.around(sphere)
            beyond = readings_beyond(around, sphere, self._noise)
            sphere, covariance, misfit, inliers = refine_sphere(
                fitted, beyond, sphere, *limits, INLIER_SIGMAS, self._noise
            )
            if not inliers or misfit > self._settings.max_misfit:
                return sphere, covariance, np.inf
        return sphere, covariance, misfit

    def _hypotheses(
        self, points: NDArray[np.float64], total: int, thorough: bool
    ) -> Iterator[NDArray[np.float64]]:
        """The sphere the outline suggests, which mostly is right; those of known radius; then the
        best random ones."""
        yield outline_sphere(points)
        yield from spheres_of_radius(points, self._known_radii)
        if not thorough:
            return
        limits = self._settings.min_radius, self._settings.max_radius
        scored = self._some(points, SCORED_POINTS)
        spheres, scores = ransac_spheres(
            scored, limits, INLIER_SIGMAS, self._noise, self._settings.hypotheses, self._rng
        )
        # A sphere with enough points has a share of those scored; half allows for a rough start.
        needed = 0.5 * self._settings.min_points * len(scored) / total
        for sphere, score in zip(
            spheres[:REFINED_HYPOTHESES], scores[:REFINED_HYPOTHESES], strict=True
        ):
            if score > needed and self._explains(scored, sphere):
                yield sphere

    def _explains(self, points: NDArray[np.float64], sphere: NDArray[np.float64]) -> bool:
        """Whether most points in a rough sphere's outline are on it: a fit is dear."""
        on, against, _, _ = inspect_sphere(points, sphere, INLIER_SIGMAS, self._noise)
        return on > ROUGHLY_ON * (on + against)

    def _some(self, points: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        if len(points) <= count:
            return points
        return points[self._rng.choice(len(points), count, replace=False)]

    def _is_plausible(self, sphere: NDArray[np.float64], covariance: NDArray[np.float64]) -> bool:
        """Size in the limits and told by the points, centre beyond the surface that is seen."""
        settings, radius = self._settings, sphere[3]
        deviation = np.sqrt(covariance[3, 3])
        return bool(
            settings.min_radius - deviation <= radius <= settings.max_radius + deviation
            and deviation <= settings.max_radius_uncertainty * radius
            and np.linalg.norm(sphere[:3]) > radius + settings.min_range
        )

    def _inspected(
        self,
        view: ClusterView,
        sphere: NDArray[np.float64],
        covariance: NDArray[np.float64],
    ) -> DetectedSphere | None:
        settings = self._settings
        around, each = view.around(sphere)
        on, against, visible, density = inspect_sphere(around, sphere, INLIER_SIGMAS, self._noise)
        enough = visible >= settings.min_visible_fraction or (
            visible >= settings.min_partly_visible and density >= MIN_DENSITY
        )
        if (
            each * on < settings.min_points
            or on < settings.min_surface_fraction * (on + against)
            or not enough
        ):
            return None
        covariance = covariance + SYSTEMATIC_ERROR**2 * np.eye(4)
        distance = float(np.linalg.norm(sphere[:3]))
        return DetectedSphere(sphere[:3], float(sphere[3]), covariance, each * on, distance)
