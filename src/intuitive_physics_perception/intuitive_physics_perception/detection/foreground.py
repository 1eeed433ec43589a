"""Foreground of a frame: points off all planes, in clusters that may be objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, allocating_kernel, kernel
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.known_space import KNOWN, NEW, UNKNOWN, KnownSpace
from intuitive_physics_perception.environment.noise import CHANGE_SIGMAS, RangeNoise
from intuitive_physics_perception.environment.planes import DetectedPlane
from intuitive_physics_perception.settings import PerceptionSettings

JUMP = 0.02
"""Difference of range that separates neighbouring pixels, m."""

JUMP_SIGMAS = 6.0
"""Standard deviations of the range that are added to that difference."""

LINES_APART = 1.2
"""Angles between the lines of a scanner up to which readings are neighbours: on a surface that is
slanted across the lines their ranges differ, too. Set by hand."""

CELLS_PER_GAP = 4.0
"""Cells along a gap in a cloud that is not organised; one reading stands for its cell."""

ITERATIONS = 8
"""Iterations of the contraction in `free_ranges`: numerical, the rest is far below a millimetre."""

FINEST_CELLS = 1e4
"""Cells along a radian of direction, or a unit of the logarithm of range, at most: numerical, the
number of all cells has to fit into 64 bits, and no sensor is that fine."""


@dataclass(frozen=True, eq=False)
class Clusters:
    """Foreground points by cluster, largest first.

    Parameters
    ----------
    indices : for each cluster (n,) indices into the frame's points in row-major order
    new : for each cluster whether it came where nothing was, or is an object of the last frame
    foreground : number of points off all planes
    readings : number of points in range
    marks : (height, width) of each point off all planes KNOWN, NEW or UNKNOWN, 0 of the others;
        None where nothing is known of the space
    """

    indices: list[NDArray[np.int64]]
    new: list[bool]
    foreground: int
    readings: int
    marks: NDArray[np.uint8] | None = None

    @property
    def in_a_row(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices (n,) of the points of all clusters, one after another, and where each begins in
        them, (number of clusters + 1,)."""
        starts = np.cumsum([0, *map(len, self.indices)], dtype=np.int64)
        return np.concatenate([np.zeros(0, dtype=np.int64), *self.indices]), starts

    @property
    def unknown(self) -> int:
        """Number of points where nobody has looked before."""
        return 0 if self.marks is None else int(np.count_nonzero(self.marks == UNKNOWN))


class ForegroundFinder:
    """Takes the planes of one environment out of frames and clusters what is left.

    What came where nothing was makes clusters of its own, so that what lies or flies close before
    something else is separated from it.

    `before` (height, width) m, what each pixel of an organised cloud read when the environment was
    modelled, NaN where nothing was; None where readings have no fixed rays; `space`: what is known
    of the space, for these; None where nothing is.
    """

    def __init__(
        self,
        model: EnvironmentModel,
        settings: PerceptionSettings,
        before: NDArray[np.float32] | None = None,
        space: KnownSpace | None = None,
    ) -> None:
        self._model = model
        self._settings = settings
        self._space = space
        # A sensor that has come behind a plane sees nothing of it.
        self._planes = [plane for plane in model.detected if plane.offset < 0.0]
        self._noise = model.noise
        noise = model.noise
        # Single precision halves the time of a frame and is far below the noise.
        self._limits = np.array(
            [
                settings.min_range**2,
                settings.max_range**2,
                noise.constant**2,
                noise.quadratic**2,
                noise.limit**2,
            ],
            dtype=np.float32,
        )
        self._bounds = _bounds_of(self._planes, settings)
        self._free = np.zeros((0, 0), dtype=np.float32)
        self._known = np.zeros((0, 0), dtype=bool)
        self._changes = None if before is None else changed_ranges(before, model.noise)
        self._objects = np.zeros(0, dtype=np.int64)

    def expect_objects(self, pixels: Sequence[NDArray[np.int64]]) -> None:
        """Take which pixels, (n,) of each object, of an organised frame showed objects: in the next
        frame they count as new, wherever the objects were when the environment was modelled."""
        self._objects = np.concatenate([np.zeros(0, dtype=np.int64), *pixels])

    def before(self, points: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the indices of those of points (n, 3) m that lie before all planes."""
        return readings_before(points, *self._bounds, self._limits, False)[0]

    def find(self, points: NDArray[np.float32]) -> Clusters:
        """Cluster the foreground of a frame of points (height, width, 3)."""
        if points.shape[0] > 1 and self._space is None:
            marks, readings, is_known = self._marks_of_pixels(points)
        else:
            marks, readings = self._marks_of_readings(points)
            is_known = self._space is not None
        groups = np.minimum(marks, NEW)
        fresh = marks == NEW
        if is_known and self._objects.size and points.shape[0] > 1:
            shown = self._objects[groups.ravel()[self._objects] > 0]
            groups.ravel()[shown], fresh.ravel()[shown] = NEW, True
        indices = self._clusters(points, groups)
        new = [is_known and bool(fresh.ravel()[cluster].mean() > 0.5) for cluster in indices]
        return Clusters(
            indices, new, int(np.count_nonzero(marks)), readings, marks if is_known else None
        )

    def _marks_of_pixels(self, points: NDArray[np.float32]) -> tuple[NDArray[np.uint8], int, bool]:
        """Marks (height, width) of pixels whose rays stay, the number of readings, and whether
        anything is known of the pixels; where nothing is, all are KNOWN."""
        free, changes = self._free_of(points), self._changes
        is_known = changes is not None and changes.shape == free.shape
        marks, readings = _foreground(
            points, free, changes if is_known else np.zeros_like(free), self._limits
        )
        return marks, readings, is_known

    def _marks_of_readings(self, points: NDArray[np.float32]) -> tuple[NDArray[np.uint8], int]:
        """Marks (height, width) of readings with rays of their own; all KNOWN where nothing is
        known."""
        flat, space = points.reshape(-1, 3), self._space
        before, readings = readings_before(flat, *self._bounds, self._limits, space is not None)
        marks = np.zeros(len(flat), dtype=np.uint8)
        marks[before] = (
            KNOWN if space is None else space.marks(flat[before], self._model.sensor_pose)
        )
        return marks.reshape(points.shape[:2]), readings

    def _clusters(
        self, points: NDArray[np.float32], groups: NDArray[np.uint8]
    ) -> list[NDArray[np.int64]]:
        if points.shape[0] > 1:
            return self._organised_clusters(points, groups)
        parts = [
            cluster
            for group in (KNOWN, NEW)
            for cluster in self._unorganised_clusters(points[0], np.flatnonzero(groups == group))
        ]
        return sorted(parts, key=len, reverse=True)

    def _free_of(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Squared range at which each ray comes to a plane, (height, width) m².

        A pixel of an organised cloud always has the same ray, so it is computed only once.
        """
        if self._free.shape != points.shape[:2]:
            self._free = np.zeros(points.shape[:2], dtype=np.float32)
            self._known = np.zeros(points.shape[:2], dtype=bool)
        new = np.isfinite(points[:, :, 2]) & ~self._known
        if new.any():
            free = free_ranges(points[new], self._planes, self._noise, self._settings)
            self._free[new] = np.square(free)
            self._known |= new
        return self._free

    def _organised_clusters(
        self, points: NDArray[np.float32], mask: NDArray[np.uint8]
    ) -> list[NDArray[np.int64]]:
        order, starts = grid_clusters(
            points,
            mask,
            self._limits,
            JUMP,
            JUMP_SIGMAS,
            self._settings.min_points,
        )
        parts = [order[a:b] for a, b in pairwise(starts)]
        return sorted(parts, key=len, reverse=True)

    def _unorganised_clusters(
        self, points: NDArray[np.float32], indices: NDArray[np.int64]
    ) -> list[NDArray[np.int64]]:
        gap = max(self._settings.cluster_angle, LINES_APART * self._noise.between_lines)
        labels = neighbour_labels(points[indices].astype(np.float64), gap)
        sizes = np.bincount(labels, minlength=1)
        largest_first = np.argsort(-sizes, kind="stable")
        return [
            indices[labels == k] for k in largest_first if sizes[k] >= self._settings.min_points
        ]


def _bounds_of(
    planes: Sequence[DetectedPlane], settings: PerceptionSettings
) -> tuple[NDArray[Any], ...]:
    """Arrays of planes for `readings_before`: normals, offsets and margins (n, 6), the half-planes
    of their hulls (m, 4) as `DetectedPlane.hull_cones` has them, where those of each plane begin
    (n + 1,); cells of openings (k,), coordinates (n, 8) and shapes (n, 3) as in `_openings_of`;
    reliefs (n, 14) as in `_relief_of`."""
    cones = [np.zeros((0, 4)), *(plane.hull_cones for plane in planes)]
    starts = np.cumsum([0, *(len(cone) for cone in cones[1:])])
    numbers = [
        [*plane.numbers, settings.plane_sigmas**2, settings.plane_tolerance**2] for plane in planes
    ]
    return (
        np.array(numbers, dtype=np.float32).reshape(-1, 6),
        np.concatenate(cones).astype(np.float32),
        starts.astype(np.int64),
        *_openings_of(planes),
        np.array([_relief_of(plane) for plane in planes], dtype=np.float32).reshape(-1, 14),
    )


def _relief_of(plane: DetectedPlane) -> NDArray[np.float64]:
    """Relief of a plane (14,): its two axes, the origin along them, and the coefficients."""
    if (relief := plane.relief) is None:
        return np.zeros(14)
    return np.concatenate([relief.axes.T.ravel(), relief.origin @ relief.axes, relief.coefficients])


def _openings_of(
    planes: Sequence[DetectedPlane],
) -> tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.int64]]:
    """Open cells of all planes in a row (k,); per plane the axes in cells and the first cell's
    corner along them (n, 8); and its first cell in the row with the numbers of rows and columns
    (n, 3), zero without an opening."""
    cells, grids = [np.zeros(0, dtype=bool)], np.zeros((len(planes), 8))
    shapes = np.zeros((len(planes), 3), dtype=np.int64)
    for k, plane in enumerate(planes):
        if (mask := plane.openings) is not None:
            axes = mask.axes.T / mask.cell
            grids[k] = [*axes.ravel(), *(axes @ mask.origin)]
            shapes[k] = sum(map(len, cells)), *mask.clear.shape
            cells.append(mask.clear.ravel())
    return np.concatenate(cells), grids.astype(np.float32), shapes


@allocating_entry
def readings_before(
    points: Any,
    planes: Any,
    cones: Any,
    starts: Any,
    cells: Any,
    grids: Any,
    shapes: Any,
    reliefs: Any,
    limits: Any,
    continued: bool,
) -> tuple[Any, int]:
    """Return the indices of readings in range that lie before all planes, as `free_ranges` has it,
    and the number of readings in range.

    `continued`: leave out what lies on a plane beyond its hull, too, as a sensor that has moved
    sees more of a wall.

    A reading lies before a plane where its distance exceeds the margin at its own range: the margin
    grows with range, and the distance falls. A ray is in a plane's hull where it is in the
    half-space of each of its sides, and on the plane where it meets it in no open cell.

    `points` (n, 3) float32 m, may hold NaN; `planes` (m, 6) float32, normal, offset in m, squared
    `plane_sigmas`, squared tolerance in m²; `cones` (k, 4) float32, normals and bounds of
    half-spaces of unit directions; `starts` (m + 1,) where each plane's cones begin; `cells` (j,)
    bool, `grids` (m, 8) float32 and `shapes` (m, 3) as in `_openings_of`; `reliefs` (m, 14) float32
    as in `_relief_of`; `limits` (5,) float32, as in `ForegroundFinder`.
    """
    size = 256
    kept = np.empty(points.shape[0], dtype=np.int64)
    count = readings = 0
    rays = np.empty((5, size), dtype=np.float32)
    x, y, z, ranges, variances = rays
    rises, away = np.empty((2, size), dtype=np.float32)
    numbers = np.empty(size, dtype=np.int64)
    inside = np.empty(size, dtype=np.bool_)
    for first in range(0, points.shape[0], size):
        n = 0
        for i in range(first, min(first + size, points.shape[0])):
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            range2 = px * px + py * py + pz * pz
            # NaN compares false with everything.
            if limits[0] <= range2 <= limits[1]:
                length = np.sqrt(range2)
                x[n], y[n], z[n], ranges[n] = px / length, py / length, pz / length, length
                variances[n] = min(limits[2] + limits[3] * range2 * range2, limits[4])
                numbers[n] = i
                n += 1
        readings += n
        for k in range(planes.shape[0]):
            a, b, c, offset = planes[k, 0], planes[k, 1], planes[k, 2], planes[k, 3]
            sigmas2, tolerance2 = planes[k, 4], planes[k, 5]
            reached = 0
            _rise(rises, x, y, z, ranges, n, reliefs[k])
            for i in range(n):
                cosine = -(x[i] * a + y[i] * b + z[i] * c)
                distance = -offset - ranges[i] * cosine - rises[i]
                margin2 = sigmas2 * variances[i] * cosine * cosine + tolerance2
                ahead = (distance > 0.0) & (distance * distance > margin2)
                inside[i] = (cosine > 1e-6) & ~ahead
                reached += inside[i]
                away[i] = distance
            if reached > 0:
                for j in range(starts[k], starts[k + 1]):
                    a, b, c, bound = cones[j, 0], cones[j, 1], cones[j, 2], cones[j, 3]
                    for i in range(n):
                        inside[i] &= x[i] * a + y[i] * b + z[i] * c <= bound
                _leave_openings(inside, x, y, z, n, planes[k], cells, grids[k], shapes[k])
            if continued:
                for i in range(n):
                    inside[i] |= away[i] * away[i] <= sigmas2 * variances[i] + tolerance2
            elif reached == 0:
                continue
            n = _keep_outside(inside, rays, numbers, n)
        kept[count : count + n] = numbers[:n]
        count += n
    return kept[:count].copy(), readings


@kernel
def _keep_outside(inside: Any, rays: Any, numbers: Any, n: int) -> int:
    """Move those of n rays (5, size), with their numbers (size,), that are not inside to the front,
    in their order; return how many they are."""
    left = 0
    for i in range(n):
        if not inside[i]:
            for row in range(rays.shape[0]):
                rays[row, left] = rays[row, i]
            numbers[left] = numbers[i]
            left += 1
    return left


@kernel
def _rise(rises: Any, x: Any, y: Any, z: Any, ranges: Any, n: int, relief: Any) -> None:
    """Set the heights (n,) m of a surface over its plane where n readings at (n,) ranges along
    (x, y, z) stand over it, as `PlaneRelief.heights` has it."""
    rises[:n] = 0.0
    if _is_flat(relief):
        return
    for i in range(n):
        rises[i] = _height(ranges[i] * x[i], ranges[i] * y[i], ranges[i] * z[i], relief)


@kernel
def _is_flat(relief: Any) -> bool:
    return relief[0] == 0.0 and relief[1] == 0.0 and relief[2] == 0.0


@kernel
def _height(x: Any, y: Any, z: Any, relief: Any) -> Any:
    """Height in m of a surface over its plane where a reading stands over it."""
    a = min(max(x * relief[0] + y * relief[1] + z * relief[2] - relief[6], -1.0), 1.0)
    b = min(max(x * relief[3] + y * relief[4] + z * relief[5] - relief[7], -1.0), 1.0)
    flat = relief[8] + relief[9] * a + relief[10] * b
    return flat + relief[11] * a * a + relief[12] * a * b + relief[13] * b * b


@kernel
def _leave_openings(
    inside: Any, x: Any, y: Any, z: Any, n: int, plane: Any, cells: Any, grid: Any, shape: Any
) -> None:
    """Unmark those of n rays along (x, y, z) that meet a plane in an open cell; its openings are as
    in `_openings_of`."""
    first, rows, columns = shape
    if rows == 0:
        return
    for i in range(n):
        if not inside[i]:
            continue
        far = plane[3] / (x[i] * plane[0] + y[i] * plane[1] + z[i] * plane[2])
        row = int(np.floor(far * (x[i] * grid[0] + y[i] * grid[1] + z[i] * grid[2]) - grid[6]))
        column = int(np.floor(far * (x[i] * grid[3] + y[i] * grid[4] + z[i] * grid[5]) - grid[7]))
        if 0 <= row < rows and 0 <= column < columns:
            inside[i] = not cells[first + row * columns + column]


def free_ranges(
    directions: NDArray[np.float32],
    planes: Sequence[DetectedPlane],
    noise: RangeNoise,
    settings: PerceptionSettings,
) -> NDArray[np.float32]:
    """Range up to which a reading along each ray lies off and before all planes, (n,) m.

    The reading at range ρ of a ray that meets a plane at an angle of cosine c, inside the plane's
    hull, lies before it when its distance exceeds √((s σ(ρ) c)² + t²): s deviations of the noise
    and the unevenness t.

    `directions` (n, 3) of any length, from the sensor.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    free = np.full(len(unit), settings.max_range, dtype=np.float32)
    for plane in planes:
        cosine = -(unit @ plane.normal.astype(unit.dtype))
        meets = np.flatnonzero(cosine > 1e-6)
        cosine = cosine[meets]
        inside = plane.covers(unit[meets] * (-plane.offset / cosine)[:, None])
        meets, cosine = meets[inside], cosine[inside]
        begins = -plane.offset / cosine
        # A contraction: what the noise lets pass grows far slower with range than the distance.
        for _ in range(ITERATIONS):
            spread = settings.plane_sigmas * noise.deviation(begins) * cosine
            margin = np.hypot(spread, settings.plane_tolerance)
            surface = plane.heights(unit[meets] * begins[:, None])
            begins = np.maximum((-plane.offset - surface - margin) / cosine, 0.0)
        free[meets] = np.minimum(free[meets], begins)
    return free


def changed_ranges(before: NDArray[np.float32], noise: RangeNoise) -> NDArray[np.float32]:
    """Squared range (height, width) m² below which a reading differs from the one before.

    `before` (height, width) m, NaN where nothing was read, and nothing is known.
    """
    nearest = before - CHANGE_SIGMAS * np.sqrt(2.0) * noise.deviation(before)
    return np.square(np.maximum(nearest, 0.0)).astype(np.float32)


@allocating_entry
def _foreground(points: Any, free: Any, changes: Any, limits: Any) -> tuple[Any, int]:
    """Mark points in range and before all planes, which begin at the squared range `free`, as NEW
    below the squared range `changes`, as KNOWN beyond it and as UNKNOWN where that is NaN.

    No branch, which the compiler turns into vector code.
    """
    height, width = free.shape
    min_range2, max_range2 = limits[0], limits[1]
    mask = np.empty((height, width), dtype=np.uint8)
    readings = 0
    for v in range(height):
        for u in range(width):
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            range2 = x * x + y * y + z * z
            # NaN compares false with everything.
            read = (range2 >= min_range2) & (range2 <= max_range2)
            change = changes[v, u]
            mark = KNOWN + (range2 < change) + (UNKNOWN - KNOWN) * np.isnan(change)
            mask[v, u] = (read & (range2 < free[v, u])) * mark
            readings += read
    return mask, readings


def neighbour_labels(points: NDArray[np.float64], gap: float) -> NDArray[np.int64]:
    """Label (n,) points that hang together by neighbours nearer than `gap` times their range.

    The map to direction and logarithm of range keeps shapes and divides lengths by the range, so
    one distance in it stands for a gap that grows with range as the spacing of readings does.

    `points` (n, 3) m, the sensor at the origin; `gap` in rad.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    if not len(points):
        return np.zeros(0, dtype=np.int64)
    ranges = np.linalg.norm(points, axis=1)
    mapped = np.column_stack([points / ranges[:, None], np.log(ranges)])
    # Where readings are denser than needed one of them stands for its cell.
    cells = np.floor(mapped * min(CELLS_PER_GAP / gap, FINEST_CELLS)).astype(np.int64)
    cells -= cells.min(axis=0)
    # One number for each cell, which sorts far faster than four.
    keys = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, first, cell_of = np.unique(keys, return_index=True, return_inverse=True)
    pairs = KDTree(mapped[first]).query_pairs(gap, output_type="ndarray")
    graph = coo_array(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])),
        shape=(first.size, first.size),
    )
    return connected_components(graph, directed=False)[1][cell_of.ravel()].astype(np.int64)


@allocating_entry
def grid_clusters(
    points: Any, mask: Any, limits: Any, constant: float, sigmas: float, min_points: int
) -> tuple[Any, Any]:
    """Connect neighbouring pixels of one mark whose range does not jump; 8-connected.

    `points` (height, width, 3) float32 m; `mask` (height, width) uint8, nonzero in the foreground,
    there the number of a group; `limits` (5,) float32, squares of range and noise parameters as in
    `ForegroundFinder`; `constant` in m, difference of range that is a jump; `sigmas`: standard
    deviations of the range that are added to it. Returns `order` (n,) indices of pixels, those of
    one cluster together; `starts` (n_clusters + 1,) where each cluster starts in `order`.
    """
    height, width = mask.shape
    _, _, constant2, quadratic2, limit2 = limits
    label = np.full((height, width), -1, dtype=np.int32)
    ranges = np.empty((2, width), dtype=np.float32)
    parent = np.empty(height * width, dtype=np.int32)
    count = 0
    for v in range(height):
        now, before = v & 1, 1 - (v & 1)
        for u in range(width):
            if mask[v, u] == 0:
                continue
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            range2 = x * x + y * y + z * z
            own = np.sqrt(range2)
            ranges[now, u] = own
            deviation = np.sqrt(min(constant2 + quadratic2 * range2 * range2, limit2))
            jump = constant + sigmas * deviation
            best = -1
            for dv, du in ((0, -1), (-1, -1), (-1, 0), (-1, 1)):
                i, j = v + dv, u + du
                if i < 0 or j < 0 or j >= width or mask[i, j] != mask[v, u]:
                    continue
                other = ranges[now, j] if dv == 0 else ranges[before, j]
                if abs(own - other) > jump:
                    continue
                root = _root(parent, label[i, j])
                if best < 0:
                    best = root
                elif root != best:
                    parent[max(root, best)] = min(root, best)
                    best = min(root, best)
            if best < 0:
                best = count
                parent[count] = count
                count += 1
            label[v, u] = best
    return _gathered(label, parent, count, min_points)


@kernel
def _root(parent: Any, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@allocating_kernel
def _gathered(label: Any, parent: Any, count: int, min_points: int) -> tuple[Any, Any]:
    """Sort pixels by cluster and leave out clusters of fewer than `min_points`."""
    flat = label.ravel()
    size = np.zeros(count, dtype=np.int64)
    for i in range(flat.size):
        if flat[i] >= 0:
            flat[i] = _root(parent, flat[i])
            size[flat[i]] += 1
    place = np.full(count, -1, dtype=np.int64)
    starts = np.zeros(count + 1, dtype=np.int64)
    kept = 0
    for k in range(count):
        if size[k] >= min_points:
            place[k] = starts[kept]
            starts[kept + 1] = starts[kept] + size[k]
            kept += 1
    order = np.empty(starts[kept], dtype=np.int64)
    for i in range(flat.size):
        if flat[i] >= 0 and place[flat[i]] >= 0:
            order[place[flat[i]]] = i
            place[flat[i]] += 1
    return order, starts[: kept + 1]
