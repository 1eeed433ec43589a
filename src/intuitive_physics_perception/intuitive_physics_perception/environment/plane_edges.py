"""Where planes end: edges that were really seen, not the borders of what the sensor could see.

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

from intuitive_physics.geometry.polygons import clip_polygon, plane_square
from intuitive_physics_perception.environment.noise import GAUSSIAN_MAD
from intuitive_physics_perception.environment.planes import DetectedPlane
from intuitive_physics_perception.environment.range_cloud import (
    RangeCloud,
    angle_between_readings,
    convex_hull,
    plane_axes,
)
from intuitive_physics_perception.environment.settings import PlaneEdgeSettings
from intuitive_physics_perception.settings import PerceptionSettings


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
    """

    surface: NDArray[np.float64]
    spacing: NDArray[np.float64]
    below: NDArray[np.float64]
    deep: NDArray[np.bool_]
    before: NDArray[np.float64]


def with_edges(
    planes: Sequence[DetectedPlane],
    cloud: RangeCloud,
    settings: PerceptionSettings,
    rng: np.random.Generator,
) -> list[DetectedPlane]:
    """Return planes with the boundaries that the cloud shows of them."""
    angle = angle_between_readings(cloud, rng)
    return [
        replace(plane, boundary=plane_boundary(cloud, plane, planes, angle, settings))
        for plane in planes
    ]


def plane_boundary(
    cloud: RangeCloud,
    plane: DetectedPlane,
    planes: Sequence[DetectedPlane],
    angle: float,
    settings: PerceptionSettings,
) -> NDArray[np.float64] | None:
    """Return the convex polygon that bounds a plane, None where no edge of it was seen.

    Parameters
    ----------
    cloud : what was read
    planes : all planes of the scene
    angle : rad between neighbouring readings

    Returns
    -------
    array
        (k, 3) m, counter-clockwise seen against the normal. Sides that are no seen edges lie
        `PlaneEdgeSettings.reach` away.
    """
    if not (angle > 0.0 and plane.offset < 0.0):
        # Readings coincide, or the plane goes through the sensor: nothing shows where it ends.
        return None
    axes = np.column_stack(plane_axes(plane.normal))
    seen = _seen_around(cloud, plane, planes, axes, angle, settings)
    if len(seen.surface) < settings.plane_edges.surface_readings:
        return None
    outline = convex_hull(seen.surface)
    polygon = None if outline is None else bounded_polygon(seen, outline, settings.plane_edges)
    return None if polygon is None else polygon @ axes.T + plane.offset * plane.normal


def _seen_around(
    cloud: RangeCloud,
    plane: DetectedPlane,
    planes: Sequence[DetectedPlane],
    axes: NDArray[np.float64],
    angle: float,
    settings: PerceptionSettings,
) -> SeenAround:
    numbers = plane.numbers
    scaled = cloud.scaled_distances(numbers)
    on = np.abs(scaled) < 1.0
    for other in planes:
        # Two surfaces at one height have one plane.
        if not np.array_equal(other.numbers, numbers):
            on &= ~cloud.near(other.numbers)
    part = np.flatnonzero(on)
    part = part[plane.outlines(cloud.points[part])]
    # How far the plane's own readings scatter is far less than what noise might make of them.
    median = float(np.median(np.abs(scaled[part]))) if part.size else 0.0
    usual = settings.plane_edges.surface_sigmas * GAUSSIAN_MAD * median
    usual = min(max(usual, settings.plane_edges.smallest_scatter), 1.0)
    part = part[np.abs(scaled[part]) < usual]
    meets = cloud.meeting(numbers)
    below, before = (meets[side] for side in (scaled[meets] < -usual, scaled[meets] > 1.0))
    return SeenAround(
        cloud.feet(numbers, axes, part),
        angle * cloud.ranges[part] ** 2 / max(abs(plane.offset), 1e-6),
        cloud.feet(numbers, axes, below),
        scaled[below] < -settings.plane_detection.behind,
        cloud.feet(numbers, axes, before),
    )


def bounded_polygon(
    seen: SeenAround, outline: NDArray[np.float64], settings: PlaneEdgeSettings
) -> NDArray[np.float64] | None:
    """Return the convex polygon (k, 2) of what was seen of a plane; see `plane_boundary`.

    Parameters
    ----------
    outline : (n, 2) m, convex hull of the surface, counter-clockwise
    """
    corners = _simplified(outline, settings.corner_tolerance * float(np.median(seen.spacing)))
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    edges = [
        edge
        for side in sides
        if (edge := _seen_edge(seen, *side, settings)) is not None
        and _inside(seen, edge, settings.gap) > settings.fraction_inside
    ]
    if not edges:
        return None
    centre = np.append(outline.mean(axis=0), 0.0)
    polygon = plane_square(np.array([0.0, 0.0, 1.0]), 0.0, centre, settings.reach)
    for outward, bound in edges:
        polygon = clip_polygon(polygon, np.append(-outward, 0.0), -bound)
    return polygon[:, :2] if len(polygon) >= 3 else None


def _inside(seen: SeenAround, edge: tuple[NDArray[np.float64], float], gap: float) -> float:
    """Part of the surface that an edge leaves; one that cuts off more was fitted to a corner."""
    outward, bound = edge
    return float((seen.surface @ outward <= bound + gap).mean())


def _simplified(corners: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """Drop corners of a convex polygon (n, 2) that stand out less than the tolerance from a side.

    The least prominent goes first (Visvalingam's order, by height instead of area).
    """
    kept = list(corners)
    while len(kept) > 3:
        heights = [
            _height(kept[k - 1], kept[k], kept[(k + 1) % len(kept)]) for k in range(len(kept))
        ]
        least = int(np.argmin(heights))
        if heights[least] > tolerance:
            break
        del kept[least]
    return np.array(kept)


def _height(
    before: NDArray[np.float64], corner: NDArray[np.float64], after: NDArray[np.float64]
) -> float:
    (ax, ay), (bx, by) = after - before, corner - before
    return float(abs(ax * by - ay * bx) / max(np.hypot(ax, ay), 1e-12))


def _seen_edge(
    seen: SeenAround,
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    settings: PlaneEdgeSettings,
) -> tuple[NDArray[np.float64], float] | None:
    """Return the edge along one side of the outline, outward · p = bound, if it was seen."""
    along = end - start
    length = float(np.linalg.norm(along))
    along = along / max(length, 1e-12)
    outward = np.array([along[1], -along[0]])
    turn = np.column_stack([along, outward])
    near = np.linalg.norm(seen.surface - 0.5 * (start + end), axis=1) < 0.75 * length
    spacing = float(np.median(seen.spacing[near])) if near.any() else float(seen.spacing.max())
    if length < settings.shortest_edge * spacing:
        return None
    gap = settings.gap + settings.gap_spacings * spacing
    parts = [
        (points - start) @ turn
        for points in (seen.surface, seen.below, seen.below[seen.deep], seen.before)
    ]
    slots = int(np.clip(length / (settings.slot_width * spacing), 3, settings.max_slots))
    width = length / slots
    found = []
    for place in width * np.arange(slots):
        on, below, deep, hidden = (_slot(part, place, width) for part in parts)
        end_of_slot = _end_of_surface(on, below, deep, hidden, gap, settings)
        if end_of_slot is not None:
            found.append((place + 0.5 * width, end_of_slot))
    if len(found) < max(3, settings.seen_fraction * slots):
        return None
    offset, slope = _robust_line(np.array(found), settings.fit_rounds)
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
    settings: PlaneEdgeSettings,
) -> float | None:
    """Where the plane ends in one slot across its outline, all in m outward from it.

    Half way between the last reading on the plane and the first one through it; None where they
    are more than `gap` apart, nothing shows that they are not one surface, or something hides it.
    """
    on = np.sort(on[on > -2.0 * gap])
    if not on.size:
        return None
    last = float(on[-1 - int(settings.outliers * on.size)])
    off = np.sort(below[below > last])
    deep = deep[(deep > last) & (deep < last + gap)]
    if deep.size < settings.readings_behind or off[1] > last + gap:
        return None
    first = float(off[1])
    if ((hidden > last) & (hidden < first)).sum() > deep.size:
        return None
    return 0.5 * (last + first)


def _slot(places: NDArray[np.float64], start: float, width: float) -> NDArray[np.float64]:
    """Outward parts of the places (n, 2) that lie in one slot along a side."""
    return places[(places[:, 0] >= start) & (places[:, 0] < start + width), 1]


def _robust_line(places: NDArray[np.float64], rounds: int) -> tuple[float, float]:
    """Offset and slope of a line through (n, 2) places, those far off it left out."""
    kept = np.ones(len(places), dtype=bool)
    offset, slope = 0.0, 0.0
    for _ in range(rounds):
        design = np.column_stack([np.ones(kept.sum()), places[kept, 0]])
        offset, slope = np.linalg.lstsq(design, places[kept, 1], rcond=None)[0]
        misses = np.abs(places[:, 1] - offset - slope * places[:, 0])
        kept = misses <= max(2.5 * float(np.median(misses)), 1e-6)
        if kept.sum() < 3:
            break
    return float(offset), float(slope)
