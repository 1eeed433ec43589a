"""Openings in planes: where a sensor looked through a plane, as through a doorway.

Only readings behind a plane open it. Where nothing was read, or something nearer hides the plane,
it may go on, and it is taken to go on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.geometry.polygons import clip_polygon
from intuitive_physics_perception.environment.range_cloud import convex_hull, in_polygon

READINGS_IN_CELL = 4.0
"""Readings in a cell of the mask on average: the edges of its cells are two spacings."""

FILLED_CELLS = 3.0
"""Cells over which the nearest reading says what a cell without readings is. Set by hand: rings of
a LiDAR are that far apart where readings along them are dense."""

MAX_CELLS = 400
"""Cells along a side of the mask, at most: bounds time and memory."""

NARROWEST = 8
"""Cells across the narrowest opening: through a narrower one no ball is seen with its outline, and
readings at edges mix what is on the plane and what is behind it. Set by hand."""

OPENING_READINGS = 30
"""Readings through an opening, at least. Set by hand."""

CONVEX_FRACTION = 0.9
"""Part of its convex hull that an opening fills to be cut out as one convex polygon."""

SPLITS = 3
"""Times that an opening which is not convex is halved, at most."""

SMALLEST_PART = 0.05
"""Part of an opening below which a piece of it is not cut out."""

MOST_SIDES = 6
"""Sides of a polygon that is cut out, at most: each of them is one part more of the plane."""

MOST_PARTS = 8
"""Parts of a plane, at most; openings that would make more of it stay closed in the environment
that is published, the smaller ones first: each part is one plane more to simulate."""

EDGE_CELLS = 2.0
"""Cells from the border of what was seen within which an opening has no end there."""


@dataclass(frozen=True, eq=False)
class OpeningMask:
    """Cells of a plane through which the sensor has looked.

    Parameters
    ----------
    origin : (3,) m, corner of the first cell
    axes : (3, 2) unit vectors along the rows and columns of cells
    cell : edge of a cell, m
    open : (n, k) whether there is no surface in a cell
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    cell: float
    open: NDArray[np.bool_]

    @cached_property
    def clear(self) -> NDArray[np.bool_]:
        """Cells (n, k) whose neighbours are open too: no reading on the surface is in one."""
        from scipy.ndimage import binary_erosion

        return np.asarray(binary_erosion(self.open, np.ones((3, 3)), border_value=1))

    def seen_from(self, way: RigidTransform) -> OpeningMask:
        """Return the same cells in the frame of a sensor that has moved; `way` leads from its frame
        now to this one."""
        turn, shift = way.matrix, way.translation
        return replace(self, origin=(self.origin - shift) @ turn, axes=turn.T @ self.axes)


def opening_mask(
    solid: NDArray[np.float64],
    through: NDArray[np.float64],
    hull: NDArray[np.float64],
    narrowest: float,
) -> tuple[NDArray[np.float64], float, NDArray[np.bool_]] | None:
    """Return corner (2,) m, cell m and open cells (n, k) of a plane; None where none is open.

    `solid` (n, 2) m, where rays meet the plane that read it or something before it; `through`
    (m, 2) m, where those do that read something behind it; `hull` (k, 2) m, convex, of the readings
    on it; `narrowest` m, width of an opening, at least.
    """
    from scipy.ndimage import binary_opening, distance_transform_edt, label

    solid, through = (places[in_polygon(hull, places)] for places in (solid, through))
    if len(through) < OPENING_READINGS:
        return None
    low, high = hull.min(axis=0), hull.max(axis=0)
    cell = float(np.sqrt(READINGS_IN_CELL * _area(hull) / (len(solid) + len(through))))
    cell = max(cell, float((high - low).max()) / MAX_CELLS)
    shape = np.ceil((high - low) / cell).astype(int) + 1
    edges = [low[k] + cell * np.arange(shape[k] + 1) for k in range(2)]
    on, behind = (
        np.histogram2d(places[:, 0], places[:, 1], edges)[0] for places in (solid, through)
    )
    # The nearest reading says what a cell without one is.
    to_through = distance_transform_edt(behind <= on)
    to_solid = distance_transform_edt((on < behind) | (on == 0.0))
    is_open = (to_through < to_solid) & (to_through <= FILLED_CELLS)
    centres = np.stack(np.meshgrid(*(edge[:-1] + 0.5 * cell for edge in edges), indexing="ij"), -1)
    is_open &= in_polygon(hull, centres.reshape(-1, 2)).reshape(is_open.shape)
    across = max(NARROWEST, int(np.ceil(narrowest / cell)))
    is_open = binary_opening(is_open, np.ones((across, across)))
    labels, count = label(is_open)
    passed = np.bincount(labels.ravel(), behind.ravel(), minlength=count + 1)
    passed[0] = 0.0
    is_open = (passed >= OPENING_READINGS)[labels]
    return (low, cell, is_open) if is_open.any() else None


def plane_parts(
    polygon: NDArray[np.float64],
    hull: NDArray[np.float64],
    corner: NDArray[np.float64],
    cell: float,
    is_open: NDArray[np.bool_],
) -> list[NDArray[np.float64]]:
    """Split a polygon (k, 2) m into disjoint convex parts around its openings, largest first.

    An edge of an opening is up to two cells off, `EDGE_CELLS`. An opening that reaches the border
    of what was seen, `hull` (n, 2) m, is taken to go on there. `corner` (2,) m, `cell` m and
    `is_open` (j, l) are those of `opening_mask`. All polygons are convex and counter-clockwise.
    """
    from scipy.ndimage import label

    labels, count = label(is_open)
    pieces = []
    for k in range(1, count + 1):
        cells = np.argwhere(labels == k)
        pieces += _convex_pieces(cells, SMALLEST_PART * len(cells), SPLITS)
    parts = [polygon]
    for piece in sorted(pieces, key=_area, reverse=True):
        sides = _inner_sides(corner + cell * piece, hull, EDGE_CELLS * cell)
        split = [left for part in parts for left in _cut_out(part, sides)]
        split = [part for part in split if _area(part) > (EDGE_CELLS * cell) ** 2]
        if len(split) <= MOST_PARTS:
            parts = split
    return sorted(parts, key=_area, reverse=True)


def _convex_pieces(
    cells: NDArray[np.intp], smallest: float, splits: int
) -> list[NDArray[np.float64]]:
    """Convex polygons (k, 2), in cells, that cover connected cells (n, 2) about."""
    if len(cells) < smallest:
        return []
    hull = _hull_of_cells(cells)
    if len(cells) >= CONVEX_FRACTION * _area(hull) or not splits:
        return [simplified(hull, 1.0, MOST_SIDES)]
    centred = cells - cells.mean(axis=0)
    along = np.linalg.eigh(centred.T @ centred)[1]
    sides = [centred @ axis > 0.0 for axis in along.T]
    halves = [side for side in sides if side.any() and not side.all()]
    filled = [
        sum(_area(_hull_of_cells(cells[half])) for half in (first, ~first)) for first in halves
    ]
    first = halves[int(np.argmin(filled))]
    return [
        piece
        for half in (cells[first], cells[~first])
        for piece in _convex_pieces(half, smallest, splits - 1)
    ]


def _hull_of_cells(cells: NDArray[np.intp]) -> NDArray[np.float64]:
    """Convex hull (k, 2) of cells (n, 2), at least one, in cells."""
    corners = [cells + step for step in ((0, 0), (0, 1), (1, 0), (1, 1))]
    hull = convex_hull(np.concatenate(corners).astype(np.float64))
    assert hull is not None  # four corners of a cell lie on no line
    return hull


def _inner_sides(
    opening: NDArray[np.float64], hull: NDArray[np.float64], near: float
) -> list[tuple[NDArray[np.float64], float]]:
    """Sides, outward · p = bound, of an opening (k, 2) that do not lie along the hull (n, 2) of
    what was seen; the longest first."""
    outward, bounds = _half_planes(hull)
    following = np.roll(opening, -1, axis=0)
    three = np.stack([opening, 0.5 * (opening + following), following])
    to_border = (bounds - three @ outward.T).min(axis=2)
    lengths = np.linalg.norm(following - opening, axis=1)
    normals, ends = _half_planes(opening)
    order = np.argsort(-lengths, kind="stable")
    return [(normals[k], float(ends[k])) for k in order if (to_border[:, k] > near).any()]


def _cut_out(
    part: NDArray[np.float64], sides: Sequence[tuple[NDArray[np.float64], float]]
) -> list[NDArray[np.float64]]:
    """Convex parts of a convex polygon (k, 2) beyond one of some sides, outward · p = bound."""
    parts, inside = [], part
    for outward, bound in sides:
        beyond = clip_flat(inside, outward, bound)
        if len(beyond) >= 3:
            parts.append(beyond)
        inside = clip_flat(inside, -outward, -bound)
        if len(inside) < 3:
            # Nothing of the opening lies in this part, which stays whole.
            return [part]
    return parts if sides else [part]


def clip_flat(
    polygon: NDArray[np.float64], normal: NDArray[np.float64], bound: float
) -> NDArray[np.float64]:
    """Return the part (k, 2) of a convex polygon with normal · p ≥ bound.

    `polygon` (n, 2) m; `normal` (2,) unit vector; `bound` m.
    """
    flat = np.column_stack([polygon, np.zeros(len(polygon))])
    return clip_polygon(flat, np.append(normal, 0.0), bound)[:, :2]


def simplified(
    corners: NDArray[np.float64], tolerance: float, most: int | None = None
) -> NDArray[np.float64]:
    """Drop corners of a convex polygon, `corners` (n, 2), that stand out less than the tolerance
    from a side, and further ones until there are at most `most`.

    The least prominent goes first (Visvalingam's order, by height instead of area).
    """
    kept = list(corners)
    while len(kept) > 3:
        heights = [
            _height(kept[k - 1], kept[k], kept[(k + 1) % len(kept)]) for k in range(len(kept))
        ]
        least = int(np.argmin(heights))
        if heights[least] > tolerance and (most is None or len(kept) <= most):
            break
        del kept[least]
    return np.array(kept)


def _height(
    before: NDArray[np.float64], corner: NDArray[np.float64], after: NDArray[np.float64]
) -> float:
    (ax, ay), (bx, by) = after - before, corner - before
    return float(abs(ax * by - ay * bx) / max(np.hypot(ax, ay), 1e-12))


def _half_planes(polygon: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors outward (k, 2) and bounds (k,) of a convex polygon (k, 2)."""
    along = np.roll(polygon, -1, axis=0) - polygon
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    return outward, (outward * polygon).sum(axis=1)


def _area(polygon: NDArray[np.float64]) -> float:
    """Area of a polygon (n, 2), m²."""
    (x, y), (following_x, following_y) = polygon.T, np.roll(polygon, -1, axis=0).T
    return 0.5 * float(np.abs(np.sum(x * following_y - y * following_x)))
