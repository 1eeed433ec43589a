"""Planes in a cloud by RANSAC: hypotheses in batches, local refinement, merged, by support.

Readings near one infinite plane may be one surface or several at one height. A table before a floor
leaves two parts of the floor in view that are one surface; two tables of one height are two.
Between the parts of one surface something hides it; between two surfaces one sees through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.plane_openings import OpeningMask
from intuitive_physics_perception.environment.plane_relief import PlaneRelief, fitted_relief
from intuitive_physics_perception.environment.range_cloud import (
    RangeCloud,
    convex_hull,
    in_polygon,
    plane_axes,
)
from intuitive_physics_perception.settings import PerceptionSettings

MOST_PLANES = 8
"""Planes that are looked for at most."""

SCORED_POINTS = 1500
"""Points that each hypothesis is scored on."""

BATCHES = 24
"""Batches of hypotheses for each plane."""

BATCH_SIZE = 64
"""Hypotheses in a batch."""

REFINEMENTS = 6
"""Rounds of least squares over the inliers."""

MERGE_ANGLE = 4.0
"""Planes that differ by more are not merged, degrees."""

MERGE_DISTANCE = 2.0
"""Median scaled distance to another plane up to which both are one."""

BULGE_EXPLAINED = 0.2
"""Part of the variance of the heights that a paraboloid must explain for a plane to be the cap of
something round."""

BULGE_RADII = 5.0
"""Largest radius of curvature of such a cap, in largest sphere radii."""

SMALL_PART = 0.02
"""Part of all points below which a plane must be wide to be one."""

SMALL_WIDTH = 3.0
"""Smallest width of such a plane, in largest sphere radii."""

BEHIND = 2.0
"""Scaled distance behind a plane that is neither noise nor unevenness."""

READINGS_THROUGH = 10
"""Readings behind a plane at least that separate two surfaces in it."""

FRACTION_THROUGH = 0.3
"""Part of the readings between two surfaces that must be behind the plane."""

HULL_MARGIN = 0.03
"""Part of its distance from the sensor by which a place may lie outside a plane's hull and still
count as on the plane: what is known of a plane ends with the readings. Set by hand."""


@dataclass(frozen=True, eq=False)
class DetectedPlane:
    """A plane in the sensor's frame, normal to the sensor's side.

    Parameters
    ----------
    normal : (3,) unit vector
    offset : m; points p of the plane satisfy normal · p = offset, which is below zero
    hull : (n, 3) m, convex hull of the readings on it, counter-clockwise seen against the normal
    support : how many of the points given belong to it
    boundary : (k, 3) m, where it ends, so far as its edges were seen; None where none was
    openings : where one sees through it; None where one does not
    parts : (k, 3) m each, convex polygons that it consists of around its openings; none without
    relief : how its surface lies over it; None where it is flat
    """

    normal: NDArray[np.float64]
    offset: float
    hull: NDArray[np.float64]
    support: int
    boundary: NDArray[np.float64] | None = None
    openings: OpeningMask | None = None
    parts: tuple[NDArray[np.float64], ...] = ()
    relief: PlaneRelief | None = None

    @property
    def sheets(self) -> tuple[NDArray[np.float64] | None, ...]:
        """Convex polygons (k, 3) m that it consists of; None for a plane without an edge."""
        return self.parts or (self.boundary,)

    @property
    def numbers(self) -> NDArray[np.float64]:
        """Normal and offset in one array (4,)."""
        return np.append(self.normal, self.offset)

    def heights(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """Return the height (n,) m of its surface where points (n, 3) m stand over it."""
        return np.zeros(len(points)) if self.relief is None else self.relief.heights(points)

    def scaled_distances(self, cloud: RangeCloud) -> NDArray[np.float64]:
        """Return the distances (n,) of a cloud's points from its surface, as `RangeCloud` has
        them."""
        return cloud.scaled_distances(self.numbers, heights=self.heights)

    @property
    def width(self) -> float:
        """Largest distance between two corners of its hull, m."""
        return float(np.linalg.norm(self.hull[:, None] - self.hull, axis=2).max())

    @cached_property
    def _sides(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unit vectors outward (n, 3) and bounds (n,) m, outward · p ≤ bound for p in the hull."""
        outward = np.cross(np.roll(self.hull, -1, axis=0) - self.hull, self.normal)
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        return outward, (outward * self.hull).sum(axis=1)

    @property
    def hull_cones(self) -> NDArray[np.float64]:
        """Half-spaces (n, 4) of unit directions u, normal · u ≤ bound, that rays from the sensor
        through the hull lie in, or hardly out of.

        A ray meets the plane at u o / c, with its offset o and c = n · u. There it lies inside a
        side, outward · p ≤ b + m |p|, where u · (|o| outward + b n) ≤ m |o|.
        """
        outward, bounds = self._sides
        away = abs(self.offset)
        normals = away * outward + bounds[:, None] * self.normal
        return np.column_stack([normals, np.full(len(normals), HULL_MARGIN * away)])

    def covers(self, places: NDArray[Any]) -> NDArray[np.bool_]:
        """Mark the `places` (n, 3) m on the plane in its hull, or hardly out of it, (n,)."""
        outward, bounds = self._sides
        margins = HULL_MARGIN * np.linalg.norm(places, axis=1, keepdims=True)
        return np.asarray((places @ outward.T <= bounds + margins).all(axis=1))


def detect_planes(
    points: NDArray[np.float64],
    noise: RangeNoise,
    settings: PerceptionSettings,
    rng: np.random.Generator,
    old_planes: Sequence[NDArray[np.float64]] = (),
) -> list[DetectedPlane]:
    """Find all planes that hold at least `plane_min_fraction` of the points, largest first.

    `points` (n, 3) m, all finite, the sensor at the origin; `old_planes` (4,) normal and offset in
    m of each plane that was there before; it stays where it was as long as enough points are near.
    """
    cloud = RangeCloud.of_scene(points, noise, settings)
    needed = max(int(settings.plane_min_fraction * len(points)), 3)
    candidates = [plane for plane in old_planes if cloud.near(plane).sum() >= needed]
    fixed = len(candidates)
    free = np.ones(len(points), dtype=bool)
    for candidate in candidates:
        free &= ~cloud.near(candidate)
    # A plane that is found twice is merged, so a few more searches than planes are allowed.
    for _ in range(2 * MOST_PLANES):
        plane = _best_plane(cloud, np.flatnonzero(free), needed, rng)
        if plane is None:
            break
        free &= ~cloud.near(plane)
        if not _bulges(cloud.points[cloud.connected_parts(plane)[0]], plane, settings.max_radius):
            candidates.append(plane)
    merged = _apart(cloud, _merge(cloud, candidates, fixed), fixed)
    planes = [
        detected
        for k, plane in enumerate(merged)
        for surface in surfaces(cloud, plane, [*merged[:k], *merged[k + 1 :]], needed)
        if (detected := _detected(cloud, plane, surface, settings.max_radius)) is not None
    ]
    planes = _with_relief(cloud, planes, needed, merged[:fixed])
    planes.sort(key=lambda plane: -plane.support)
    return planes[:MOST_PLANES]


def _best_plane(
    cloud: RangeCloud, free: NDArray[np.intp], needed: int, rng: np.random.Generator
) -> NDArray[np.float64] | None:
    """Best plane (normal, offset) through the free points, None if it holds too few of them."""
    if free.size < needed:
        return None
    scored = rng.permutation(free)[:SCORED_POINTS]
    best_score, best = 0.0, None
    for batch in range(BATCHES):
        triples = _triples(cloud.points[free], BATCH_SIZE, rng, nearby=bool(batch % 2))
        hypotheses = planes_through(triples)
        distances = cloud.scaled_distances(hypotheses, scored)
        # MSAC: a point counts the more the nearer it is, and nothing beyond the tolerance.
        scores = np.maximum(1.0 - np.square(distances), 0.0).sum(axis=1)
        if scores.size and scores.max() > best_score:
            best_score, best = float(scores.max()), hypotheses[int(scores.argmax())]
    if best is None:
        return None
    refined = _refined(cloud, best, free)
    if cloud.near(refined)[free].sum() < needed:
        return None
    return refined


def _triples(
    points: NDArray[np.float64], count: int, rng: np.random.Generator, *, nearby: bool
) -> NDArray[np.float64]:
    """Draw points (count, 3, 3): from all, or from neighbours, which often share a small plane."""
    if nearby:
        centre = points[rng.integers(len(points))]
        distances = np.linalg.norm(points - centre, axis=1)
        reach = np.linalg.norm(centre) * np.exp(rng.uniform(np.log(0.05), np.log(0.5)))
        near = np.flatnonzero(distances < reach)
        if near.size >= 3:
            points = points[near]
    return points[rng.integers(len(points), size=(count, 3))]


def planes_through(triples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the planes (m, 4), normal to the sensor's side and offset in m, through three points.

    `triples` (n, 3, 3) m; m ≤ n: degenerate ones are left out.
    """
    a, b, c = triples[:, 0], triples[:, 1], triples[:, 2]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    longest = np.maximum(np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1))
    good = lengths > 0.05 * longest**2 + 1e-12
    normals = normals[good] / lengths[good, None]
    return _facing_sensor(np.column_stack([normals, (normals * a[good]).sum(axis=1)]))


def _facing_sensor(planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn planes (..., 4) so that the sensor, the origin, lies on the side of the normal."""
    return np.where(planes[..., 3:] > 0.0, -planes, planes)


def _refined(
    cloud: RangeCloud, plane: NDArray[np.float64], which: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Least squares over the inliers, weighted by noise, until it stays."""
    for _ in range(REFINEMENTS):
        inliers = which[cloud.near(plane, which)]
        if inliers.size < 3:
            return plane
        plane = _least_squares(cloud, inliers)
    return plane


def _least_squares(cloud: RangeCloud, inliers: NDArray[np.intp]) -> NDArray[np.float64]:
    points = cloud.points[inliers]
    weights = 1.0 / (cloud.deviations[inliers] ** 2 + (cloud.tolerance / cloud.sigmas) ** 2)
    return least_squares_plane(points, weights)


def least_squares_plane(
    points: NDArray[np.float64], weights: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the plane (4,), normal to the sensor's side and offset in m, nearest to points.

    `points` (n, 3) m; `weights` (n,) of their squared distances, all the same if not given.
    """
    centre = np.average(points, axis=0, weights=weights)
    centred = points - centre
    scatter = centred.T @ (centred if weights is None else centred * weights[:, None])
    normal = np.linalg.eigh(scatter)[1][:, 0]
    return _facing_sensor(np.append(normal, normal @ centre))


def _bulges(inliers: NDArray[np.float64], plane: NDArray[np.float64], max_radius: float) -> bool:
    """Whether the plane (4,) only cuts off a cap of something round, of its points (n, 3) m: where
    noise is large the tolerance takes in much of the near side of a ball."""
    first, second = plane_axes(plane[:3])
    across = (inliers - inliers.mean(axis=0)) @ np.stack([first, second], axis=1)
    a, b = across.T
    # A sphere rises from its tangent plane by -(a² + b²) / 2 R.
    design = np.column_stack([np.ones_like(a), a, b, a * a + b * b])
    heights = inliers @ plane[:3] - plane[3]
    solution = np.linalg.lstsq(design, heights, rcond=None)[0]
    left = heights - design @ solution
    explained = 1.0 - left.var() / max(float(heights.var()), 1e-12)
    radius = BULGE_RADII * max_radius
    return bool(explained > BULGE_EXPLAINED and solution[3] < -1.0 / (2.0 * radius))


def _merge(
    cloud: RangeCloud, planes: list[NDArray[np.float64]], fixed: int
) -> list[NDArray[np.float64]]:
    """Join planes that are nearly parallel and near; the first `fixed` stay as they are."""
    merged = planes[:fixed]
    smallest_cosine = float(np.cos(np.radians(MERGE_ANGLE)))
    for plane in planes[fixed:]:
        for k, kept in enumerate(merged):
            if plane[:3] @ kept[:3] < smallest_cosine:
                continue
            inliers = np.flatnonzero(cloud.near(plane))
            if np.median(np.abs(cloud.scaled_distances(kept, inliers))) < MERGE_DISTANCE:
                if k >= fixed:
                    every = np.arange(len(cloud.points))
                    merged[k] = _refined(cloud, kept, every)
                break
        else:
            merged.append(plane)
    return merged


def _apart(
    cloud: RangeCloud, planes: list[NDArray[np.float64]], fixed: int
) -> list[NDArray[np.float64]]:
    """Refine planes, but the first `fixed`, without the readings near another one that crosses
    them: the foot of a wall, all on one side, would lift the floor's end, and tilt gravity."""
    near = [cloud.near(plane) for plane in planes]
    refined = planes[:fixed]
    for plane in planes[fixed:]:
        uncrossed = np.ones(len(cloud.points), dtype=bool)
        for other, strip in zip(planes, near, strict=True):
            if _crosses(plane[:3], other[:3]):
                uncrossed &= ~strip
        refined.append(_refined(cloud, plane, np.flatnonzero(uncrossed)))
    return refined


def _detected(
    cloud: RangeCloud, plane: NDArray[np.float64], surface: NDArray[np.intp], max_radius: float
) -> DetectedPlane | None:
    """The plane of a surface, None if it may be the side of an object, as it is small and not wide,
    or a ball that touches it."""
    normal, offset = plane[:3], float(plane[3])
    hull = _hull_on_plane(cloud.points[surface], normal, offset)
    if hull is None:
        return None
    detected = DetectedPlane(normal, offset, hull, int(surface.size))
    is_small = surface.size < SMALL_PART * len(cloud.points)
    is_narrow = detected.width < SMALL_WIDTH * max_radius
    bulges = _bulges(cloud.points[surface], plane, max_radius)
    return None if (is_small and is_narrow) or bulges else detected


def _with_relief(
    cloud: RangeCloud,
    planes: Sequence[DetectedPlane],
    needed: int,
    fixed: Sequence[NDArray[np.float64]],
) -> list[DetectedPlane]:
    """Planes with their relief, without those that only cut through one; `fixed` ones stay."""
    kept: list[DetectedPlane] = []
    for plane in sorted(planes, key=lambda plane: -plane.support):
        own = np.flatnonzero(cloud.near(plane.numbers))
        own = own[plane.covers(cloud.points[own])]
        if any(
            other.relief is not None and np.median(np.abs(other.scaled_distances(cloud)[own])) < 1.0
            for other in kept
        ):
            continue
        crossing = [other.numbers for other in planes if _crosses(other.normal, plane.normal)]
        stays = any(np.array_equal(plane.numbers, numbers) for numbers in fixed)
        kept.append(_uneven(cloud, plane, own, crossing, stays=stays))
    return [plane for plane in kept if plane.support >= needed]


def _crosses(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    return abs(float(first @ second)) < np.cos(np.radians(MERGE_ANGLE))


def _uneven(
    cloud: RangeCloud,
    plane: DetectedPlane,
    own: NDArray[np.intp],
    crossing: Sequence[NDArray[np.float64]],
    *,
    stays: bool,
) -> DetectedPlane:
    """A plane with its relief, if it has one, and the hull of the readings on that."""
    numbers = plane.numbers
    fit = fitted_relief(cloud, numbers, own, crossing)
    if fit is not None and not stays:
        numbers = _least_squares(cloud, fit[1])
        fit = fitted_relief(cloud, numbers, fit[1], crossing)
    if fit is None:
        return plane
    relief, on = fit
    surface = cloud.connected(on)[0]
    points = cloud.points[surface]
    # A ray that meets a raised border meets the plane farther away.
    feet = points * (numbers[3] / (points @ numbers[:3]))[:, None]
    hull = _hull_on_plane(feet, numbers[:3], float(numbers[3]))
    if hull is None:
        return plane
    return replace(
        plane,
        normal=numbers[:3],
        offset=float(numbers[3]),
        hull=hull,
        support=int(surface.size),
        relief=relief,
    )


def _hull_on_plane(
    points: NDArray[np.float64], normal: NDArray[np.float64], offset: float
) -> NDArray[np.float64] | None:
    """Convex hull (n, 3) of points dropped onto a plane, None where they lie on a line."""
    axes = np.column_stack(plane_axes(normal))
    hull = convex_hull(points @ axes)
    return None if hull is None else hull @ axes.T + offset * normal


def surfaces(
    cloud: RangeCloud,
    plane: NDArray[np.float64],
    others: Sequence[NDArray[np.float64]],
    needed: int,
) -> list[NDArray[np.intp]]:
    """Return the indices (n,) of the points of each surface in a plane, largest first.

    `plane` (4,) normal and offset in m; `others` (4,) each, the other planes.
    """
    axes = np.column_stack(plane_axes(plane[:3]))
    groups: list[NDArray[np.intp]] = []
    for part in cloud.connected_parts(plane, others):
        if part.size < needed:
            continue
        for k, surface in enumerate(groups):
            if not _seen_between(cloud, plane, axes, (surface, part)):
                groups[k] = np.concatenate([surface, part])
                break
        else:
            groups.append(part)
    return sorted(groups, key=len, reverse=True)


def _seen_between(
    cloud: RangeCloud,
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    parts: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> bool:
    """Whether rays go through the plane between two parts of it."""
    hulls = [convex_hull(cloud.points[part] @ axes) for part in (*parts, np.concatenate(parts))]
    meeting = cloud.meeting(plane)
    feet = cloud.feet(plane, axes, meeting)
    in_first, in_second, in_both = (in_polygon(hull, feet) for hull in hulls)
    between = meeting[in_both & ~in_first & ~in_second]
    through = np.count_nonzero(cloud.scaled_distances(plane, between) < -BEHIND)
    return int(through) >= max(READINGS_THROUGH, FRACTION_THROUGH * between.size)
