"""Kernels that judge whether a sphere is one, and an object of its own, by all readings about it.

Lengths in m, the sensor at the origin; `noise` as in `sphere_fit`.
"""

from __future__ import annotations

from math import atan2, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, allocating_kernel, inlined, kernel
from intuitive_physics_perception.detection.detections import Bulge
from intuitive_physics_perception.detection.sphere_fit import (
    BEHIND_SIGMAS,
    INLIER_SIGMAS,
    passes_by,
    surface_error,
)
from intuitive_physics_perception.environment.known_space import BEHIND, KNOWN, NEW, UNKNOWN

LATTICE = 0.15
"""Spacing, in radii, of the lattice over the outline on which seen places are marked. Set by
hand."""

LATTICE_REACH = 6
"""Lattice points from the centre of the outline to its edge: the outline is covered."""

LATTICE_SIDE = 2 * LATTICE_REACH + 1
"""Lattice points along one side."""

EDGE_PART = 0.9
"""Part of the outline's radius beyond which readings are not judged: they graze. Set by hand."""

OCCLUDER_DEPTH = 0.5
"""Distance before the surface, in radii, from which on a reading hides the sphere instead of
contradicting it. Set by hand."""

SECTORS = 16
"""Sectors of the ring round the outline: each is judged by itself. A ball that touches another of
its size has 2 to 3 of them in common with it."""

RING_WIDTH = 0.35
"""Radii over which the ring outside the outline reaches: a neighbour of the same size in contact
covers a seventh of it. Set by hand."""

TOUCHED = 0.1
"""Part of a sector in which the cluster goes on from which on something touches the outline there.
Set by hand: the ring begins where the flickering edge of a free ball does not reach."""

PATCH_RINGS = 3
"""Rings of equal area, each of `SECTORS` patches, into which the disc of a sphere is divided."""

UNKNOWN_BULGE = 30.0
"""Standard deviation, in radii, of what too few patches leave open: numerical."""

STEEPEST_SLOPE = 1.7320508
"""Tangent of 60°, the angle of incidence up to which a surface that goes on is expected to be
read."""


class SphereView(NamedTuple):
    """Readings in the outline of a sphere.

    Parameters
    ----------
    on : number of readings on the surface
    against : number of readings that contradict it
    visible : part of the outline's disc that has a reading on the surface within LATTICE radii: two
        scan lines of a LiDAR, which fit a sphere on anything round, make at most 0.4
    density : part of the disc between readings on the surface that has any reading so near
    """

    on: int
    against: int
    visible: float
    density: float


class OutlineView(NamedTuple):
    """The ring outside a sphere's outline, and its surface against what was read there before.

    Parameters
    ----------
    going_on : (SECTORS,) part of each sector of the ring in which the cluster goes on
    level : part of the ring's sectors in which any surface goes on past the outline, as a plate
        does round a bulge
    level_off_planes : the same for what is on no plane of the environment
    level_come : the same for what is not known to have stood there before
    ends : part of the ring's sectors in which what is read lies behind all that could go on
    new, known, unknown : parts of the readings on the surface that lie where nothing was before,
        where something was, and where nobody has looked; the rest lies on planes
    patches : (n_patches, 3) number of readings on the surface, mean of their distance outside it,
        m, and mean variance of that distance, m², by patch of the disc
    """

    going_on: Any
    level: float
    level_off_planes: float
    level_come: float
    ends: float
    new: float
    known: float
    unknown: float
    patches: Any


@allocating_entry
def inspect_sphere(points: Any, sphere: Any, noise: Any) -> SphereView:
    """Judge a sphere by every reading in its outline, whatever cluster it belongs to.

    What lies well before the sphere hides it and says nothing. What lies behind its surface could
    not have been seen through it; what lies close before it is a part of something larger.

    `points` (n, 3), may hold NaN.
    """
    cx, cy, cz, r = sphere[0], sphere[1], sphere[2], sphere[3]
    across, upwards = line_of_sight_axes(sphere)
    seen = np.zeros((LATTICE_SIDE, LATTICE_SIDE), dtype=np.bool_)
    read = np.zeros((LATTICE_SIDE, LATTICE_SIDE), dtype=np.bool_)
    on, against = 0, 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if passes_by(x, y, z, cx, cy, cz, r):
            continue
        error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
        if sine > 1.0:
            continue
        # Where the ray passes the centre nearest, in radii across the line of sight.
        scale = (x * cx + y * cy + z * cz) / ((x * x + y * y + z * z) * r)
        a = (x * across[0] + y * across[1] + z * across[2]) * scale
        b = (x * upwards[0] + y * upwards[1] + z * upwards[2]) * scale
        _mark(read, a, b)
        if error * error < INLIER_SIGMAS**2 * variance and ahead > -BEHIND_SIGMAS * deviation:
            on += 1
            _mark(seen, a, b)
        elif sine < EDGE_PART:
            before = ahead - r * sqrt(1.0 - sine * sine)
            if before < max(BEHIND_SIGMAS * deviation, OCCLUDER_DEPTH * r):
                against += 1
    visible, density = _marked_parts(seen, read)
    return SphereView(on, against, visible, density)


@allocating_kernel
def line_of_sight_axes(sphere: Any) -> tuple[Any, Any]:
    """Two unit vectors across the line of sight to a sphere."""
    toward = sphere[:3] / sqrt(np.sum(sphere[:3] ** 2))
    helper = np.zeros(3)
    helper[np.argmin(np.abs(toward))] = 1.0
    across = helper - np.sum(helper * toward) * toward
    across /= sqrt(np.sum(across**2))
    return across, np.cross(toward, across)


@kernel
def _mark(seen: Any, a: float, b: float) -> None:
    """Mark what of the lattice over the unit disc lies within LATTICE of (a, b)."""
    i, j = round(a / LATTICE), round(b / LATTICE)
    for k in range(max(i - 1, -LATTICE_REACH), min(i + 1, LATTICE_REACH) + 1):
        for m in range(max(j - 1, -LATTICE_REACH), min(j + 1, LATTICE_REACH) + 1):
            if (k * LATTICE - a) ** 2 + (m * LATTICE - b) ** 2 <= LATTICE**2:
                seen[k + LATTICE_REACH, m + LATTICE_REACH] = True


@allocating_kernel
def _marked_parts(seen: Any, read: Any) -> tuple[float, float]:
    """Part of the disc that is seen, and part of what lies between seen places that is read."""
    marked, total, filled, enclosed = 0, 0, 0, 0
    for k in range(LATTICE_SIDE):
        for m in range(LATTICE_SIDE):
            i, j = k - LATTICE_REACH, m - LATTICE_REACH
            if (i * i + j * j) * LATTICE**2 > EDGE_PART**2:
                continue
            total += 1
            marked += seen[k, m]
            in_row = np.any(seen[k, : m + 1]) and np.any(seen[k, m:])
            in_column = np.any(seen[: k + 1, m]) and np.any(seen[k:, m])
            if in_row or in_column:
                enclosed += 1
                filled += read[k, m]
    return marked / total, filled / max(enclosed, 1)


@inlined
def _sector(a: float, b: float) -> int:
    """Number of the sector in which a place across the line of sight lies."""
    return int((atan2(b, a) + pi) / (2.0 * pi) * SECTORS) % SECTORS


@allocating_entry
def look_round_outline(
    points: Any, own: Any, marks: Any, sphere: Any, pixel: float, noise: Any
) -> OutlineView:
    """Judge the ring outside a sphere's outline, and whether its surface is new.

    A free sphere ends at its outline: just outside, the sensor sees something else, or nothing. A
    part of something larger (a corner, a shoulder, the bulge of a mug) goes on as the same surface.
    Such a surface that leaves the outline backwards at the steepest angle that is still read lies,
    s radii across the line of sight, (s - 1) tan(angle) radii behind the outline, and no more.

    `points` (n, 3) readings about the sphere, may hold NaN; `own` (n,) nonzero where a reading
    belongs to the cluster in which the sphere was found; `marks` (n,) of the readings, NEW
    where nothing was before, 0 on planes; `sphere` (4,).
    """
    cx, cy, cz, r = sphere[0], sphere[1], sphere[2], sphere[3]
    across, upwards = line_of_sight_axes(sphere)
    distance = sqrt(cx * cx + cy * cy + cz * cz)
    # Readings nearer to the outline may be mixed of both sides of the edge, or fattened.
    inner = 1.0 + 2.5 * pixel * distance / r
    outer = inner + max(RING_WIDTH, 2.0 * pixel * distance / r)
    same = np.zeros(SECTORS, dtype=np.int64)
    near = np.zeros(SECTORS, dtype=np.int64)
    off_planes = np.zeros(SECTORS, dtype=np.int64)
    come = np.zeros(SECTORS, dtype=np.int64)
    total = np.zeros(SECTORS, dtype=np.int64)
    patches = np.zeros((PATCH_RINGS * SECTORS, 3))
    marked = np.zeros(BEHIND + 1)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if passes_by(x, y, z, cx, cy, cz, outer * r):
            continue
        error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
        if sine > outer or 1.0 < sine < inner:
            continue
        a = x * across[0] + y * across[1] + z * across[2]
        b = x * upwards[0] + y * upwards[1] + z * upwards[2]
        sector = _sector(a, b)
        if sine <= 1.0:
            if error * error > INLIER_SIGMAS**2 * variance or ahead < -BEHIND_SIGMAS * deviation:
                continue
            marked[marks[i]] += 1.0
            if sine < EDGE_PART:
                # Rings of equal area: as many readings in each.
                ring = int(sine * sine / (EDGE_PART * EDGE_PART) * PATCH_RINGS)
                patch = ring * SECTORS + sector
                patches[patch, 0] += 1.0
                patches[patch, 1] += error
                patches[patch, 2] += variance
        else:
            is_near = ahead > -STEEPEST_SLOPE * (sine - 1.0) * r - BEHIND_SIGMAS * deviation
            total[sector] += 1
            near[sector] += is_near
            off_planes[sector] += marks[i] != 0 and is_near
            come[sector] += marks[i] > KNOWN and is_near
            same[sector] += own[i] != 0 and is_near
    level, level_off_planes, level_come, ends = 0, 0, 0, 0
    for k in range(SECTORS):
        level += 2 * near[k] > total[k]
        level_off_planes += 2 * off_planes[k] > total[k]
        level_come += 2 * come[k] > total[k]
        ends += 2 * near[k] <= total[k] and total[k] > 0
    for k in range(patches.shape[0]):
        patches[k, 1:] /= max(patches[k, 0], 1.0)
    marked /= max(marked.sum(), 1.0)
    return OutlineView(
        same / np.maximum(total, 1),
        level / SECTORS,
        level_off_planes / SECTORS,
        level_come / SECTORS,
        ends / SECTORS,
        marked[NEW],
        marked[KNOWN],
        marked[UNKNOWN] + marked[BEHIND],
        patches,
    )


def bulge_of(patches: NDArray[np.float64], variances: NDArray[np.float64], radius: float) -> Bulge:
    """Return how the surface in an outline deviates from its sphere.

    `patches` (n_patches, 3) of `OutlineView`; `variances` (n,) m², of the means of those that have
    readings; `radius` in m.
    """
    seen = np.flatnonzero(patches[:, 0] > 0.0)
    ring, sector = np.divmod(seen, SECTORS)
    s2 = (ring + 0.5) / PATCH_RINGS * EDGE_PART**2
    angle = (sector + 0.5) * (2.0 * pi / SECTORS) - pi
    s, upright = np.sqrt(s2), np.sqrt(1.0 - s2)
    modes = [np.ones(len(seen)), s * np.cos(angle), s * np.sin(angle)]
    modes += [s2, s2 * np.cos(2.0 * angle), s2 * np.sin(2.0 * angle)]
    deviations = np.sqrt(variances)
    rows = np.column_stack(modes) * (radius * upright / deviations)[:, None]
    spread = np.linalg.inv(rows.T @ rows + UNKNOWN_BULGE**-2 * np.eye(len(modes)))
    coefficients = spread @ rows.T @ (patches[seen, 1] / deviations)
    return Bulge(coefficients[3:], np.linalg.inv(spread[3:, 3:]))


def touched_sectors(view: OutlineView) -> NDArray[np.bool_]:
    """Mark the sectors (SECTORS,) in which something of the cluster touches the outline, and those
    beside them: its edge may lie anywhere in a sector."""
    touched = view.going_on > TOUCHED
    return np.asarray(touched | np.roll(touched, 1) | np.roll(touched, -1))


@allocating_entry
def outside_in_sectors(points: Any, sphere: Any, sectors: Any) -> Any:
    """Mark the points (n,) whose rays pass outside the outline of a sphere (4,) in some of its
    sectors (SECTORS,).

    `points` (n, 3) m.
    """
    across, upwards = line_of_sight_axes(sphere)
    center2 = np.sum(sphere[:3] ** 2)
    marked = np.zeros(points.shape[0], dtype=np.bool_)
    for i in range(points.shape[0]):
        toward = np.sum(points[i] * sphere[:3])
        miss2 = center2 - toward * toward / np.sum(points[i] ** 2)
        if miss2 > sphere[3] ** 2:
            a, b = np.sum(points[i] * across), np.sum(points[i] * upwards)
            marked[i] = sectors[_sector(a, b)]
    return marked
