"""Foreground of a frame: points off all planes, in clusters that may be objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, allocating_kernel, kernel
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.known_space import KNOWN, NEW, UNKNOWN, KnownSpace
from intuitive_physics_perception.environment.noise import CHANGE_SIGMAS, RangeNoise
from intuitive_physics_perception.environment.ray_planes import RayPlanes, limits_of
from intuitive_physics_perception.settings import PerceptionSettings

JUMP = 0.02
"""Difference of range that separates neighbouring pixels, m."""

JUMP_SIGMAS = 6.0
"""Standard deviations of the range that are added to that difference."""

CLUSTER_ANGLE = 0.04
"""Gap between neighbours in a cloud that is not organised, rad."""

LINES_APART = 1.2
"""Angles between the lines of a scanner up to which readings are neighbours: on a surface that is
slanted across the lines their ranges differ, too. Set by hand."""

CELLS_PER_GAP = 4.0
"""Cells along a gap in a cloud that is not organised; one reading stands for its cell."""

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
    marks : (height, width) of each point off all planes KNOWN, NEW, UNKNOWN or BEHIND, 0 of the
        others; None where nothing is known of the space
    """

    indices: list[NDArray[np.int64]]
    new: list[bool]
    foreground: int
    readings: int
    marks: NDArray[np.uint8] | None = None

    @cached_property
    def in_a_row(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices (n,) of the points of all clusters, one after another, and where each begins in
        them, (number of clusters + 1,)."""
        return in_a_row(self.indices)

    @property
    def unknown(self) -> int:
        """Number of points in directions in which nobody has seen anything before."""
        return 0 if self.marks is None else int(np.count_nonzero(self.marks == UNKNOWN))


class ForegroundFinder:
    """Takes the planes of one environment out of frames and clusters what is left.

    What came where nothing was makes clusters of its own, so that what lies or flies close before
    something else is separated from it.

    It decides what is new. `before` (height, width) m, what each pixel of an organised cloud read
    when the environment was modelled, NaN where nothing was, decides of the same rays; `space`,
    what is known of the space, of all others. None where nothing is known.
    """

    def __init__(
        self,
        model: EnvironmentModel,
        settings: PerceptionSettings,
        before: NDArray[np.float32] | None = None,
        space: KnownSpace | None = None,
    ) -> None:
        self._settings = settings
        self._space = space
        self._limits = limits_of(model.noise, settings)
        self._free = np.zeros((0, 0), dtype=np.float32)
        self._changes = None if before is None else changed_ranges(before, model.noise)
        self.look_from(model, has_moved=False)

    def look_from(self, model: EnvironmentModel, *, has_moved: bool) -> None:
        """Take the same environment as the sensor sees it now, and whether pixels have other rays
        than where it was modelled."""
        self._model = model
        # A sensor that has come behind a plane sees nothing of it.
        planes = [plane for plane in model.detected if plane.offset < 0.0]
        self._planes = RayPlanes(planes, model.noise, self._settings)
        self._map = self._space if has_moved or self._changes is None else None
        self._objects = np.zeros(0, dtype=np.int64)

    @property
    def asks_map(self) -> bool:
        """Whether the map of the space decides what is new."""
        return self._map is not None

    def expect_objects(self, pixels: Sequence[NDArray[np.int64]]) -> None:
        """Take which pixels, (n,) of each object, of an organised frame showed objects: in the next
        frame they count as new, wherever the objects were when the environment was modelled."""
        self._objects = np.concatenate([np.zeros(0, dtype=np.int64), *pixels])

    def before(self, points: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the indices of those of points (n, 3) m that lie before all planes."""
        return self._planes.readings_before(points)[0]

    def find(self, points: NDArray[np.float32]) -> Clusters:
        """Cluster the foreground of a frame of points (height, width, 3)."""
        marks, readings, is_known = self._marks(points)
        groups = np.minimum(marks, NEW)
        fresh = marks == NEW
        if is_known and self._objects.size and points.shape[0] > 1:
            shown = self._objects[groups.ravel()[self._objects] > 0]
            groups.ravel()[shown], fresh.ravel()[shown] = NEW, True
        indices = self._clusters(points, groups)
        new = np.zeros(len(indices), dtype=bool)
        if is_known:
            maybe = [k for k, part in enumerate(indices) if groups.ravel()[part[0]] == NEW]
            new[maybe] = _mostly(fresh.ravel(), *in_a_row([indices[k] for k in maybe]))
        return Clusters(
            indices,
            new.tolist(),
            int(np.count_nonzero(marks)),
            readings,
            marks if is_known else None,
        )

    def _marks(self, points: NDArray[np.float32]) -> tuple[NDArray[np.uint8], int, bool]:
        """Marks (height, width) of what lies before all planes, the number of readings, and whether
        anything is known of the space; where nothing is, all that lies there is KNOWN."""
        if points.shape[0] > 1 and self._map is None:
            free, changes = self._free_of(points), self._changes
            is_known = changes is not None and changes.shape == free.shape
            limits = changes if is_known else np.zeros_like(free)
            marks, readings = _foreground(points.reshape(-1), free, limits, self._limits)
            return marks, readings, is_known
        flat, is_known = points.reshape(-1, 3), self._map is not None
        before, readings = self._planes.readings_before(flat, continued=is_known)
        if self._map is not None:
            marks = self._map.marks(flat, before, self._model.sensor_pose)
        else:
            marks = np.zeros(len(flat), dtype=np.uint8)
            marks[before] = KNOWN
        return marks.reshape(points.shape[:2]), readings, is_known

    def _free_of(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Squared range (height, width) m² at which each ray, always the same, meets a plane; NaN
        where none was read yet."""
        if self._free.shape != points.shape[:2]:
            self._free = np.full(points.shape[:2], np.nan, dtype=np.float32)
        flat, free = points.reshape(-1, 3), self._free.reshape(-1)
        new = np.flatnonzero(np.isfinite(flat[:, 2]) & np.isnan(free))
        if new.size:
            free[new] = np.square(self._planes.free_ranges(flat[new]))
        return self._free

    def _clusters(
        self, points: NDArray[np.float32], groups: NDArray[np.uint8]
    ) -> list[NDArray[np.int64]]:
        """Indices (n,) of each cluster, largest first, of points of one group, (height, width)."""
        fewest = self._settings.min_points
        parts: list[NDArray[np.int64]] = []
        if points.shape[0] > 1:
            order, starts = grid_clusters(points, groups, self._limits, JUMP, JUMP_SIGMAS, fewest)
            parts = [order[a:b] for a, b in pairwise(starts)]
        else:
            gap = max(CLUSTER_ANGLE, LINES_APART * self._model.noise.between_lines)
            for group in (KNOWN, NEW):
                indices = np.flatnonzero(groups == group)
                labels = neighbour_labels(points[0, indices].astype(np.float64), gap)
                sizes = np.bincount(labels, minlength=1)
                parts += [indices[labels == k] for k in np.flatnonzero(sizes >= fewest)]
        return sorted(parts, key=len, reverse=True)


def in_a_row(
    indices: Sequence[NDArray[np.int64]],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices (n,) of the points of some clusters, one after another, and where each
    begins in them, (number of clusters + 1,).

    `indices` (k,) of the points of each.
    """
    starts = np.cumsum([0, *map(len, indices)], dtype=np.int64)
    return np.concatenate([np.zeros(0, dtype=np.int64), *indices]), starts


@allocating_entry
def _mostly(chosen: Any, order: Any, starts: Any) -> Any:
    """Mark (k,) clusters, as `Clusters.in_a_row` has them, more than half of whose points are
    chosen, (n,)."""
    marked = np.empty(starts.size - 1, dtype=np.bool_)
    for k in range(starts.size - 1):
        count = 0
        for j in range(starts[k], starts[k + 1]):
            count += chosen[order[j]]
        marked[k] = 2 * count > starts[k + 1] - starts[k]
    return marked


def changed_ranges(before: NDArray[np.float32], noise: RangeNoise) -> NDArray[np.float32]:
    """Squared range (height, width) m² below which a reading differs from the one before.

    `before` (height, width) m, NaN where nothing was read, and nothing is known.
    """
    nearest = before - CHANGE_SIGMAS * np.sqrt(2.0) * noise.deviation(before)
    return np.square(np.maximum(nearest, 0.0)).astype(np.float32)


@allocating_entry
def _foreground(numbers: Any, free: Any, changes: Any, limits: Any) -> tuple[Any, int]:
    """Mark points in range and before all planes, which begin at the squared range `free`, as NEW
    below the squared range `changes`, as KNOWN beyond it and as UNKNOWN where that is NaN.

    `numbers` (3 height width,) m, coordinates of the points in a row; `free` and `changes` (height,
    width) m². No branch, and one row, which the compiler turns into vector code.
    """
    mask = np.empty(free.shape, dtype=np.uint8)
    flat, nearest, before = mask.reshape(-1), free.reshape(-1), changes.reshape(-1)
    least2, most2 = limits[0], limits[1]
    readings = 0
    for i in range(flat.size):
        x, y, z = numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]
        range2 = x * x + y * y + z * z
        # NaN compares false with everything.
        read = (range2 >= least2) & (range2 <= most2)
        mark = KNOWN + (range2 < before[i]) + (UNKNOWN - KNOWN) * np.isnan(before[i])
        flat[i] = (read & (range2 < nearest[i])) * mark
        readings += read
    return mask, readings


def neighbour_labels(points: NDArray[np.float64], gap: float) -> NDArray[np.int64]:
    """Label (n,) points that hang together by neighbours nearer than `gap` times their range.

    The map to direction and logarithm of range keeps shapes and divides lengths by the range, so
    one distance in it stands for a gap that grows with range as the spacing of readings does.

    `points` (n, 3) m, the sensor at the origin; `gap` in rad.
    """
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
    return np.asarray(_connected_components(mapped[first], gap)[cell_of.ravel()])


@allocating_entry
def _connected_components(places: Any, gap: float) -> Any:
    """Return the component (count,) of each place (count, 4), numbered from 0 in the order of their
    first places, where places at most `gap` apart hang together.

    By cubes of that size in the first three coordinates: a third of the time of SciPy's k-d tree,
    which lists all pairs first.
    """
    count = places.shape[0]
    cube, starts, (_, rows, columns) = _in_cubes(places, gap)
    order = np.argsort(cube, kind="mergesort")
    ordered = places[order]
    parent = np.arange(count)
    for p in range(count):
        for dx, dy in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 0)):
            # Three cubes along the last coordinate are one run of places.
            middle = cube[order[p]] + (dx * rows + dy) * columns
            end = p if dx == 0 and dy == 0 else starts[middle + 2]
            for q in range(starts[middle - 1], end):
                square = 0.0
                for a in range(4):
                    square += (ordered[p, a] - ordered[q, a]) ** 2
                if square <= gap * gap:
                    one, other = _root(parent, order[p]), _root(parent, order[q])
                    parent[max(one, other)] = min(one, other)
    labels = np.empty(count, dtype=np.int64)
    found = 0
    for i in range(count):
        root = _root(parent, i)
        # The root is the first place of its component.
        if root == i:
            labels[i] = found
            found += 1
        else:
            labels[i] = labels[root]
    return labels


@allocating_kernel
def _in_cubes(places: Any, side: float) -> tuple[Any, Any, Any]:
    """Divide the first three coordinates of places (count, 4) into cubes, with empty ones around.

    Returns the number (count,) of the cube of each; where each cube begins in the order of cubes;
    and how many there are along each coordinate.
    """
    count = places.shape[0]
    lowest, counts = np.empty(3), np.empty(3, dtype=np.int64)
    for a in range(3):
        lowest[a] = places[:, a].min()
        counts[a] = int((places[:, a].max() - lowest[a]) / side) + 3
    cube = np.empty(count, dtype=np.int64)
    starts = np.zeros(counts[0] * counts[1] * counts[2] + 1, dtype=np.int64)
    for i in range(count):
        number = 0
        for a in range(3):
            number = number * counts[a] + int((places[i, a] - lowest[a]) / side) + 1
        cube[i] = number
        starts[number + 1] += 1
    return cube, np.cumsum(starts), counts


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
    pixels, labels = np.empty(mask.size, dtype=np.int64), np.empty(mask.size, dtype=np.int32)
    parent = np.empty(mask.size, dtype=np.int32)
    # Of two rows: what is above a pixel is all that is asked for.
    label = np.empty((2, width), dtype=np.int32)
    ranges = np.empty((2, width), dtype=np.float32)
    count = found = 0
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
                row = now if dv == 0 else before
                if label[row, j] == best or abs(own - ranges[row, j]) > jump:
                    continue
                root = _root(parent, label[row, j])
                if best < 0:
                    best = root
                elif root != best:
                    parent[max(root, best)] = min(root, best)
                    best = min(root, best)
            if best < 0:
                best = count
                parent[count] = count
                count += 1
            label[now, u] = labels[found] = best
            pixels[found] = v * width + u
            found += 1
    return _gathered(pixels[:found], labels[:found], parent[:count], min_points)


@kernel
def _root(parent: Any, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@allocating_kernel
def _gathered(pixels: Any, labels: Any, parent: Any, min_points: int) -> tuple[Any, Any]:
    """Sort pixels (n,) of labels (n,) by cluster and leave out clusters of fewer than `min_points`.

    `parent` (m,): of each label one of the same cluster, at last the smallest of them.
    """
    count = parent.size
    size = np.zeros(count, dtype=np.int64)
    for k in range(count):
        parent[k] = _root(parent, k)
    for label in labels:
        size[parent[label]] += 1
    place = np.full(count, -1, dtype=np.int64)
    starts = np.zeros(count + 1, dtype=np.int64)
    kept = 0
    for k in range(count):
        if size[k] >= min_points:
            place[k] = starts[kept]
            starts[kept + 1] = starts[kept] + size[k]
            kept += 1
    order = np.empty(starts[kept], dtype=np.int64)
    for i in range(labels.size):
        root = parent[labels[i]]
        if place[root] >= 0:
            order[place[root]] = pixels[i]
            place[root] += 1
    return order, starts[: kept + 1]
