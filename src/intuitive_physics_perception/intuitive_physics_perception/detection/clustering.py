"""Foreground points in groups that hang together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

JUMP_CONSTANT = 0.02
JUMP_SIGMAS = 6.0
CELLS_PER_GAP = 4.0


def neighbour_labels(points: NDArray[np.float64], gap: float) -> NDArray[np.int64]:
    """Label (n,) points that hang together by neighbours nearer than `gap` times their range.

    The map to direction and logarithm of range keeps shapes and divides lengths by the range, so
    one distance in it stands for a gap that grows with range as the spacing of readings does.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if not len(points):
        return np.zeros(0, dtype=np.int64)
    ranges = np.linalg.norm(points, axis=1)
    mapped = np.column_stack([points / ranges[:, None], np.log(ranges)])
    # Where readings are denser than needed one of them stands for its cell.
    cells = np.floor(mapped * (CELLS_PER_GAP / gap)).astype(np.int64)
    _, first, cell_of = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    pairs = cKDTree(mapped[first]).query_pairs(gap, output_type="ndarray")
    graph = coo_array(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])),
        shape=(first.size, first.size),
    )
    return connected_components(graph, directed=False)[1][cell_of.ravel()].astype(np.int64)


@njit(nogil=True, cache=True, error_model="numpy")
def grid_clusters(points: Any, mask: Any, limits: Any, min_points: int) -> tuple[Any, Any]:
    """Connect neighbouring foreground pixels whose range does not jump; 8-connected.

    Returns
    -------
    order : (n,) indices of pixels, those of one cluster together
    starts : (n_clusters + 1,) where each cluster starts in `order`
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
            jump = JUMP_CONSTANT + JUMP_SIGMAS * deviation
            best = -1
            for dv, du in ((0, -1), (-1, -1), (-1, 0), (-1, 1)):
                i, j = v + dv, u + du
                if i < 0 or j < 0 or j >= width or mask[i, j] == 0:
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


@njit(nogil=True, cache=True, error_model="numpy")
def _root(parent: Any, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(nogil=True, cache=True, error_model="numpy")
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
