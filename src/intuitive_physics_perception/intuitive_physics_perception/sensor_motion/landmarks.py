"""Places of a modelled view by which a sensor finds where it is: patches of surface, and the ends
of what stands before something farther."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import entry, kernel
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

OF_EACH = ("places", "normals", "variances", "spreads", "things", "is_edge")
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
    spreads : (n, 3, 3) covariances of the normals, zero for those of planes and edges
    things : (n,) number of the thing it belongs to; 0: of the support or of what is as large as a
        wall, which do not move
    is_edge : (n,) whether it is on an edge
    lens : (10, 2) as of `fitted_lens`
    """

    places: NDArray[np.float64]
    normals: NDArray[np.float64]
    variances: NDArray[np.float64]
    spreads: NDArray[np.float64]
    things: NDArray[np.int64]
    is_edge: NDArray[np.bool_]
    lens: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def is_on_plane(self) -> NDArray[np.bool_]:
        """(n,) whether it is a patch of a plane, whose normal is known."""
        return ~self.is_edge & (self.spreads[:, 0, 0] == 0.0)

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
    places, normals, variances, spreads, rows, columns = _fitted_patches(
        points, frames, model.noise
    )
    on_plane = np.full(len(places), -1)
    for k, plane in enumerate(model.detected):
        near = _is_on(plane, places, normals, spreads, model.noise, settings)
        on_plane[near & (on_plane < 0)] = k
        normals[on_plane == k] = plane.normal
        spreads[on_plane == k] = 0.0
    kept = [
        _evenly(np.flatnonzero(on_plane == k), PLANE_PATCHES) for k in range(len(model.detected))
    ]
    kept.append(_evenly(np.flatnonzero(on_plane < 0), OTHER_PATCHES))
    patches = Landmarks(
        places,
        normals,
        variances,
        spreads,
        things[rows, columns],
        np.zeros(len(places), dtype=bool),
        lens,
    )
    return patches.chosen(np.concatenate(kept))


def _fitted_patches(
    points: NDArray[np.float32], frames: int, noise: RangeNoise
) -> tuple[NDArray[Any], ...]:
    """Places (n, 3) m, normals (n, 3), variances (n,) m² along them, covariances (n, 3, 3) of the
    normals, rows (n,) and columns (n,) of all flat patches."""
    reach = PATCH_REACH
    height, width = points.shape[:2]
    rows, columns = np.mgrid[
        reach : height - reach : PATCH_STEP, reach : width - reach : PATCH_STEP
    ]
    rows, columns = rows.ravel(), columns.ravel()
    places, normals = np.full((len(rows), 3), np.nan), np.empty((len(rows), 3))
    variances, spreads = np.empty(len(rows)), np.empty((len(rows), 3, 3))
    # The median of n readings has π / 2 times the variance of their mean.
    share = 1.0 if frames == 1 else 0.5 * np.pi / frames
    numbers = np.append(share * noise.squares, noise.correlated)
    axes = np.empty((3, 3))
    _fit_patches(points, rows, columns, numbers, places, normals, variances, spreads, axes)
    flat = np.isfinite(places[:, 0])
    return tuple(a[flat] for a in (places, normals, variances, spreads, rows, columns))


@entry
def _fit_patches(
    points: Any,
    rows: Any,
    columns: Any,
    noise: Any,
    places: Any,
    normals: Any,
    variances: Any,
    spreads: Any,
    axes: Any,
) -> None:
    """Fit the patch about each pixel; NaN stays where it is not flat.

    A plane x · p = 1 has the inverse range x · u along the unit vector u, so x is a regression in
    which only the inverse range errs. In the axes (w, e, f), w along the ray of the middle, it is
    one in the slopes of the other rays.

    `noise` (5,): squares of constant, quadratic part, limit and lateral deviation, and how many
    neighbours share an error; `axes` (3, 3): memory.
    """
    for i in range(rows.shape[0]):
        if not _look_along(points, rows[i], columns[i], axes):
            continue
        n, middle, spread, inverse, common, rest = _moments(points, rows[i], columns[i], axes)
        (a, b), (c11, c12, c22), (d1, d2) = middle, spread, common
        determinant = c11 * c22 - c12 * c12
        if n < PATCH_READINGS or not determinant > 1e-3 * c11 * c22:
            continue
        g1 = (c22 * d1 - c12 * d2) / determinant
        g2 = (c11 * d2 - c12 * d1) / determinant
        g0 = inverse - g1 * a - g2 * b
        if not g0 > 0.0:
            continue
        reach2 = 1.0 / (g0 * g0)
        slope2 = (g1 * g1 + g2 * g2) * reach2
        variance = min(noise[0] + noise[1] * reach2 * reach2, noise[2])
        variance += noise[3] * reach2 * slope2
        # Of an inverse range.
        error2 = variance / (reach2 * reach2)
        if rest - g1 * d1 - g2 * d2 > FLATNESS * error2:
            continue
        error2 *= min(noise[4], n) / n
        length = np.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
        for k in range(3):
            places[i, k] = axes[0, k] / g0
            normals[i, k] = -(g0 * axes[0, k] + g1 * axes[1, k] + g2 * axes[2, k]) / length
        away2 = (a * a * c22 - 2.0 * a * b * c12 + b * b * c11) / determinant
        variances[i] = error2 * (1.0 + away2) * reach2 * reach2 / (1.0 + slope2)
        part = error2 / (determinant * length * length)
        _turn_spread(spreads[i], normals[i], axes, c22 * part, -c12 * part, c11 * part)


@kernel
def _look_along(points: Any, row: int, column: int, axes: Any) -> bool:
    """Set axes (3, 3) along the ray of a pixel and across it; False if nothing was read there."""
    x, y, z = (
        float(points[row, column, 0]),
        float(points[row, column, 1]),
        float(points[row, column, 2]),
    )
    length = np.sqrt(x * x + y * y + z * z)
    # NaN compares false with everything.
    if not length > 0.0:
        return False
    x, y, z = x / length, y / length, z / length
    # Across the y axis, which a camera hardly looks along.
    across = np.sqrt(x * x + z * z) + 1e-12
    ex, ez = z / across, -x / across
    axes[0, 0], axes[0, 1], axes[0, 2] = x, y, z
    axes[1, 0], axes[1, 1], axes[1, 2] = ex, 0.0, ez
    axes[2, 0], axes[2, 1], axes[2, 2] = y * ez, z * ex - x * ez, -y * ex
    return True


@kernel
def _moments(points: Any, row: int, column: int, axes: Any) -> Any:
    """Number of readings of a patch, means of their slopes and the covariance of these, the mean
    of the inverse ranges along the middle, their covariances with the slopes and their variance."""
    n = s1 = s2 = s11 = s12 = s22 = k0 = k1 = k2 = kk = 0.0
    for v in range(row - PATCH_REACH, row + PATCH_REACH + 1):
        for u in range(column - PATCH_REACH, column + PATCH_REACH + 1):
            x, y, z = float(points[v, u, 0]), float(points[v, u, 1]), float(points[v, u, 2])
            along = x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]
            if not along > 0.0:
                continue
            k = 1.0 / along
            a = (x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]) * k
            b = (x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]) * k
            n, s1, s2 = n + 1.0, s1 + a, s2 + b
            s11, s12, s22 = s11 + a * a, s12 + a * b, s22 + b * b
            k0, k1, k2, kk = k0 + k, k1 + a * k, k2 + b * k, kk + k * k
    a, b, k = s1 / n, s2 / n, k0 / n
    spread = s11 / n - a * a, s12 / n - a * b, s22 / n - b * b
    return n, (a, b), spread, k, (k1 / n - a * k, k2 / n - b * k), kk / n - k * k


@kernel
def _turn_spread(spread: Any, normal: Any, axes: Any, q11: float, q12: float, q22: float) -> None:
    """Set the covariance (3, 3) of a normal by that of its two slopes: errors of these turn it by
    what of the axes is across it."""
    along1 = along2 = 0.0
    for k in range(3):
        along1, along2 = along1 + axes[1, k] * normal[k], along2 + axes[2, k] * normal[k]
    for r in range(3):
        e, f = axes[1, r] - along1 * normal[r], axes[2, r] - along2 * normal[r]
        for c in range(3):
            g, h = axes[1, c] - along1 * normal[c], axes[2, c] - along2 * normal[c]
            spread[r, c] = q11 * e * g + q12 * (e * h + f * g) + q22 * f * h


def _is_on(
    plane: DetectedPlane,
    places: NDArray[np.float64],
    normals: NDArray[np.float64],
    spreads: NDArray[np.float64],
    noise: RangeNoise,
    settings: PerceptionSettings,
) -> NDArray[np.bool_]:
    """Mark the patches (n,) that are part of a plane, by place and normal."""
    ranges = np.linalg.norm(places, axis=1)
    along = places @ plane.normal
    distances = along - plane.offset - plane.heights(places)
    margins = np.hypot(
        settings.plane_sigmas * noise.deviation(ranges) * along / ranges, settings.plane_tolerance
    )
    turned = np.linalg.norm(normals - plane.normal, axis=1)
    own = 3.0 * np.sqrt(np.trace(spreads, axis1=1, axis2=2))
    return np.asarray((np.abs(distances) < margins) & (turned < ON_PLANE_ANGLE + own))


def _evenly(which: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Indices (m,), at most `most`, spaced evenly over those given, (n,)."""
    return which[np.linspace(0, len(which) - 1, min(most, len(which))).astype(np.int64)]


def _edges(
    points: NDArray[np.float32], things: NDArray[np.int64], lens: NDArray[np.float64]
) -> Landmarks:
    """Places on straight edges of what stands before something farther."""
    ranges = np.linalg.norm(points, axis=2)
    found: list[NDArray[np.float64]] = []
    labels: list[NDArray[np.int64]] = []
    for transposed in (False, True):
        image = np.ascontiguousarray(ranges.T if transposed else ranges)
        numbers = things.T if transposed else things
        for side in (1, -1):
            marks = np.zeros(image.shape, dtype=np.bool_)
            _mark_edges(image, side, marks)
            lines, columns = (np.ascontiguousarray(axis) for axis in np.nonzero(marks))
            slopes = np.full(len(lines), np.nan)
            _fit_lines(marks, lines, columns, slopes)
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
        np.zeros((len(places), 3, 3)),
        things,
        np.ones(len(places), dtype=bool),
        lens,
    )


@entry
def _mark_edges(ranges: Any, side: int, marks: Any) -> None:
    """Mark the last reading of each surface, towards a side, before something farther."""
    height, width = ranges.shape
    for v in range(height):
        for u in range(2, width - 2):
            near, inner = ranges[v, u], ranges[v, u - 2 * side]
            jump = EDGE_JUMP * max(near, 2.0)
            # NaN compares false with everything.
            if not abs(inner - near) < 0.5 * jump:
                continue
            for k in range(1, LARGEST_GAP + 1):
                other = u + k * side
                if other < 0 or other >= width:
                    break
                if ranges[v, other] > 0.0:
                    marks[v, u] = ranges[v, other] > near + jump
                    break


@entry
def _fit_lines(marks: Any, lines: Any, columns: Any, slopes: Any) -> None:
    """Set the slope, columns a line, of straight edges; others stay NaN."""
    height, width = marks.shape
    for i in range(lines.shape[0]):
        v, u = lines[i], columns[i]
        n = sx = sy = sxx = sxy = syy = 0.0
        for dv in range(max(-EDGE_REACH, -v), min(EDGE_REACH, height - 1 - v) + 1):
            best = EDGE_REACH + 1
            for du in range(max(-EDGE_REACH, -u), min(EDGE_REACH, width - 1 - u) + 1):
                if marks[v + dv, u + du] and abs(du) < abs(best):
                    best = du
            if best <= EDGE_REACH:
                n, sx, sy = n + 1.0, sx + dv, sy + best
                sxx, sxy, syy = sxx + dv * dv, sxy + dv * best, syy + best * best
        if n < 1.5 * EDGE_REACH:
            continue
        spread = sxx - sx * sx / n
        common = sxy - sx * sy / n
        if not spread > 0.0:
            continue
        slope = common / spread
        rest = syy - sy * sy / n - slope * common
        if abs(slope) <= 1.0 and rest < n:
            slopes[i] = slope
