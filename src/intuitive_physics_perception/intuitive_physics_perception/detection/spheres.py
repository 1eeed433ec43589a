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
from intuitive_physics_perception.detection.settings import SphereDetectionSettings
from intuitive_physics_perception.detection.sphere_fit import (
    inspect_sphere,
    look_round_outline,
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

ALIKE = 0.2
"""Difference of centres and radii, in radii, of hypotheses of which only one is fitted: the widest
gate of a fit reaches farther. Set by hand."""

RADIUS_DEVIATION = 1e-4
"""Standard deviation of a known radius in m: numerical, covariances stay far from singular."""


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
    before : (height, width) m, what an organised cloud read when the environment was modelled, NaN
        where nothing was; None where it is not known
    """

    def __init__(
        self,
        noise: RangeNoise,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        before: NDArray[np.float32] | None = None,
    ) -> None:
        self._before = before
        self._settings = settings
        self._search = settings.spheres
        self._rng = rng
        self._memory: ClusterMemory[None] = ClusterMemory(
            settings.clusters.movement * settings.min_radius, settings.clusters
        )
        self._known_radii = [one.radius for one in settings.known_objects]
        self._deviation = noise.deviation
        self._sharing = noise.correlated - 1.0
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
        while (
            len(found) < self._search.spheres_in_cluster and len(own) >= self._settings.min_points
        ):
            sphere = self._best_sphere(
                ClusterView(points, left, self._search, self._before), own, thorough=thorough
            )
            if sphere is None:
                break
            found.append(sphere)
            # Noise must not make a second sphere of the readings that stray farthest.
            reach = 1.2 * sphere.radius + self._search.stray_sigmas * self._deviation(sphere.range)
            off = np.linalg.norm(own - sphere.center, axis=1) > reach
            left, own = left[off], own[off]
        return ClusterSpheres(cluster, found, len(own) / len(cluster))

    def _best_sphere(
        self, view: ClusterView, own: NDArray[np.float64], *, thorough: bool
    ) -> DetectedSphere | None:
        fitted = self._some(own, self._search.fitted_points)
        for hypothesis in self._hypotheses(fitted, len(own), thorough):
            if len(own) < self._fewest(view, hypothesis):
                continue
            sphere, covariance, misfit = self._refined(
                view, fitted, hypothesis, self._sharing * len(fitted) / len(own)
            )
            sphere, covariance = with_known_radius(
                sphere,
                covariance,
                self._known_radii,
                self._settings.known_object_tolerance,
                self._search,
            )
            if misfit < self._settings.max_misfit and self._is_plausible(sphere, covariance):
                detected = self._inspected(view, sphere, covariance)
                if detected is not None:
                    return detected
        return None

    def _fewest(self, view: ClusterView, sphere: NDArray[np.float64]) -> float:
        """Points below which a cluster is far too little of a sphere to be seen as one: a cheap
        test before the fit."""
        least = min(self._settings.min_visible_fraction, self._settings.min_partly_visible)
        return self._search.roughly_seen * least * view.readings_in_outline(sphere)

    def _refined(
        self,
        view: ClusterView,
        fitted: NDArray[np.float64],
        sphere: NDArray[np.float64],
        sharing: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Fit twice: the outline is known well only after the first fit."""
        limits = self._settings.min_radius, self._settings.max_radius
        for _ in range(2):
            around, _ = view.around(sphere)
            beyond = readings_beyond(around, sphere, self._noise)
            sphere, covariance, misfit, inliers = refine_sphere(
                fitted, beyond, sphere, *limits, self._search.inlier_sigmas, self._noise, sharing
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
        scored = self._some(points, self._search.scored_points)
        spheres, scores = ransac_spheres(
            scored,
            limits,
            self._search.inlier_sigmas,
            self._noise,
            self._settings.hypotheses,
            self._rng,
        )
        # A sphere with enough points has a share of those scored; half allows for a rough start.
        needed = 0.5 * self._settings.min_points * len(scored) / total
        tried: list[NDArray[np.float64]] = []
        for sphere, score in zip(spheres, scores, strict=True):
            if score <= needed or len(tried) >= self._search.refined_hypotheses:
                return
            if any(_are_alike(sphere, other) for other in tried):
                continue
            if self._explains(scored, sphere):
                tried.append(sphere)
                yield sphere

    def _explains(self, points: NDArray[np.float64], sphere: NDArray[np.float64]) -> bool:
        """Cheap inlier test before refinement: are most points in the outline on the sphere?"""
        on, against, _, _ = inspect_sphere(points, sphere, self._search.inlier_sigmas, self._noise)
        return on > self._search.roughly_on * (on + against)

    def _some(self, points: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        if len(points) <= count:
            return points
        return points[self._rng.choice(len(points), count, replace=False)]

    def _is_plausible(self, sphere: NDArray[np.float64], covariance: NDArray[np.float64]) -> bool:
        """Size in the limits and known well, centre beyond the surface that is seen."""
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
        on, against, visible, density = inspect_sphere(
            around, sphere, self._search.inlier_sigmas, self._noise
        )
        enough = visible >= settings.min_visible_fraction or (
            visible >= settings.min_partly_visible and density >= self._search.min_density
        )
        if (
            each * on < settings.min_points
            or on < settings.min_surface_fraction * (on + against)
            or not enough
            or not self._is_object(view, sphere, visible)
        ):
            return None
        systematic = self._search.systematic_error
        return DetectedSphere(
            sphere[:3],
            float(sphere[3]),
            covariance + systematic**2 * np.eye(4),
            each * on,
            float(np.linalg.norm(sphere[:3])),
            systematic_error=systematic,
        )

    def _is_object(self, view: ClusterView, sphere: NDArray[np.float64], visible: float) -> bool:
        """Whether the sphere is an object of its own and not a part of something larger.

        What has come into the scene since the environment was modelled is most likely an object,
        and may touch others. What was there already is most likely not, so it must end all round
        its outline and be seen as a whole.
        """
        search = self._search
        goes_on, level, ends, new, patches = look_round_outline(
            *view.surroundings(sphere), sphere, view.pixel, search.inlier_sigmas, self._noise
        )
        if self._before is None or new > search.new_readings:
            return goes_on <= search.new_goes_on
        return (
            goes_on <= search.static_goes_on
            and level <= search.static_level
            and ends >= search.static_ends
            and visible >= search.static_visible
            and self._misfit_of(patches) <= search.static_misfit
        )

    def _misfit_of(self, patches: NDArray[np.float64]) -> float:
        """Mean squared error of the surface's patches (n, 3) of `look_round_outline`, in variances.

        The mean of a patch averages the noise away, so that it tells shapes apart that differ by
        less than the noise of one reading: about one for a sphere.
        """
        readings, errors, variances = patches[patches[:, 0] > 0.0].T
        shared = np.minimum(1.0 + self._sharing, readings)
        spread = variances * shared / readings + self._search.systematic_error**2
        return float(np.sum(errors**2 / spread) / max(len(errors) - 4, 1))


def _are_alike(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Whether a fit that begins at one of two spheres (4,) most likely ends as from the other."""
    return bool(np.abs(first - second).max() < ALIKE * min(first[3], second[3]))


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
        self._points = points
        self._cluster = cluster

    def readings_in_outline(self, sphere: NDArray[np.float64]) -> float:
        """Return how many pixels the outline of a sphere (4,) has; 0 in an unorganised cloud."""
        if self._points.shape[0] == 1:
            return 0.0
        sine = min(float(sphere[3]) / float(np.linalg.norm(sphere[:3])), 1.0)
        return np.pi * (sine / self.pixel) ** 2

    def around(self, sphere: NDArray[np.float64]) -> tuple[NDArray[np.float32], int]:
        """Return readings (n, 3) about a sphere (4,) that the cluster is part of, and how many
        each stands for.

        All of an unorganised cloud; of an organised one a window that holds the sphere's outline.
        """
        if self._points.shape[0] == 1:
            return self._points[0], 1
        window = self._points[self._window(sphere)]
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
        own = np.zeros(self._points.shape[:2], dtype=bool)
        own.ravel()[self._cluster] = True
        window = self._window(sphere)
        points = np.ascontiguousarray(self._points[window]).reshape(-1, 3)
        before = np.full(len(points), np.nan, dtype=np.float32)
        if self._before is not None:
            before = self._before[window].ravel()
        return points, own[window].ravel(), before

    def _window(self, sphere: NDArray[np.float64]) -> tuple[slice, slice]:
        """Rows and columns of an organised cloud that hold a sphere's outline and what is round it;
        all of an unorganised one."""
        height, width = self._points.shape[:2]
        if height == 1:
            return slice(None), slice(None)
        distance = float(np.linalg.norm(sphere[:3]))
        away = np.linalg.norm(self._directions - sphere[:3] / distance, axis=1)
        nearest = int(away.argmin())
        row, column = divmod(int(self._cluster[nearest]), width)
        reach = float(away[nearest]) + self._settings.window_radii * float(sphere[3]) / distance
        half = int(min(reach / self.pixel, max(height, width))) + 5
        rows = slice(max(row - half, 0), row + half + 1)
        columns = slice(max(column - half, 0), column + half + 1)
        return rows, columns

    @cached_property
    def _directions(self) -> NDArray[np.float32]:
        own = self._points.reshape(-1, 3)[self._cluster]
        return np.asarray(own / np.linalg.norm(own, axis=1, keepdims=True))

    @cached_property
    def pixel(self) -> float:
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
    settings: SphereDetectionSettings,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return sphere (4,) m and covariance (4, 4) m², given that some radii are known.

    A known radius is taken where the fit is compatible with it and clearly not with another; what
    else the fit says of the radius moves the centre, as both go together. Where none fits it stays
    as it is: not everything is known.

    Parameters
    ----------
    sphere : (4,) centre and radius, m
    covariance : (4, 4) m²
    radii : m, of the known objects
    tolerance : m, by which a known object may differ
    settings : tuned numbers
    """
    variance = float(covariance[3, 3])
    if not radii or not np.isfinite(variance) or variance <= 0.0:
        return sphere, covariance
    off = np.array(radii) - sphere[3]
    distances2 = np.square(off) / (variance + (tolerance / settings.known_radius_sigmas) ** 2)
    order = np.argsort(distances2)
    nearest = int(order[0])
    ambiguous = (
        len(radii) > 1 and distances2[order[1]] < distances2[nearest] + settings.known_radius_margin
    )
    if distances2[nearest] > settings.known_radius_sigmas**2 or ambiguous:
        return sphere, covariance
    # Bayes' rule for a measurement of the radius alone.
    gain = covariance[:, 3] / (variance + RADIUS_DEVIATION**2)
    moved = sphere + gain * off[nearest]
    return moved, covariance - np.outer(gain, covariance[3])
