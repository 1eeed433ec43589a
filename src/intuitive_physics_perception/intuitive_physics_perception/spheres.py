"""Spheres in clusters: RANSAC with MSAC scoring, refinement, and tests that reject what is none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.cluster_memory import ClusterMemory
from intuitive_physics_perception.foreground import Clusters
from intuitive_physics_perception.known_radius import with_known_radius
from intuitive_physics_perception.noise import RangeNoise
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.sphere_fit import readings_beyond, refine_sphere
from intuitive_physics_perception.sphere_inspection import inspect_sphere
from intuitive_physics_perception.sphere_ransac import (
    outline_sphere,
    ransac_spheres,
    spheres_of_radius,
)

SCORED_POINTS = 512
FITTED_POINTS = 1000
REFINED_HYPOTHESES = 3
SPHERES_IN_CLUSTER = 3
INLIER_SIGMAS = 3.0
STRAY_SIGMAS = 5.0
AROUND = 1.8
MIN_DENSITY = 0.9
STILLNESS = 0.2
SYSTEMATIC_ERROR = 0.0005


@dataclass(frozen=True, eq=False)
class DetectedSphere:
    """A sphere in one frame.

    Parameters
    ----------
    center : (3,) m
    radius : m
    covariance : (4, 4) of centre and radius, m²
    points : readings on its surface
    range : m from the sensor to the centre
    """

    center: NDArray[np.float64]
    radius: float
    covariance: NDArray[np.float64]
    points: int
    range: float

    def moved(
        self, rotation: NDArray[np.float64], translation: NDArray[np.float64]
    ) -> DetectedSphere:
        """Return it in another frame, p_other = rotation p + translation."""
        turn = np.eye(4)
        turn[:3, :3] = rotation
        return replace(
            self,
            center=rotation @ self.center + translation,
            covariance=turn @ self.covariance @ turn.T,
        )


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

    def find(self, points: NDArray[np.float32], clusters: Clusters) -> list[ClusterSpheres]:
        """Return the spheres by cluster of a frame of points (height, width, 3), in the sensor's
        frame."""
        found = []
        for cluster in clusters.indices:
            own = points.reshape(-1, 3)[cluster].astype(np.float64)
            known = self._memory.recall(own)
            inside = self._spheres_in(points, cluster, own, thorough=known.deserves_a_search)
            if not inside.spheres:
                self._memory.keep(known, None)
            found.append(inside)
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
            sphere = self._best_sphere(points, left, own, thorough=thorough)
            if sphere is None:
                break
            found.append(sphere)
            # Noise must not make a second sphere of the readings that stray farthest.
            reach = 1.2 * sphere.radius + STRAY_SIGMAS * self._deviation(sphere.range)
            off = np.linalg.norm(own - sphere.center, axis=1) > reach
            left, own = left[off], own[off]
        return ClusterSpheres(cluster, found, len(own) / len(cluster))

    def _best_sphere(
        self,
        points: NDArray[np.float32],
        cluster: NDArray[np.int64],
        own: NDArray[np.float64],
        *,
        thorough: bool,
    ) -> DetectedSphere | None:
        fitted = self._some(own, FITTED_POINTS)
        for hypothesis in self._hypotheses(fitted, len(own), thorough):
            sphere, covariance, misfit = self._refined(points, cluster, fitted, hypothesis)
            # The fit took part of the points: the rest tells as much again.
            covariance = covariance * self._settings.correlated_readings * len(fitted) / len(own)
            sphere, covariance = with_known_radius(
                sphere, covariance, self._known_radii, self._settings.known_object_tolerance
            )
            if misfit < self._settings.max_misfit and self._is_plausible(sphere, covariance):
                detected = self._inspected(points, cluster, sphere, covariance)
                if detected is not None:
                    return detected
        return None

    def _refined(
        self,
        points: NDArray[np.float32],
        cluster: NDArray[np.int64],
        fitted: NDArray[np.float64],
        sphere: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Fit twice: only the first fit tells well where the outline is."""
        limits = self._settings.min_radius, self._settings.max_radius
        for _ in range(2):
            around = points_around(points, cluster, sphere)
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
            if score > needed:
                yield sphere

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
        points: NDArray[np.float32],
        cluster: NDArray[np.int64],
        sphere: NDArray[np.float64],
        covariance: NDArray[np.float64],
    ) -> DetectedSphere | None:
        settings = self._settings
        around = points_around(points, cluster, sphere)
        on, against, visible, density = inspect_sphere(around, sphere, INLIER_SIGMAS, self._noise)
        enough = visible >= settings.min_visible_fraction or (
            visible >= settings.min_partly_visible and density >= MIN_DENSITY
        )
        if (
            on < settings.min_points
            or on < settings.min_surface_fraction * (on + against)
            or not enough
        ):
            return None
        covariance = covariance + SYSTEMATIC_ERROR**2 * np.eye(4)
        distance = float(np.linalg.norm(sphere[:3]))
        return DetectedSphere(sphere[:3], float(sphere[3]), covariance, on, distance)


def points_around(
    points: NDArray[np.float32], cluster: NDArray[np.int64], sphere: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return (n, 3) readings among which are all in the outline of a sphere that the cluster is
    part of: all of an unorganised cloud, a window of an organised one."""
    height, width = points.shape[:2]
    if height == 1:
        return points[0]
    directions = points.reshape(-1, 3)[cluster]
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    rows, columns = np.divmod(cluster, width)
    pixels = float(np.hypot(np.ptp(rows), np.ptp(columns)))
    pitch = float(np.linalg.norm(np.ptp(directions, axis=0))) / max(pixels, 1.0)
    centre = sphere[:3] / np.linalg.norm(sphere[:3])
    away = np.linalg.norm(directions - centre, axis=1)
    nearest = int(away.argmin())
    row, column = int(rows[nearest]), int(columns[nearest])
    reach = float(away[nearest]) + AROUND * sphere[3] / float(np.linalg.norm(sphere[:3]))
    half = int(min(reach / max(pitch, 1e-6), max(height, width))) + 2
    window = points[max(row - half, 0) : row + half + 1, max(column - half, 0) : column + half + 1]
    return np.ascontiguousarray(window).reshape(-1, 3)


def without_doubles(spheres: list[DetectedSphere]) -> list[DetectedSphere]:
    """Of spheres that share space keep the one with more points."""
    kept: list[DetectedSphere] = []
    for sphere in sorted(spheres, key=lambda sphere: -sphere.points):
        if all(
            np.linalg.norm(sphere.center - other.center) > max(sphere.radius, other.radius)
            for other in kept
        ):
            kept.append(sphere)
    return kept
