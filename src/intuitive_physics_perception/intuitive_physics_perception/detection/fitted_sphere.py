"""One sphere fitted to a part of a cluster, and the tests that reject what is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.cluster_view import ClusterView, passing
from intuitive_physics_perception.detection.detections import DetectedSphere, Outline, given_radius
from intuitive_physics_perception.detection.sphere_fit import readings_beyond, refine_sphere
from intuitive_physics_perception.detection.sphere_inspection import (
    inspect_sphere,
    look_round_outline,
)
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.settings import PerceptionSettings

FITTED_POINTS = 1000
"""Points that a sphere is fitted to."""

STRAY_SIGMAS = 5.0
"""Standard deviations of a ray's direction beyond a sphere's outline within which no other one is
looked for: noise must not make a second sphere of what strays farthest."""

MIN_DENSITY = 0.9
"""Part of the disc between readings on a partly visible sphere that must have readings: two scan
lines of a LiDAR make at most 0.7, a sphere cut off by the image's edge makes 1."""

SYSTEMATIC_ERROR = 0.0001
"""Standard deviation of what biases centre and radius in every frame, m."""

NOISE_READINGS = 10.0
"""Independent readings that the noise assumed counts as, against those on a sphere itself, when it
is judged how much noise these have."""

UNEVENNESS = 0.01
"""Standard deviation of a ball's surface from a sphere, in radii: half a millimetre of a 5 cm ball,
3 mm of an exercise ball, which its weight deforms."""

EDGE_GROWTH = 0.7
"""Standard deviation of the part of a pixel, the same all round and in every frame, by which
outlines seem larger or smaller than they are: a matching window lets the nearer side of an edge
grow by up to one pixel (root mean square 0.7 where every second camera does), mixed readings at
edges take about as much away."""

NEW_READINGS = 0.5
"""Part of a sphere's readings that must lie where nothing was before for it to be new in the
scene."""

NEW_GOES_ON = 0.7
"""Part of the ring round its outline in which the cluster of a new sphere may go on: each ball of
its size that it touches covers 0.15, a hand more."""

STATIC_GOES_ON = 0.13
"""`NEW_GOES_ON` of a sphere that was there when the environment was modelled: 2 of 16 sectors, as
where it touches one other thing."""

STATIC_LEVEL = 0.5
"""Part of the ring in which any surface may go on round such a sphere: the plane that a ball lies
on does so in a third of it, seen at 30° from 1.6 m; round a bulge in a plane it does so in all. Our
choice, between both."""

STATIC_LEVEL_OFF_PLANES = 0.25
"""The same for surfaces that are no plane of the environment."""

STATIC_ENDS = 0.3
"""Part of the ring in which something must be read clearly behind such a sphere."""

STATIC_VISIBLE = 0.9
"""Part of the outline in which the surface of such a sphere must be seen; set on the real scenes
for tuning of `make bench-perception`."""

SHAPE_MISFIT = 1.65
"""Mean squared error of the patches of a sphere's surface at most, in variances: three standard
deviations, 3 sqrt(2 / 44), above one for 48 patches and four fitted numbers."""

KNOWN_RADIUS_SIGMAS = 3.0
"""Standard deviations by which a radius may differ from a known one."""

KNOWN_RADIUS_MARGIN = 9.0
"""Squared distance, in variances, by which another known radius must be farther off."""

EXPECTED_REACH = 1.2
"""Radii from a sphere's centre within which readings may be of it. Set by hand."""

INSIDE = 0.9
"""Radii from where a sphere is expected within which readings are of it, whatever it touches: it
may be off by the rest. Set by hand."""

RADIUS_DEVIATION = 1e-4
"""Standard deviation of a known radius in m: numerical, covariances stay far from singular."""


@dataclass(frozen=True, eq=False)
class Part:
    """Some points of a cluster.

    Parameters
    ----------
    points : (n, 3) m
    total : how many these were drawn from
    """

    points: NDArray[np.float64]
    total: int


@dataclass(frozen=True, eq=False)
class SphereFit:
    """A sphere that fits some readings.

    Parameters
    ----------
    sphere : (4,) centre and radius, m
    covariance : (4, 4) m²
    systematic : (4, 4) m², the part of the covariance that all frames share
    noise_scale : variance of its readings along their rays, in that assumed
    """

    sphere: NDArray[np.float64]
    covariance: NDArray[np.float64]
    systematic: NDArray[np.float64]
    noise_scale: float = 1.0

    def with_known_radius(self, radii: Sequence[float], tolerance: float) -> SphereFit:
        """Return the fit, given that some radii are known.

        A known radius is taken where the fit is compatible with it and clearly not with another;
        what else the fit says of the radius moves the centre, as both go together. Where none fits
        it stays as it is: not everything is known.

        `radii` in m, of the known objects; `tolerance` in m, by which a known object may differ.
        """
        variance = float(self.covariance[3, 3])
        if not radii or not np.isfinite(variance) or variance <= 0.0:
            return self
        spread2 = variance + (tolerance / KNOWN_RADIUS_SIGMAS) ** 2
        distances2 = np.square(np.array(radii) - self.sphere[3]) / spread2
        order = np.argsort(distances2)
        nearest = int(order[0])
        ambiguous = (
            len(radii) > 1 and distances2[order[1]] < distances2[nearest] + KNOWN_RADIUS_MARGIN
        )
        if distances2[nearest] > KNOWN_RADIUS_SIGMAS**2 or ambiguous:
            return self
        sphere, frame_part, systematic = given_radius(
            self.sphere,
            self.covariance - self.systematic,
            self.systematic,
            np.arange(4),
            radii[nearest],
            RADIUS_DEVIATION,
        )
        return SphereFit(sphere, frame_part + systematic, systematic, self.noise_scale)


class SphereFitter:
    """Makes spheres of hypotheses.

    `rng`: decides which of many points a sphere is fitted to.
    """

    def __init__(
        self,
        noise: RangeNoise,
        settings: PerceptionSettings,
        rng: np.random.Generator,
    ) -> None:
        self._settings = settings
        self._rng = rng
        self.known_radii = [item.radius for item in settings.known_objects]
        self._sharing = noise.correlated - 1.0
        self.noise = np.square([noise.constant, noise.quadratic, noise.limit, noise.lateral])

    def fitted(
        self,
        view: ClusterView,
        part: Part,
        hypothesis: NDArray[np.float64],
        most_goes_on: float = NEW_GOES_ON,
        *,
        size_is_known: bool = False,
    ) -> DetectedSphere | None:
        """Return the sphere that a hypothesis becomes on a part of a cluster; None where that is no
        object.

        `hypothesis` (4,) m, centre and radius to begin from; `most_goes_on`: part of the ring round
        its outline in which the cluster may go on at most; `size_is_known`: whether the
        radius is known from other frames, so that this one need not show it.
        """
        fit = self._refined(view, part, hypothesis)
        if fit is None:
            return None
        fit = fit.with_known_radius(self.known_radii, self._settings.known_object_tolerance)
        if not self._is_plausible(fit, size_is_known=size_is_known):
            return None
        return self._inspected(view, fit, most_goes_on)

    def part(self, points: NDArray[np.float64]) -> Part:
        """Return as many of some points as a sphere is fitted to.

        `points` (n, 3) m.
        """
        return Part(self.some(points, FITTED_POINTS), len(points))

    def part_near(self, points: NDArray[np.float64], sphere: NDArray[np.float64]) -> Part:
        """Return as many of those points whose rays meet a sphere, or hardly miss it.

        `points` (n, 3) m; `sphere` (4,) m, centre and radius.
        """
        reach = EXPECTED_REACH * sphere[3]
        reach += STRAY_SIGMAS * np.sqrt(self.noise[3]) * np.linalg.norm(sphere[:3])
        return self.part(points[passing(points, sphere[:3]) < reach])

    def part_inside(self, points: NDArray[np.float64], sphere: NDArray[np.float64]) -> Part:
        """Return as many of those points whose rays meet a sphere well inside its outline.

        `points` (n, 3) m; `sphere` (4,) m, centre and radius.
        """
        return self.part(points[passing(points, sphere[:3]) < INSIDE * sphere[3]])

    def some(self, points: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        """Return at most `count` random ones, (m, 3) m, of points (n, 3) m."""
        if len(points) <= count:
            return points
        return points[self._rng.choice(len(points), count, replace=False)]

    def _refined(
        self, view: ClusterView, part: Part, sphere: NDArray[np.float64]
    ) -> SphereFit | None:
        """Fit twice: the outline and the noise of the surface are known well only after the first
        fit."""
        limits = self._settings.min_radius, self._settings.max_radius
        shared = self._sharing * len(part.points) / part.total
        # Readings that are no image share nothing with neighbours as a rule, and the edges that a
        # scanner's beam smears weigh too much where the others weigh less.
        sharing, growth, doubt = 0.0, 0.0, 1.0 + shared
        if view.is_organised:
            sharing, growth, doubt = shared, EDGE_GROWTH * view.pixel, 1.0
        scale, noise = 1.0, self.noise
        for _ in range(2):
            around, _ = view.around(sphere)
            beyond = readings_beyond(around, sphere, self.noise)
            fit = refine_sphere(part.points, beyond, sphere, *limits, noise, sharing, growth)
            if not fit.inliers or fit.misfit * scale > self._settings.max_misfit:
                return None
            sphere = fit.sphere
            scale *= self._noise_scale(fit.misfit, fit.inliers / (1.0 + shared) - 4.0)
            noise = self.noise * [scale, scale, scale, 1.0]
        systematic = np.outer(fit.shift, fit.shift) + SYSTEMATIC_ERROR**2 * np.eye(4)
        return SphereFit(sphere, doubt * fit.covariance + systematic, systematic, scale)

    def _noise_scale(self, misfit: float, freedom: float) -> float:
        """Factor by which the variance of a surface's readings differs from the assumed one, as
        its misfit in so many degrees of freedom says: the mean of a scaled inverse χ² posterior,
        roughly, that begins at one with `NOISE_READINGS`."""
        prior, freedom = NOISE_READINGS, max(freedom, 0.0)
        return (prior + freedom * misfit) / (prior + freedom)

    def _is_plausible(self, fit: SphereFit, *, size_is_known: bool) -> bool:
        """Size in the limits and known well, centre beyond the surface that is seen."""
        settings, radius = self._settings, fit.sphere[3]
        deviation = np.sqrt(fit.covariance[3, 3])
        return bool(
            settings.min_radius - deviation <= radius <= settings.max_radius + deviation
            and (size_is_known or deviation <= settings.max_radius_uncertainty * radius)
            and np.linalg.norm(fit.sphere[:3]) > radius + settings.min_range
        )

    def _inspected(
        self, view: ClusterView, fit: SphereFit, most_goes_on: float
    ) -> DetectedSphere | None:
        settings, sphere = self._settings, fit.sphere
        around, each = view.around(sphere)
        inspection = inspect_sphere(around, sphere, self.noise)
        enough = inspection.visible >= settings.min_visible_fraction or (
            inspection.visible >= settings.min_partly_visible and inspection.density >= MIN_DENSITY
        )
        if (
            each * inspection.on < settings.min_points
            or inspection.on < settings.min_surface_fraction * (inspection.on + inspection.against)
            or not enough
        ):
            return None
        outline = self._outline(view, fit, inspection.visible)
        if outline is None or not _may_be_object(outline, most_goes_on):
            return None
        return DetectedSphere(
            sphere[:3],
            float(sphere[3]),
            fit.covariance,
            each * inspection.on,
            float(np.linalg.norm(sphere[:3])),
            systematic=fit.systematic,
            outline=outline,
        )

    def _outline(self, view: ClusterView, fit: SphereFit, visible: float) -> Outline | None:
        """How the sphere stands apart from what is about it; None where its surface is none."""
        seen = look_round_outline(*view.surroundings(fit.sphere), fit.sphere, view.pixel, self.noise)
        if self._misfit_of(seen.patches, fit) > SHAPE_MISFIT:
            return None
        new = seen.new if view.knows_before else None
        level_off_planes = seen.level_off_planes if view.knows_before else seen.level
        return Outline(new, seen.goes_on, seen.level, level_off_planes, seen.ends, visible)

    def _misfit_of(self, patches: NDArray[np.float64], fit: SphereFit) -> float:
        """Mean squared error of the surface's patches (n, 3) of `OutlineView`, in variances.

        The mean of a patch averages the noise away, so that it distinguishes shapes that differ by
        less than the noise of one reading: about one for a sphere.
        """
        readings, errors, variances = patches[patches[:, 0] > 0.0].T
        shared = np.minimum(1.0 + self._sharing, readings)
        unevenness = UNEVENNESS * float(fit.sphere[3])
        spread = fit.noise_scale * variances * shared / readings + unevenness**2
        return float(np.sum(errors**2 / spread) / max(len(errors) - 4, 1))


def _may_be_object(outline: Outline, most_goes_on: float) -> bool:
    """Whether a sphere may be an object of its own and not a part of something larger.

    What has come where nothing was is most likely an object, and may touch others. What was there
    already, or where nobody has looked, is most likely not, so it must end all round its outline
    and be seen as a whole.
    """
    if outline.new is None or outline.new > NEW_READINGS:
        return outline.goes_on <= most_goes_on
    return stands_apart(outline)


def stands_apart(outline: Outline) -> bool:
    """Return whether a sphere ends all round its outline and is seen as a whole."""
    return (
        outline.goes_on <= STATIC_GOES_ON
        and outline.level <= STATIC_LEVEL
        and outline.level_off_planes <= STATIC_LEVEL_OFF_PLANES
        and outline.ends >= STATIC_ENDS
        and outline.visible >= STATIC_VISIBLE
    )
