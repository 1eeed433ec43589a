"""Spheres in clusters: RANSAC with MSAC scoring, refinement, and tests that reject false ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.cluster_memory import ClusterMemory
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.foreground import Clusters
from intuitive_physics_perception.detection.sphere_fit import (
    inspect_sphere,
    readings_beyond,
    refine_sphere,
)
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

AROUND = 1.8
"""Radii of the sphere, from its centre, that a window holds."""

MOST_READINGS = 32_768
"""Of a window. More would tell no better whether a sphere is one, and take the time of a frame."""

SIGMAS = 3.0
CLEARER = 9.0
RADIUS_DEVIATION = 1e-4
"""m, of a known radius: covariances stay well away from singular."""


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


def with_known_radius(
    sphere: NDArray[np.float64],
    covariance: NDArray[np.float64],
    radii: Sequence[float],
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return sphere (4,) and covariance (4, 4) given that its radius is one of some known ones.

    A known radius is taken where the fit is compatible with it and clearly not with another; what
    else the fit says of the radius moves the centre, as both go together. Where none fits it stays
    as it is: not everything is known.

    Parameters
    ----------
    tolerance : m, by which a known object may differ
    """
    variance = float(covariance[3, 3])
    if not radii or not np.isfinite(variance) or variance <= 0.0:
        return sphere, covariance
    off = np.array(radii) - sphere[3]
    distances2 = np.square(off) / (variance + (tolerance / SIGMAS) ** 2)
    order = np.argsort(distances2)
    nearest = int(order[0])
    ambiguous = len(radii) > 1 and distances2[order[1]] < distances2[nearest] + CLEARER
    if distances2[nearest] > SIGMAS**2 or ambiguous:
        return sphere, covariance
    # Bayes' rule for a measurement of the radius alone.
    gain = covariance[:, 3] / (variance + RADIUS_DEVIATION**2)
    moved = sphere + gain * off[nearest]
    return moved, covariance - np.outer(gain, covariance[3])
