"""Ends of planes: edges that were seen, not the borders of the view.

A ray that crosses a plane and reads something beyond it proves that the plane has no surface
there. Where such rays lie next to readings on the plane, the plane has an edge between them. Where
the view ends, nothing was read, or something nearer hides the plane, it may go on, and it is taken
to go on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.polygons import plane_square
from intuitive_physics_perception.environment.fusion import MAX_EDGE_POINTS, fuse
from intuitive_physics_perception.environment.noise import GAUSSIAN_MAD, RangeNoise
from intuitive_physics_perception.environment.plane_openings import (
    OpeningMask,
    clip_flat,
    opening_mask,
    plane_parts,
    simplified,
)
from intuitive_physics_perception.environment.planes import BEHIND, DetectedPlane
from intuitive_physics_perception.environment.range_cloud import (
    RangeCloud,
    angle_between_readings,
    convex_hull,
    plane_axes,
)
from intuitive_physics_perception.settings import PerceptionSettings

REACH = 50.0
"""Extent of a plane where no edge of it was seen, m."""

CORNER_TOLERANCE = 1.0
"""Height of a corner that simplifying a hull may remove, in spacings."""

SHORTEST_EDGE = 4.0
"""Length of a side of a hull that may be an edge, in spacings."""

SLOT_WIDTH = 2.0
"""Width of the slots across a side of the hull in which ends are looked for, in spacings."""

MAX_SLOTS = 40
"""Largest number of slots along one side of a hull."""

SEEN_FRACTION = 0.6
"""Part of the slots of a side in which the end must be seen."""

GAP = 0.03
"""Distance from the last reading on a plane to the first behind it, m."""

GAP_SPACINGS = 3.0
"""Distance added to `GAP`, in spacings."""

OUTLIERS = 0.01
"""Part of the outermost readings on a plane that may be outliers."""

READINGS_BEHIND = 2
"""Readings clearly behind the plane that a slot with an end needs."""

FIT_ROUNDS = 4
"""Rounds of the robust fit of a line to the ends."""

FRACTION_INSIDE = 0.98
"""Part of a surface that an edge must leave: else it was fitted to a corner."""

SURFACE_READINGS = 30
"""Readings on a plane whose edges are looked for."""

SURFACE_SIGMAS = 3.0
"""Standard deviations of its scatter within which a reading is on a plane."""

SMALLEST_SCATTER = 0.2
"""Scaled distance that always counts as on the plane."""


@dataclass(frozen=True, eq=False)
class SeenAround:
    """Readings by where their rays meet one plane, in two axes of it, m.

    Parameters
    ----------
    surface : (n, 2) readings on the plane
    spacing : (n,) m between neighbouring ones where they are farthest apart
    below : (m, 2) rays that read something behind the plane
    deep : (m,) whether it is too far behind to be noise or unevenness
    before : (k, 2) rays that read something in front of it
    solid : (j, 2) rays that read nothing clearly behind it
    """

    surface: NDArray[np.float64]
    spacing: NDArray[np.float64]
    below: NDArray[np.float64]
    deep: NDArray[np.bool_]
    before: NDArray[np.float64]
    solid: NDArray[np.float64]


def with_edges(
    planes: Sequence[DetectedPlane],
    frames: Sequence[NDArray[np.float32]],
    noise: RangeNoise,
    settings: PerceptionSettings,
    rng: np.random.Generator,
) -> list[DetectedPlane]:
    """Return planes with the boundaries and openings that frames show of them.

    `frames` (height, width, 3) m each; an opening is as wide as the smallest sphere, at least.
    """
    cloud = RangeCloud.of_scene(fuse(frames, settings, rng, MAX_EDGE_POINTS), noise, settings)
    angle, narrowest = angle_between_readings(cloud, rng), 2.0 * settings.min_radius
    return [_with_ends(cloud, plane, planes, angle, narrowest) for plane in planes]


def _with_ends(
    cloud: RangeCloud,
    plane: DetectedPlane,
    planes: Sequence[DetectedPlane],
    angle: float,
    narrowest: float,
) -> DetectedPlane:
    """Return a plane with the boundary, `REACH` away where no edge was seen, and the openings."""
    if not (angle > 0.0 and plane.offset < 0.0):
        # Readings coincide, or the plane goes through the sensor: nothing shows where it ends.
        return plane
    axes = np.column_stack(plane_axes(plane.normal))
    around = _seen_around(cloud, plane, planes, axes, angle)
    hull = convex_hull(around.surface) if len(around.surface) >= SURFACE_READINGS else None
    if hull is None:
        return plane
    polygon = boundary_polygon(around, hull)
    on_plane = plane.offset * plane.normal
    ended = replace(plane, boundary=None if polygon is None else polygon @ axes.T + on_plane)
    mask = opening_mask(around.solid, around.below[around.deep], hull, narrowest)
    if mask is None:
        return ended
    parts = plane_parts(_square(hull) if polygon is None else polygon, hull, *mask)
    corner, cell, is_open = mask
    return replace(
        ended,
        openings=OpeningMask(corner @ axes.T + on_plane, axes, cell, is_open),
        parts=tuple(part @ axes.T + on_plane for part in parts),
    )


def _seen_around(
    cloud: RangeCloud,
    plane: DetectedPlane,
    planes: Sequence[DetectedPlane],
    axes: NDArray[np.float64],
    angle: float,
) -> SeenAround:
    numbers = plane.numbers
    scaled = plane.scaled_distances(cloud)
    on = np.abs(scaled) < 1.0
    for other in planes:
        # Two surfaces at one height have one plane.
        if not np.array_equal(other.numbers, numbers):
            on &= ~cloud.near(other.numbers)
    part = np.flatnonzero(on)
    part = part[plane.covers(cloud.points[part])]
    # How far the plane's own readings scatter is far less than what noise might make of them.
    median = float(np.median(np.abs(scaled[part]))) if part.size else 0.0
    usual = SURFACE_SIGMAS * GAUSSIAN_MAD * median
    usual = min(max(usual, SMALLEST_SCATTER), 1.0)
    part = part[np.abs(scaled[part]) < usual]
    meets = cloud.meeting(numbers)
    below, before = (meets[side] for side in (scaled[meets] < -usual, scaled[meets] > 1.0))
    return SeenAround(
        cloud.feet(numbers, axes, part),
        angle * cloud.ranges[part] ** 2 / max(abs(plane.offset), 1e-6),
        cloud.feet(numbers, axes, below),
        scaled[below] < -BEHIND,
        cloud.feet(numbers, axes, before),
        cloud.feet(numbers, axes, meets[scaled[meets] >= -BEHIND]),
    )


def boundary_polygon(around: SeenAround, hull: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the convex polygon (k, 2) of what was seen of a plane; see `_with_ends`.

    `hull` (n, 2) m, convex hull of the surface, counter-clockwise.
    """
    corners = simplified(hull, CORNER_TOLERANCE * float(np.median(around.spacing)))
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    edges = [
        edge
        for side in sides
        if (edge := _seen_edge(around, *side)) is not None
        and _inside(around, edge) > FRACTION_INSIDE
    ]
    if not edges:
        return None
    polygon = _square(hull)
    for outward, bound in edges:
        polygon = clip_flat(polygon, -outward, -bound)
    return polygon if len(polygon) >= 3 else None


def _square(hull: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (4, 2) m of a plane without an edge around its hull (n, 2)."""
    centre = np.append(hull.mean(axis=0), 0.0)
    return plane_square(np.array([0.0, 0.0, 1.0]), 0.0, centre, REACH)[:, :2]


def _inside(around: SeenAround, edge: tuple[NDArray[np.float64], float]) -> float:
    """Part of the surface that an edge leaves; one that cuts off more was fitted to a corner."""
    outward, bound = edge
    return float((around.surface @ outward <= bound + GAP).mean())


def _seen_edge(
    around: SeenAround, start: NDArray[np.float64], end: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float] | None:
    """Return the edge along one side of the hull, outward · p = bound, if it was seen."""
    along = end - start
    length = float(np.linalg.norm(along))
    along = along / max(length, 1e-12)
    outward = np.array([along[1], -along[0]])
    turn = np.column_stack([along, outward])
    near = np.linalg.norm(around.surface - 0.5 * (start + end), axis=1) < 0.75 * length
    spacing = float(np.median(around.spacing[near])) if near.any() else float(around.spacing.max())
    if length < SHORTEST_EDGE * spacing:
        return None
    gap = GAP + GAP_SPACINGS * spacing
    parts = [
        (points - start) @ turn
        for points in (around.surface, around.below, around.below[around.deep], around.before)
    ]
    slots = int(np.clip(length / (SLOT_WIDTH * spacing), 3, MAX_SLOTS))
    width = length / slots
    ends = []
    for place in width * np.arange(slots):
        on, below, deep, hidden = (_slot(part, place, width) for part in parts)
        end_of_slot = _end_of_surface(on, below, deep, hidden, gap)
        if end_of_slot is not None:
            ends.append((place + 0.5 * width, end_of_slot))
    if len(ends) < max(3, SEEN_FRACTION * slots):
        return None
    offset, slope = _robust_line(np.array(ends))
    direction = along + slope * outward
    direction /= np.linalg.norm(direction)
    normal = np.array([direction[1], -direction[0]])
    return normal, float(normal @ (start + offset * outward))


def _end_of_surface(
    on: NDArray[np.float64],
    below: NDArray[np.float64],
    deep: NDArray[np.float64],
    hidden: NDArray[np.float64],
    gap: float,
) -> float | None:
    """End of the plane in one slot across a side of its hull, all in m outward from it; None where
    nothing shows it, or something hides it."""
    on = np.sort(on[on > -2.0 * gap])
    if not on.size:
        return None
    last = float(on[-1 - int(OUTLIERS * on.size)])
    off = np.sort(below[below > last])
    deep = deep[(deep > last) & (deep < last + gap)]
    if deep.size < READINGS_BEHIND or off[1] > last + gap:
        return None
    first = float(off[1])
    if ((hidden > last) & (hidden < first)).sum() > deep.size:
        return None
    return 0.5 * (last + first)


def _slot(places: NDArray[np.float64], start: float, width: float) -> NDArray[np.float64]:
    """Outward parts of the places (n, 2) that lie in one slot along a side."""
    return places[(places[:, 0] >= start) & (places[:, 0] < start + width), 1]


def _robust_line(places: NDArray[np.float64]) -> tuple[float, float]:
    """Offset and slope of a line through (n, 2) places, those far off it left out."""
    kept = np.ones(len(places), dtype=bool)
    offset, slope = 0.0, 0.0
    for _ in range(FIT_ROUNDS):
        design = np.column_stack([np.ones(kept.sum()), places[kept, 0]])
        offset, slope = np.linalg.lstsq(design, places[kept, 1], rcond=None)[0]
        misses = np.abs(places[:, 1] - offset - slope * places[:, 0])
        kept = misses <= max(2.5 * float(np.median(misses)), 1e-6)
        if kept.sum() < 3:
            break
    return float(offset), float(slope)
