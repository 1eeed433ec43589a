"""One sphere fitted to a part of a cluster, and the tests that reject what is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.cluster_view import ClusterView
from intuitive_physics_perception.detection.detections import (
    NEW_GOES_ON,
    DetectedSphere,
    Outline,
    given_radius,
)
from intuitive_physics_perception.detection.sphere_fit import (
    SphereSolution,
    readings_beyond,
    refine_sphere,
)
from intuitive_physics_perception.detection.sphere_inspection import (
    SECTORS,
    OutlineView,
    bulge_of,
    inspect_sphere,
    look_round_outline,
    outside_in_sectors,
    touched_sectors,
)
from intuitive_physics_perception.detection.swept_sphere import (
    SWEPT_DOUBT,
    Sweep,
    SweptView,
    fit_sweep,
    passing_way,
    unswept,
)
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.settings import PerceptionSettings

NO_SECTOR = np.zeros(SECTORS, dtype=bool)
"""Marks of sectors of an outline: nothing touches it."""

FITTED_POINTS = 1000
"""Points that a sphere is fitted to."""

STRAY_SIGMAS = 5.0
"""Standard deviations of a ray's direction beyond a sphere's outline within which no other one is
looked for: noise must not make a second sphere of what strays farthest."""

MAX_MISFIT = 1.5
"""Mean squared residual of a surface, in variances of the noise, at most."""

MAX_RADIUS_UNCERTAINTY = 0.15
"""Standard deviation of a fitted radius, in radii, that is still a sphere."""

MIN_ON_SURFACE = 0.9
"""Part of the readings in a sphere's outline that must lie on its surface."""

MIN_VISIBLE = 0.45
"""Part of a sphere's outline in which its surface must be seen."""

MIN_PARTLY_VISIBLE = 0.15
"""The same for a sphere that is hidden or cut off but densely seen."""

MIN_DENSITY = 0.9
"""Part of the disc between readings on a partly visible sphere that must have readings: two scan
lines of a LiDAR make at most 0.7, a sphere cut off by the image's edge makes 1."""

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

CARRIER_COSINE = 0.94
"""Cosine of the steepest slope, 20°, of a plane that carries what lies on it."""

CARRIED_SIGMAS = 3.0
"""Standard deviations by which the height of a sphere that lies on a plane may differ from its
radius."""

CARRIED_MARGIN = 0.1
"""Radii that are added to that, for planes that are not quite flat. Set by hand."""

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
    times : (n,) of each, as in `ClusterView.times_of`
    total : how many these were drawn from
    """

    points: NDArray[np.float64]
    times: NDArray[np.float64]
    total: int


@dataclass(frozen=True, eq=False)
class Start:
    """A sphere to begin a fit from.

    Parameters
    ----------
    sphere : (4,) m, centre and radius
    sweep : (3,) m, way of its centre during the exposure, either end of which may be the first, or
        from the first reading of a scan to its last
    sweep_deviation : standard deviation of each component of the sweep, m; 0 where it is exact
    size_is_known : whether other frames have shown its radius, so that this one need not
    is_object : whether other frames have shown that it is an object
    must_end : whether it must end where no other sphere touches it: the part of a cluster that it
        is fitted to would be a ball even at the tip of a finger
    """

    sphere: NDArray[np.float64]
    sweep: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    sweep_deviation: float = 0.0
    size_is_known: bool = False
    is_object: bool = False
    must_end: bool = False

    def seen_from(self, model: EnvironmentModel) -> Start:
        """Return it in the sensor's frame."""
        place = model.to_sensor(self.sphere[:3])
        return replace(
            self,
            sphere=np.append(place, self.sphere[3]),
            sweep=self.sweep @ model.rotation,
        )


@dataclass(frozen=True, eq=False)
class SphereFit:
    """A sphere that fits some readings.

    Parameters
    ----------
    sphere : (4,) centre and radius, m
    covariance : (4, 4) m²
    systematic : (4, 4) m², the part of the covariance that all frames share
    noise_scale : variance of its readings along their rays, in that assumed
    sweep : (3,) m, way of its centre during the exposure
    """

    sphere: NDArray[np.float64]
    covariance: NDArray[np.float64]
    systematic: NDArray[np.float64]
    noise_scale: float = 1.0
    sweep: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

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
        return replace(
            self, sphere=sphere, covariance=frame_part + systematic, systematic=systematic
        )


@dataclass(frozen=True, eq=False)
class BegunFit:
    """A sphere after the first of two fits.

    Parameters
    ----------
    view, part, sweep : readings, as of a ball that rests, and its sweep
    sphere : (4,) m, that the first fit found
    scale : variance of the readings along their rays, in that assumed
    """

    view: ClusterView
    part: Part
    sweep: Sweep
    sphere: NDArray[np.float64]
    scale: float


def rounding_covariance(sphere: NDArray[np.float64], pixel: float) -> NDArray[np.float64]:
    """Return the covariance (4, 4) m² of centre and radius as an outline ends at whole pixels.

    Each of the n = 2 π r / p pixels of its edge, p wide where the sphere is, is off by anything up
    to half a pixel, p² / 12. A circle's radius has 1 / n of that, and moves the centre behind the
    surface that is seen; its centre has 2 / n. A ball at rest is off alike in all frames.

    `sphere` (4,) centre and radius, m; `pixel` in rad, the angle between neighbours.
    """
    distance = float(np.linalg.norm(sphere[:3]))
    toward, width = sphere[:3] / distance, pixel * distance
    variance = width**3 / (12.0 * np.pi * float(sphere[3]))
    larger = np.append(toward, 1.0)
    covariance = 0.5 * variance * np.outer(larger, larger)
    covariance[:3, :3] += variance * (np.eye(3) - np.outer(toward, toward))
    return covariance


class SphereFitter:
    """Makes spheres of hypotheses.

    `rng`: decides which of many points a sphere is fitted to.
    """

    def __init__(
        self, noise: RangeNoise, settings: PerceptionSettings, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._rng = rng
        self.known_radii = [item.radius for item in settings.known_objects]
        self._sharing = noise.correlated - 1.0
        self.noise = noise.squares
        self._carriers = np.zeros((0, 4))

    def look_from(self, model: EnvironmentModel) -> None:
        """Take the planes that may carry a sphere, as the sensor sees them now."""
        up = model.rotation.T @ [0.0, 0.0, 1.0]
        carriers = [
            plane.numbers for plane in model.detected if plane.normal @ up >= CARRIER_COSINE
        ]
        self._carriers = np.array(carriers).reshape(-1, 4)

    def fitted(
        self,
        view: ClusterView,
        part: Part,
        start: Start,
        most_goes_on: float = NEW_GOES_ON,
        *,
        beside_others: bool = False,
    ) -> DetectedSphere | None:
        """Return the sphere that a start becomes on a part of a cluster; None where that is no
        object.

        `most_goes_on`: part of the ring round its outline in which the cluster may go on at most;
        `beside_others`: whether what it touches may be other spheres, which are no readings of it.
        """
        swept = self._swept(view, part, start) if part.total else None
        begun = None if swept is None else self._begun(*swept)
        if begun is None:
            return None
        if start.size_is_known or beside_others:
            return self._judged(begun, start, most_goes_on, self._touched(begun))
        sphere = self._judged(begun, start, most_goes_on, NO_SECTOR)
        if sphere is None or not (touched := self._touched(begun)).any():
            return sphere
        # What may be no ball is judged by all readings, but measured without those beside it.
        return self._judged(begun, start, most_goes_on, touched) or sphere

    def _judged(
        self, begun: BegunFit, start: Start, most_goes_on: float, touched: NDArray[np.bool_]
    ) -> DetectedSphere | None:
        """The sphere by all readings but those beyond it in touched sectors; None if no object."""
        fit = self._refined(begun, touched)
        if fit is None:
            return None
        fit = fit.with_known_radius(self.known_radii, self._settings.known_object_tolerance)
        if not self._is_plausible(fit, size_is_known=start.size_is_known):
            return None
        return self._inspected(begun.view, fit, most_goes_on, is_object=start.is_object)

    def longest_sweep(self, view: ClusterView) -> float:
        """Return the way, m, that an object may go while a cluster is read."""
        lasting = self._settings.exposure if view.scan is None else view.scan.duration
        return self._settings.max_speed * lasting

    def part(self, view: ClusterView, chosen: NDArray[np.bool_] | None = None) -> Part:
        """Return as many of a cluster's points, or of those that are chosen, (n,), as a sphere is
        fitted to."""
        every = np.arange(len(view.cluster)) if chosen is None else np.flatnonzero(chosen)
        some = every
        if len(every) > FITTED_POINTS:
            some = every[self._rng.choice(len(every), FITTED_POINTS, replace=False)]
        return Part(view.readings[some], view.times_of(view.cluster[some]), len(every))

    def part_near(self, view: ClusterView, start: Start) -> Part:
        """Return as many of those points whose rays meet a sphere, or hardly miss it."""
        reach = EXPECTED_REACH * start.sphere[3]
        reach += STRAY_SIGMAS * np.sqrt(self.noise[3]) * np.linalg.norm(start.sphere[:3])
        passed = passing_way(view.readings, start.sphere[:3], start.sweep)
        return self.part(view, passed < reach)

    def part_inside(self, view: ClusterView, start: Start) -> Part:
        """Return as many of those points whose rays meet a sphere well inside its outline."""
        passed = passing_way(view.readings, start.sphere[:3], start.sweep)
        return self.part(view, passed < INSIDE * start.sphere[3])

    def _swept(
        self, view: ClusterView, part: Part, start: Start
    ) -> tuple[ClusterView, Part, Sweep] | None:
        """Readings as of a ball that rests in mid-exposure, and its sweep; None where none fits."""
        at_rest = Sweep(start.sphere, np.zeros(3), np.zeros((4, 4)))
        if start.sweep_deviation == 0.0:
            return view, part, at_rest
        if len(part.points) < self._settings.min_points:
            return None
        deviation, sharing = start.sweep_deviation, self._shared(part)
        readings, begin = (part.points, part.times), (start.sphere, start.sweep)
        sweep = fit_sweep(*readings, *begin, deviation, self.noise, sharing)
        if not float(np.linalg.norm(sweep.sweep)) <= self.longest_sweep(view):
            return None
        moved = replace(part, points=unswept(*readings, sweep.sphere, sweep.sweep))
        return SweptView(view, sweep.sphere, sweep.sweep), moved, sweep

    def _begun(self, view: ClusterView, part: Part, sweep: Sweep) -> BegunFit | None:
        """Fit a first time: outline and noise of the surface are known well only then."""
        step = self._step(view, part, part.points, sweep.sphere, 1.0)
        return None if step is None else BegunFit(view, part, sweep, step[0].sphere, step[1])

    def _touched(self, begun: BegunFit) -> NDArray[np.bool_]:
        """Sectors (SECTORS,) of the outline in which the cluster goes on."""
        return touched_sectors(self._looked_round(begun.view, begun.sphere)[0])

    def _refined(self, begun: BegunFit, touched: NDArray[np.bool_]) -> SphereFit | None:
        """Fit a second time. Where the cluster goes on past the outline, as into a hand, there is
        no outline: what lies outside of it in such sectors would draw the sphere to its side, and
        is left out."""
        view, part, sweep, points = begun.view, begun.part, begun.sweep, begun.part.points
        if touched.any():
            points = points[~outside_in_sectors(points, begun.sphere, touched)]
        step = self._step(view, part, points, begun.sphere, begun.scale)
        if step is None:
            return None
        fit, scale = step
        systematic = np.outer(fit.shift, fit.shift)
        if view.is_organised:
            systematic += rounding_covariance(fit.sphere, view.pixel)
        # The edges that a scanner's beam smears weigh too much where the others weigh less.
        doubt = 1.0 if view.is_organised else 1.0 + self._shared(part)
        doubt *= SWEPT_DOUBT if sweep.sweep.any() and view.scan is None else 1.0
        covariance = doubt * fit.covariance + sweep.spread + systematic
        return SphereFit(fit.sphere, covariance, systematic, scale, sweep.sweep)

    def _step(
        self,
        view: ClusterView,
        part: Part,
        points: NDArray[np.float64],
        sphere: NDArray[np.float64],
        scale: float,
    ) -> tuple[SphereSolution, float] | None:
        """What `refine_sphere` makes of a sphere, and the variance of the noise in that assumed."""
        limits = self._settings.min_radius, self._settings.max_radius
        # Readings that are no image share nothing with neighbours as a rule.
        sharing, growth = 0.0, 0.0
        if view.is_organised:
            sharing = self._shared(part)
            growth = EDGE_GROWTH * view.pixel
        around, _ = view.around(sphere)
        beyond = readings_beyond(around, sphere, self.noise)
        noise = self.noise * [scale, scale, scale, 1.0]
        fit = refine_sphere(points, beyond, sphere, *limits, noise, sharing, growth)
        if not fit.inliers or fit.misfit * scale > MAX_MISFIT:
            return None
        freedom = fit.inliers / (1.0 + self._shared(part)) - 4.0
        return fit, scale * self._noise_scale(fit.misfit, freedom)

    def _shared(self, part: Part) -> float:
        """How many others among the points of a part share the error of one along its ray."""
        return self._sharing * len(part.points) / part.total

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
            and (size_is_known or deviation <= MAX_RADIUS_UNCERTAINTY * radius)
            and np.linalg.norm(fit.sphere[:3]) > radius + settings.min_range
        )

    def _inspected(
        self, view: ClusterView, fit: SphereFit, most_goes_on: float, *, is_object: bool
    ) -> DetectedSphere | None:
        sphere = fit.sphere
        around, each = view.around(sphere)
        inspection = inspect_sphere(around, sphere, self.noise)
        enough = inspection.visible >= MIN_VISIBLE or (
            inspection.visible >= MIN_PARTLY_VISIBLE and inspection.density >= MIN_DENSITY
        )
        if (
            each * inspection.on < self._settings.min_points
            or inspection.on < MIN_ON_SURFACE * (inspection.on + inspection.against)
            or not enough
        ):
            return None
        outline = self._outline(view, fit, inspection.visible)
        if outline is None or not outline.may_be_object(most_goes_on, is_object=is_object):
            return None
        return DetectedSphere(
            sphere[:3],
            float(sphere[3]),
            fit.covariance,
            each * inspection.on,
            float(np.linalg.norm(sphere[:3])),
            systematic=fit.systematic,
            sweep=fit.sweep,
            outline=outline,
            delay=view.middle if fit.sweep.any() else 0.0,
        )

    def _outline(self, view: ClusterView, fit: SphereFit, visible: float) -> Outline | None:
        """How the sphere stands apart from what is about it; None where its surface is none."""
        seen, each = self._looked_round(view, fit.sphere)
        spread = self._spread_of(seen.patches, each, fit)
        errors = seen.patches[seen.patches[:, 0] > 0.0, 1]
        # The mean of a patch averages the noise away, so that it distinguishes shapes that differ
        # by less than the noise of one reading: about one for a sphere.
        if np.sum(errors**2 / spread) > SHAPE_MISFIT * max(len(errors) - 4, 1):
            return None
        bulge = bulge_of(seen.patches, spread, float(fit.sphere[3]))
        goes_on = float(np.mean(seen.going_on > 0.5))
        return Outline(
            new=None if view.marks is None else seen.new,
            known=None if view.marks is None else seen.known,
            unknown=None if view.marks is None else seen.unknown,
            goes_on=goes_on,
            level=seen.level,
            level_off_planes=seen.level_off_planes,
            level_come=seen.level_come,
            ends=seen.ends,
            visible=visible,
            bulge=bulge,
            is_carried=self._is_carried(fit),
        )

    def _is_carried(self, fit: SphereFit) -> bool:
        """Whether a sphere lies on a plane that carries it: its height is its radius."""
        normals, offsets = self._carriers[:, :3], self._carriers[:, 3]
        above = normals @ fit.sphere[:3] - offsets - fit.sphere[3]
        directions = np.column_stack([normals, -np.ones(len(normals))])
        deviations = np.sqrt(np.einsum("ki,ij,kj->k", directions, fit.covariance, directions))
        margin = CARRIED_SIGMAS * deviations + CARRIED_MARGIN * fit.sphere[3]
        return bool((np.abs(above) <= margin).any())

    def _looked_round(
        self, view: ClusterView, sphere: NDArray[np.float64]
    ) -> tuple[OutlineView, int]:
        """What is round a sphere, and how many readings each of those looked at stands for."""
        *about, each = view.surroundings(sphere)
        return look_round_outline(*about, sphere, view.pixel, self.noise), each

    def _spread_of(
        self, patches: NDArray[np.float64], each: int, fit: SphereFit
    ) -> NDArray[np.float64]:
        """Variances (m,) m² of the errors of the patches that have readings."""
        readings, _, variances = patches[patches[:, 0] > 0.0].T
        # Readings that are some pixels apart have less of their noise in common.
        shared = np.minimum(1.0 + self._sharing / each, readings)
        unevenness = UNEVENNESS * float(fit.sphere[3])
        return np.asarray(fit.noise_scale * variances * shared / readings + unevenness**2)
