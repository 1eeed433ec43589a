"""Places of a modelled view by which a sensor finds where it is: patches of surface, and the ends
of what stands before something farther."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.planes import DetectedPlane
from intuitive_physics_perception.environment.ray_planes import RayPlanes
from intuitive_physics_perception.sensor_motion.lens import fitted_lens, slopes_of
from intuitive_physics_perception.settings import PerceptionSettings

PATCH_SIDE = 5
"""Pixels along the side of a patch: most of what stands about is flat over them, and they are more
than a matching window."""

PATCH_REACH = PATCH_SIDE // 2
"""Pixels from the middle of a patch to its sides."""

PATCH_STEP = 3
"""Pixels from the middle of one patch to that of the next."""

PATCH_READINGS = 13
"""Readings that a patch needs, of 25."""

FLATNESS = 2.0
"""Mean squared residual of a patch, in variances, up to which it is flat. Set by hand."""

ON_PLANE_ANGLE = 0.1
"""rad by which the normal of a patch on a plane may differ from that of the plane, beside three
standard deviations of its own."""

PLANE_PATCHES = 150
"""Patches that are kept of each plane, evenly: enough to determine its three numbers."""

OTHER_PATCHES = 600
"""Patches that are kept of all else, evenly."""

EDGE_JUMP = 0.05
"""Part of the range by which it must jump at an edge, and m that it must jump at least by twice."""

LARGEST_GAP = 8
"""Pixels without a reading between the two sides of an edge at most: the shadow of a stereo camera
with a base of 5 cm between 2 and 3 m."""

EDGE_REACH = 4
"""Pixels along an edge, on both sides, over which it must be straight."""

EDGE_PLACES = 300
"""Places on edges that are kept."""

EDGE_STEP = 3
"""Rows or columns from one place on an edge to the next: a matching window is about as wide."""

EDGE_DEVIATION = 0.7
"""Standard deviation of where an edge is found, pixels, until it was measured: half a pixel of
rounding, and as much of noise."""

MOST_THINGS = 15
"""Things that may move by themselves and are kept apart; smaller ones count as one."""

OF_EACH = ("places", "normals", "variances", "things", "is_edge", "is_on_plane")
"""Arrays of `Landmarks` with a row for each."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Places of a view, in the frame of the sensor at which it was modelled.

    A patch of surface determines where the sensor is along its normal; the end of a surface before
    something farther does across the line of sight, towards the side of the farther one.

    Parameters
    ----------
    places : (n, 3) m
    normals : (n, 3) unit vectors: of a patch towards the sensor, of an edge across it
    variances : (n,) m², of the place along the normal; of an edge with that of finding it
    things : (n,) number of the thing it belongs to; 0: of the support or of what is as large as a
        wall, which do not move
    is_edge : (n,) whether it is on an edge
    is_on_plane : (n,) whether it is a patch of a plane, whose normal is known
    lens : (10, 2) as of `fitted_lens`
    """

    places: NDArray[np.float64]
    normals: NDArray[np.float64]
    variances: NDArray[np.float64]
    things: NDArray[np.int64]
    is_edge: NDArray[np.bool_]
    is_on_plane: NDArray[np.bool_]
    lens: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.places)

    def chosen(self, which: NDArray[Any]) -> Landmarks:
        """Return some of them; `which` (m,) indices or (n,) marks."""
        chosen = {name: getattr(self, name)[which] for name in OF_EACH}
        return Landmarks(**chosen, lens=self.lens)


def landmarks_of(
    points: NDArray[np.float32], frames: int, model: EnvironmentModel, settings: PerceptionSettings
) -> Landmarks | None:
    """Return the landmarks of a view; None where pixels have no fixed directions.

    `points` (height, width, 3) m that the environment was modelled from, each pixel the median of a
    number of `frames`, NaN where nothing was read.
    """
    lens = fitted_lens(points)
    if lens is None:
        return None
    things = _things(points, model, settings)
    patches = _patches(points, frames, model, settings, things, lens)
    edges = _edges(points, things, lens)
    both = {
        name: np.concatenate([getattr(patches, name), getattr(edges, name)]) for name in OF_EACH
    }
    return Landmarks(**both, lens=lens)


def _things(
    points: NDArray[np.float32], model: EnvironmentModel, settings: PerceptionSettings
) -> NDArray[np.int64]:
    """Number of the thing that each pixel shows, (height, width): connected readings before all
    that is as large as a wall."""
    from scipy.ndimage import label

    large = [
        plane
        for k, plane in enumerate(model.detected)
        if (k == 0 and model.has_support) or plane.width > settings.static_box_max_size
    ]
    before, _ = RayPlanes(large, model.noise, settings).readings_before(points.reshape(-1, 3))
    mask = np.zeros(points.shape[:2], dtype=bool)
    mask.reshape(-1)[before] = True
    numbers, count = label(mask)
    sizes = np.bincount(numbers.ravel(), minlength=count + 1)
    sizes[0] = len(numbers.ravel()) + 1
    ranks = np.empty(count + 1, dtype=np.int64)
    ranks[np.argsort(-sizes)] = np.arange(count + 1)
    return np.asarray(np.minimum(ranks, MOST_THINGS)[numbers])


def _patches(
    points: NDArray[np.float32],
    frames: int,
    model: EnvironmentModel,
    settings: PerceptionSettings,
    things: NDArray[np.int64],
    lens: NDArray[np.float64],
) -> Landmarks:
    """Flat patches of the view. On a plane they have its normal."""
    places, normals, variances, turns, rows, columns = _fitted_patches(points, frames, model.noise)
    on_plane = np.full(len(places), -1)
    for k, plane in enumerate(model.detected):
        near = _is_on(plane, places, normals, turns, model.noise, settings)
        on_plane[near & (on_plane < 0)] = k
        normals[on_plane == k] = plane.normal
    kept = [
        _evenly(np.flatnonzero(on_plane == k), PLANE_PATCHES) for k in range(len(model.detected))
    ]
    kept.append(_evenly(np.flatnonzero(on_plane < 0), OTHER_PATCHES))
    patches = Landmarks(
        places,
        normals,
        variances,
        things[rows, columns],
        np.zeros(len(places), dtype=bool),
        on_plane >= 0,
        lens,
    )
    return patches.chosen(np.concatenate(kept))


def _fitted_patches(
    points: NDArray[np.float32], frames: int, noise: RangeNoise
) -> tuple[NDArray[Any], ...]:
    """Places (n, 3) m, normals (n, 3), variances (n,) m² along them and (n,) rad² of the normals,
    rows (n,) and columns (n,) of all flat patches.

    A plane x · p = 1 has the inverse range x · u along the unit vector u, so x is a regression in
    which only the inverse range errs. In the axes (w, e, f), w along the ray of the middle, it is
    one in the slopes of the other rays.
    """
    rows, columns, axes, counts, means, scatter = _patch_moments(points)
    spread, common = scatter[:, 1:, 1:], scatter[:, 1:, 0]
    determinants = np.linalg.det(spread)
    kept = (counts >= PATCH_READINGS) & (determinants > 1e-3 * spread[:, 0, 0] * spread[:, 1, 1])
    rows, columns, axes, counts, means, spread, common = (
        array[kept] for array in (rows, columns, axes, counts, means, spread, common)
    )
    inverse = np.linalg.inv(spread)
    slopes = (inverse @ common[:, :, None])[:, :, 0]
    rest = scatter[kept, 0, 0] - (slopes * common).sum(axis=1)
    at_middle = means[:, 0] - (slopes * means[:, 1:]).sum(axis=1)
    g = np.column_stack([at_middle, slopes])
    reach2, lengths2 = 1.0 / at_middle**2, np.square(g).sum(axis=1)
    # The median of n readings has π / 2 times the variance of their mean.
    share = 1.0 if frames == 1 else 0.5 * np.pi / frames
    constant, quadratic, limit, lateral = share * noise.squares
    slope2 = np.square(slopes).sum(axis=1) * reach2
    reading = np.minimum(constant + quadratic * reach2**2, limit) + lateral * reach2 * slope2
    # Of an inverse range.
    error2 = reading / reach2**2
    flat = (at_middle > 0.0) & (rest <= FLATNESS * error2)
    error2 *= np.minimum(noise.correlated, counts) / counts
    away2 = np.einsum("ni,nij,nj->n", means[:, 1:], inverse, means[:, 1:])
    normals = -np.einsum("ni,nij->nj", g, axes) / np.sqrt(lengths2)[:, None]
    # Errors of the slopes turn a normal by what of the axes is across it.
    across = axes[:, 1:] - (axes[:, 1:] @ normals[:, :, None]) * normals[:, None]
    turns = np.einsum("nki,nkl,nli->n", across, inverse, across) * error2 / lengths2
    found = (
        axes[:, 0] / at_middle[:, None],
        normals,
        error2 * (1.0 + away2) * reach2**2 / (1.0 + slope2),
        turns,
        rows,
        columns,
    )
    return tuple(array[flat] for array in found)


def _patch_moments(points: NDArray[np.float32]) -> tuple[NDArray[Any], ...]:
    """Rows (n,) and columns (n,) of the middles of patches that were read; axes (n, 3, 3) along
    their rays and across; numbers (n,), means (n, 3) and covariances (n, 3, 3) of the readings:
    inverse ranges along the middle, and slopes."""
    height, width = points.shape[:2]
    middles = (np.arange(PATCH_REACH, size - PATCH_REACH, PATCH_STEP) for size in (height, width))
    rows, columns = (axis.ravel() for axis in np.meshgrid(*middles, indexing="ij"))
    lengths = np.linalg.norm(points[rows, columns].astype(np.float64), axis=1)
    # NaN compares false with everything.
    rows, columns, lengths = (array[lengths > 0.0] for array in (rows, columns, lengths))
    along = points[rows, columns] / lengths[:, None]
    # Across the y axis, which a camera hardly looks along.
    side = np.cross([0.0, 1.0, 0.0], along)
    side /= np.linalg.norm(side, axis=1, keepdims=True) + 1e-12
    axes = np.stack([along, side, np.cross(along, side)], axis=1)
    offsets = np.arange(-PATCH_REACH, PATCH_REACH + 1)
    patches = points[rows[:, None, None] + offsets[:, None], columns[:, None, None] + offsets]
    turned = patches.reshape(len(rows), -1, 3).astype(np.float64) @ axes.transpose(0, 2, 1)
    is_read = turned[:, :, :1] > 0.0
    turned[~is_read[:, :, 0]] = 1.0, 0.0, 0.0
    readings = turned / turned[:, :, :1]
    readings[:, :, :1] = 1.0 / turned[:, :, :1]
    readings *= is_read
    counts = is_read.sum(axis=(1, 2))
    means = readings.sum(axis=1) / counts[:, None]
    squares = readings.transpose(0, 2, 1) @ readings / counts[:, None, None]
    return rows, columns, axes, counts, means, squares - means[:, :, None] * means[:, None]


def _is_on(
    plane: DetectedPlane,
    places: NDArray[np.float64],
    normals: NDArray[np.float64],
    turns: NDArray[np.float64],
    noise: RangeNoise,
    settings: PerceptionSettings,
) -> NDArray[np.bool_]:
    """Mark the patches (n,) that are part of a plane, by place and normal, with variances (n,)."""
    ranges = np.linalg.norm(places, axis=1)
    along = places @ plane.normal
    distances = along - plane.offset - plane.heights(places)
    margins = np.hypot(
        settings.plane_sigmas * noise.deviation(ranges) * along / ranges, settings.plane_tolerance
    )
    turned = np.linalg.norm(normals - plane.normal, axis=1)
    own = 3.0 * np.sqrt(turns)
    return np.asarray((np.abs(distances) < margins) & (turned < ON_PLANE_ANGLE + own))


def _evenly(which: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Indices (m,), at most `most`, spaced evenly over those given, (n,)."""
    return which[np.linspace(0, len(which) - 1, min(most, len(which))).astype(np.int64)]


def _edges(
    points: NDArray[np.float32], things: NDArray[np.int64], lens: NDArray[np.float64]
) -> Landmarks:
    """Places on straight edges of what stands before something farther."""
    ranges = np.linalg.norm(points, axis=2).astype(np.float64)
    found: list[NDArray[np.float64]] = []
    labels: list[NDArray[np.int64]] = []
    for transposed in (False, True):
        image, numbers = (ranges.T, things.T) if transposed else (ranges, things)
        for side in (1, -1):
            marks = _marked_edges(image, side)
            lines, columns = np.nonzero(marks)
            slopes = _line_slopes(marks, lines, columns)
            kept = np.isfinite(slopes) & (lines % EDGE_STEP == 0)
            lines, columns, slopes = lines[kept], columns[kept], slopes[kept]
            at = np.stack([lines, columns + 0.5 * side], axis=1)
            across = np.stack([-side * slopes, np.full(len(lines), float(side))], axis=1)
            across /= np.linalg.norm(across, axis=1, keepdims=True)
            if transposed:
                at, across = at[:, ::-1], across[:, ::-1]
            found.append(np.column_stack([at, across, image[lines, columns]]))
            labels.append(numbers[lines, columns])
    table, thing = np.concatenate(found), np.concatenate(labels)
    kept = _evenly(np.arange(len(table)), EDGE_PLACES)
    return _edge_landmarks(table[kept], thing[kept], lens)


def _edge_landmarks(
    table: NDArray[np.float64], things: NDArray[np.int64], lens: NDArray[np.float64]
) -> Landmarks:
    """Landmarks at rows, columns, directions across in rows and columns, and ranges, (n, 5)."""
    slopes, jacobian = slopes_of(table[:, :2], lens)
    directions = np.column_stack([slopes, np.ones(len(slopes))])
    lengths = np.linalg.norm(directions, axis=1)
    depths = table[:, 4] / lengths
    places = directions * depths[:, None]
    # An edge at s pixels along `across` is at h · p = s, to first order about the place.
    g = np.einsum("nij,ni->nj", jacobian, table[:, 2:4])
    h = np.column_stack([g, -(g * slopes).sum(axis=1)]) / np.maximum(depths, 1e-9)[:, None]
    size = np.maximum(np.linalg.norm(h, axis=1), 1e-9)
    return Landmarks(
        places,
        h / size[:, None],
        np.square(EDGE_DEVIATION / size),
        things,
        np.ones(len(places), dtype=bool),
        np.zeros(len(places), dtype=bool),
        lens,
    )


def _marked_edges(ranges: NDArray[np.float64], side: int) -> NDArray[np.bool_]:
    """Mark the last reading of each surface, towards a side, before something farther."""
    width = ranges.shape[1]
    padded = np.pad(ranges, ((0, 0), (LARGEST_GAP, LARGEST_GAP)), constant_values=np.nan)
    inner, *others = (
        padded[:, LARGEST_GAP + k * side :][:, :width] for k in (-2, *range(LARGEST_GAP, 0, -1))
    )
    next_one = np.full(ranges.shape, np.nan)
    for other in others:
        np.copyto(next_one, other, where=other > 0.0)
    jump = EDGE_JUMP * np.maximum(ranges, 2.0)
    # NaN compares false with everything.
    marks = (np.abs(inner - ranges) < 0.5 * jump) & (next_one > ranges + jump)
    marks[:, [0, 1, -2, -1]] = False
    return marks


def _line_slopes(
    marks: NDArray[np.bool_], lines: NDArray[np.intp], columns: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Slopes (n,), columns a line, of straight edges at marked pixels; NaN of others."""
    reach = np.arange(-EDGE_REACH, EDGE_REACH + 1)
    nearest_first = reach[np.argsort(np.abs(reach), kind="stable")]
    windows = sliding_window_view(np.pad(marks, EDGE_REACH), (reach.size, reach.size))
    around = windows[lines, columns][:, :, nearest_first + EDGE_REACH]
    seen = around.any(axis=2)
    n = seen.sum(axis=1)
    x, y = seen * reach, seen * nearest_first[around.argmax(axis=2)]
    spread = (x * x).sum(axis=1) - x.sum(axis=1) ** 2 / n
    common = (x * y).sum(axis=1) - x.sum(axis=1) * y.sum(axis=1) / n
    slopes = common / np.maximum(spread, 1e-9)
    rest = (y * y).sum(axis=1) - y.sum(axis=1) ** 2 / n - slopes * common
    is_line = (n >= 1.5 * EDGE_REACH) & (spread > 0.0) & (np.abs(slopes) <= 1.0) & (rest < n)
    return np.where(is_line, slopes, np.nan)
