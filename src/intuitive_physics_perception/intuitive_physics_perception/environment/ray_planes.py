"""Planes of an environment as rays from the sensor meet them.

A ray is in a plane's hull where it is in the half-space of each of its sides, and meets the plane
where that is in no open cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, entry, kernel
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.planes import DetectedPlane
from intuitive_physics_perception.settings import PerceptionSettings

HIDING_DEPTH = 0.1
"""Distance before a plane from which on a reading hides it, m: what is nearer to the plane
contradicts it."""

BLOCK = 256
"""Rays that are judged together: they fit into the nearest cache."""

ITERATIONS = 8
"""Iterations of the contraction in `free_ranges`: numerical, the rest is far below a millimetre."""

SMALLEST_COSINE = 1e-6
"""Cosine of the angle between a ray and a plane's normal up to which it never meets it: numerical.
"""


@dataclass(frozen=True)
class PlaneAgreement:
    """Agreement of readings with the planes of an environment.

    A reading hides a plane when it lies before it by more than `HIDING_DEPTH`.

    Parameters
    ----------
    readings : how many of them are in range
    explained : part of the readings that hide no plane which lie on one
    visible : part of all readings that hide no plane
    support : part of the readings where the support should be, and nothing hides it, which lie on
        it; 1 where all is hidden
    """

    readings: int
    explained: float
    visible: float
    support: float


class RayPlanes:
    """Judges readings by planes.

    `planes` of an environment, as the sensor sees them.
    """

    def __init__(
        self, planes: Sequence[DetectedPlane], noise: RangeNoise, settings: PerceptionSettings
    ) -> None:
        self._arrays = *_bounds_of(planes, settings), limits_of(noise, settings)

    def readings_before(
        self, points: NDArray[np.float32], *, continued: bool = False
    ) -> tuple[NDArray[np.int64], int]:
        """Return the indices (m,) of readings in range that lie before all planes, as `free_ranges`
        has it, and the number of readings in range.

        `points` (n, 3) m, may hold NaN; `continued`: leave out what lies on a plane beyond its
        hull, too, as a sensor that has moved sees more of a wall.
        """
        indices, readings = _readings_before(points, self._arrays, continued)
        return indices, readings

    def free_ranges(self, directions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the range up to which a reading along each ray lies off and before all planes,
        (n,) m.

        The reading at range ρ of a ray that meets a plane at an angle of cosine c, inside the
        plane's hull, lies before it when its distance exceeds √((s σ(ρ) c)² + t²): s deviations of
        the noise and the unevenness t.

        `directions` (n, 3) of any length, from the sensor.
        """
        return np.asarray(_free_ranges(directions, self._arrays))

    def agreement(self, points: NDArray[np.float32]) -> PlaneAgreement:
        """Return how well readings agree with the planes.

        `points` (n, 3) m, may hold NaN.
        """
        readings, on, visible, met, on_first = _agreement(points, self._arrays)
        return PlaneAgreement(
            readings,
            explained=on / max(visible, 1),
            visible=visible / max(readings, 1),
            support=on_first / met if met else 1.0,
        )


def limits_of(noise: RangeNoise, settings: PerceptionSettings) -> NDArray[np.float32]:
    """Return squares of the smallest and largest range and of the noise's constant, quadratic part
    and limit, (5,): single precision halves the time of a frame and is far below the noise."""
    ranges = np.square([settings.min_range, settings.max_range])
    return np.concatenate([ranges, noise.squares[:3]]).astype(np.float32)


def _bounds_of(
    planes: Sequence[DetectedPlane], settings: PerceptionSettings
) -> tuple[NDArray[Any], ...]:
    """Arrays of planes for kernels: normals, offsets in m, squares of `plane_sigmas` and of the
    tolerance in m² (n, 6); the half-spaces of directions of their hulls (m, 4) as
    `DetectedPlane.hull_cones` has them, and where those of each plane begin (n + 1,); cells of
    openings (k,), coordinates (n, 8) and shapes (n, 3) as in `_openings_of`; reliefs (n, 14) as in
    `_relief_of`."""
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
def _readings_before(points: Any, arrays: Any, continued: bool) -> tuple[Any, int]:
    """As `RayPlanes.readings_before`, with `arrays` of `_bounds_of` and `limits_of`."""
    planes, cones, starts, cells, grids, shapes, reliefs, limits = arrays
    kept = np.empty(points.shape[0], dtype=np.int64)
    count = readings = 0
    rays = np.empty((6, BLOCK), dtype=np.float32)
    numbers = np.empty(BLOCK, dtype=np.int64)
    inside = np.empty(BLOCK, dtype=np.bool_)
    for first in range(0, points.shape[0], BLOCK):
        n = min(BLOCK, points.shape[0] - first)
        readings += _enter_readings(rays, numbers, inside, points, first, n, limits)
        if continued:
            # Most readings lie on a plane: fewer rays are left whose sides have to be tested.
            for k in range(planes.shape[0]):
                _mark_near(inside, rays, n, planes[k], reliefs[k])
        n = _keep_outside(inside, rays, numbers, n)
        _turn_to_rays(rays, n)
        for k in range(planes.shape[0]):
            _rise(rays, n, reliefs[k])
            if _mark_reached(inside, rays, n, planes[k]) > 0:
                sides = cones[starts[k] : starts[k + 1]]
                if _leave_sides(inside, rays, n, sides) > 0:
                    _leave_openings(inside, rays, n, planes[k], cells, grids[k], shapes[k])
                    n = _keep_outside(inside, rays, numbers, n)
        kept[count : count + n] = numbers[:n]
        count += n
    return kept[:count].copy(), readings


@kernel
def _enter_readings(
    rays: Any, numbers: Any, inside: Any, points: Any, first: int, n: int, limits: Any
) -> int:
    """Enter n readings into rays (6, size), a row each for the three coordinates, the square of the
    range and the variance, and their numbers (size,); mark those out of range, and return how many
    are in it."""
    x, y, z, ranges2, variances = rays[0], rays[1], rays[2], rays[3], rays[4]
    for i in range(n):
        x[i], y[i], z[i] = points[first + i, 0], points[first + i, 1], points[first + i, 2]
        numbers[i] = first + i
    readings = 0
    for i in range(n):
        range2 = x[i] * x[i] + y[i] * y[i] + z[i] * z[i]
        # NaN compares false with everything.
        in_range = (limits[0] <= range2) & (range2 <= limits[1])
        ranges2[i] = range2
        variances[i] = min(limits[2] + limits[3] * range2 * range2, limits[4])
        inside[i] = not in_range
        readings += in_range
    return readings


@kernel
def _turn_to_rays(rays: Any, n: int) -> None:
    """Let n readings be rays, with direction and range in place of coordinates and range²."""
    x, y, z, ranges = rays[0], rays[1], rays[2], rays[3]
    for i in range(n):
        ranges[i] = np.sqrt(ranges[i])
        x[i], y[i], z[i] = x[i] / ranges[i], y[i] / ranges[i], z[i] / ranges[i]


@kernel
def _mark_near(inside: Any, rays: Any, n: int, plane: Any, relief: Any) -> None:
    """Mark those of n readings that lie near a plane, wherever it ends. A branch on what is marked
    already would unmark it: in LLVM 20's vector code for AVX-512."""
    x, y, z, variances = rays[0], rays[1], rays[2], rays[4]
    a, b, c, offset, sigmas2, tolerance2 = plane
    if _is_flat(relief):
        for i in range(n):
            distance = x[i] * a + y[i] * b + z[i] * c - offset
            inside[i] |= distance * distance <= sigmas2 * variances[i] + tolerance2
        return
    for i in range(n):
        along = x[i] * a + y[i] * b + z[i] * c
        distance = along - offset - _height(x[i], y[i], z[i], relief)
        inside[i] |= distance * distance <= sigmas2 * variances[i] + tolerance2


@kernel
def _mark_reached(inside: Any, rays: Any, n: int, plane: Any) -> int:
    """Mark those of n readings that lie on a plane or behind it; return their number."""
    x, y, z, ranges, variances, rises = rays[0], rays[1], rays[2], rays[3], rays[4], rays[5]
    a, b, c, offset, sigmas2, tolerance2 = plane
    reached = 0
    for i in range(n):
        cosine = -(x[i] * a + y[i] * b + z[i] * c)
        distance = -offset - ranges[i] * cosine - rises[i]
        margin2 = sigmas2 * variances[i] * cosine * cosine + tolerance2
        ahead = (distance > 0.0) & (distance * distance > margin2)
        inside[i] = (cosine > SMALLEST_COSINE) & ~ahead
        reached += inside[i]
    return reached


@kernel
def _leave_sides(inside: Any, rays: Any, n: int, cones: Any) -> int:
    """Unmark those of n rays that are out of a hull's half-spaces (m, 4); return how many are
    left."""
    x, y, z = rays[0], rays[1], rays[2]
    left = n
    for j in range(cones.shape[0]):
        if left == 0:
            break
        a, b, c, bound = cones[j]
        left = 0
        for i in range(n):
            inside[i] &= x[i] * a + y[i] * b + z[i] * c <= bound
            left += inside[i]
    return left


@kernel
def _leave_openings(
    inside: Any, rays: Any, n: int, plane: Any, cells: Any, grid: Any, shape: Any
) -> None:
    """Unmark those of n rays that meet a plane in an open cell."""
    if shape[1] == 0:
        return
    for i in range(n):
        if inside[i]:
            inside[i] = not _is_open(rays[0, i], rays[1, i], rays[2, i], plane, cells, grid, shape)


@kernel
def _keep_outside(inside: Any, rays: Any, numbers: Any, n: int) -> int:
    """Move those of n rays that are not inside to the front, in order; return their number."""
    left = 0
    for i in range(n):
        if not inside[i]:
            for row in range(rays.shape[0]):
                rays[row, left] = rays[row, i]
            numbers[left] = numbers[i]
            left += 1
    return left


@kernel
def _rise(rays: Any, n: int, relief: Any) -> None:
    """Set the heights, as of `PlaneRelief`, of a surface where n readings stand over it."""
    x, y, z, ranges, rises = rays[0], rays[1], rays[2], rays[3], rays[5]
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
    """Height in m of a surface over its plane where a reading stands over it; 0 if it is flat."""
    a = min(max(x * relief[0] + y * relief[1] + z * relief[2] - relief[6], -1.0), 1.0)
    b = min(max(x * relief[3] + y * relief[4] + z * relief[5] - relief[7], -1.0), 1.0)
    flat = relief[8] + relief[9] * a + relief[10] * b
    return flat + relief[11] * a * a + relief[12] * a * b + relief[13] * b * b


@kernel
def _is_open(x: Any, y: Any, z: Any, plane: Any, cells: Any, grid: Any, shape: Any) -> Any:
    """Whether a ray along (x, y, z) meets a plane in an open cell, as of `_openings_of`."""
    first, rows, columns = shape
    if rows == 0:
        return False
    far = plane[3] / (x * plane[0] + y * plane[1] + z * plane[2])
    row = int(np.floor(far * (x * grid[0] + y * grid[1] + z * grid[2]) - grid[6]))
    column = int(np.floor(far * (x * grid[3] + y * grid[4] + z * grid[5]) - grid[7]))
    return 0 <= row < rows and 0 <= column < columns and cells[first + row * columns + column]


@kernel
def _meets(
    x: Any, y: Any, z: Any, plane: Any, cones: Any, cells: Any, grid: Any, shape: Any
) -> Any:
    """Whether a ray along a unit vector is in the cones of a hull and meets no open cell."""
    for j in range(cones.shape[0]):
        if x * cones[j, 0] + y * cones[j, 1] + z * cones[j, 2] > cones[j, 3]:
            return False
    return not _is_open(x, y, z, plane, cells, grid, shape)


@allocating_entry
def _free_ranges(directions: Any, arrays: Any) -> Any:
    """As `RayPlanes.free_ranges`, with `arrays` of `_bounds_of` and `limits_of`."""
    planes, cones, starts, cells, grids, shapes, reliefs, limits = arrays
    free = np.full(directions.shape[0], np.sqrt(limits[1]), dtype=np.float32)
    for i in range(directions.shape[0]):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        for k in range(planes.shape[0]):
            plane = planes[k]
            cosine = -(x * plane[0] + y * plane[1] + z * plane[2])
            if cosine <= SMALLEST_COSINE:
                continue
            sides = cones[starts[k] : starts[k + 1]]
            if not _meets(x, y, z, plane, sides, cells, grids[k], shapes[k]):
                continue
            begins = -plane[3] / cosine
            is_flat = _is_flat(reliefs[k])
            # A contraction: what the noise lets pass grows far slower with range than the distance.
            for _ in range(ITERATIONS):
                variance = min(limits[2] + limits[3] * begins**4, limits[4])
                margin = np.sqrt(plane[4] * variance * cosine * cosine + plane[5])
                if not is_flat:
                    margin += _height(begins * x, begins * y, begins * z, reliefs[k])
                begins = max((-plane[3] - margin) / cosine, 0.0)
            free[i] = min(free[i], begins)
    return free


@entry
def _agreement(points: Any, arrays: Any) -> tuple[int, int, int, int, int]:
    """Return the numbers of readings in range, of those on a plane, of those that do not only hide
    planes, and of those whose rays meet the first plane where nothing hides it and that are on it.
    """
    planes, cones, starts, cells, grids, shapes, reliefs, limits = arrays
    readings = on = visible = met = on_first = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        range2 = x * x + y * y + z * z
        # NaN compares false with everything.
        if not limits[0] <= range2 <= limits[1]:
            continue
        readings += 1
        length = np.sqrt(range2)
        variance = min(limits[2] + limits[3] * range2 * range2, limits[4])
        is_on = hides = False
        for k in range(planes.shape[0]):
            plane = planes[k]
            along = x * plane[0] + y * plane[1] + z * plane[2]
            over = along - plane[3] - _height(x, y, z, reliefs[k])
            is_near = over * over < plane[4] * variance * along * along / range2 + plane[5]
            is_on |= is_near
            sides = cones[starts[k] : starts[k + 1]]
            if along < 0.0 and _meets(
                x / length, y / length, z / length, plane, sides, cells, grids[k], shapes[k]
            ):
                if along - plane[3] > HIDING_DEPTH:
                    hides = True
                elif k == 0:
                    met += 1
                    on_first += is_near
        on += is_on
        visible += is_on or not hides
    return readings, on, visible, met, on_first
