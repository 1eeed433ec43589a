"""Readings of a ball that moves while the sensor exposes, and the fit of its sweep.

During the exposure T the centre goes straight from c - s/2 to c + s/2; the sweep is s = v T. A ray
along the unit vector u meets the ball at the times t (in exposures, 0 in the middle) at which it
passes the centre c + t s by m(t) ≤ r. A pixel reads the mean range over these times: with t̄ in
their middle and h(t) = sqrt(r² - m(t)²), u·(c + t̄ s) less the mean of h. So a reading p is moved to

    p' = p - t̄ s - (h(t̄) - mean of h) u,

where it would be of a ball that rests in c, and p' lies on the sphere of radius r about c. This
does not depend on the least share of the exposure that makes a reading.

A reading of a scanner is of one time t, which some state, in durations of a scan; it is moved to
p' = p - t s, where s is the way during the scan. Lengths in m, the sensor at
the origin; `noise` as in `sphere_fit`.
"""

from __future__ import annotations

from math import asin, isnan, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, inlined
from intuitive_physics_perception.detection.cluster_view import ClusterView
from intuitive_physics_perception.detection.sphere_fit import (
    BEHIND_SIGMAS,
    GATES,
    INLIER_SIGMAS,
    normal_where_met,
    surface_error,
)

SWEEP_STEPS = 12
"""Gauss-Newton steps of the sweep: numerical, it is still after five mostly."""

LEAST_SWEEP = 1e-4
"""Length of a sweep in m below which a ball rests: numerical."""

SHORTEST_NEW_SWEEP = 0.15
"""Length, in radii, by which an outline must be longer than wide for a ball to be swept. Set by
hand: the noise of an outline of ten pixels makes a tenth."""

OUTLINE_ENDS = 0.01
"""Part of the readings beyond either end of an outline: its flickering edge. Set by hand."""

OUTLINE_DEVIATION = 0.1
"""Standard deviation of the radius with which the fit of a sweep begins, in radii: what an outline
or earlier frames say, without which the surface of a ball of 60 readings, with a noise of a sixth
of its radius, grows to any size. Set by hand."""

SWEPT_DOUBT = 2.0
"""Factor by which errors of a swept sphere have larger variances than the fit says, which takes the
times of its readings as known. Set by hand: rendered balls of 30 to 60 mm at 3 to 8 m/s with 5 to
15 ms have mean squared errors of 1.5 to 2.5 of these variances."""

NEAR_SURFACE = 1.5
"""Radii along the ray about the centre within which a reading may be of the ball. Set by hand."""


class Sweep(NamedTuple):
    """Sphere and sweep that fit some readings together.

    Parameters
    ----------
    sphere : (4,) m, centre in the middle of the exposure, and radius
    sweep : (3,) m, way of the centre during the exposure
    spread : (4, 4) m², by which the unknown sweep adds to the covariance of the sphere
    """

    sphere: Any
    sweep: Any
    spread: Any


class SweptView(ClusterView):
    """A cluster as it would be seen if a ball had rested where it was in mid-exposure.

    `view` of what was read; `sphere` (4,) m and `sweep` (3,) m of the ball.
    """

    def __init__(
        self, view: ClusterView, sphere: NDArray[np.float64], sweep: NDArray[np.float64]
    ) -> None:
        super().__init__(view.points, view.cluster, view.marks, view.scan, view.middle)
        self._ball = sphere, sweep

    def _near(self, sphere: NDArray[np.float64]) -> tuple[tuple[Any, Any], int]:
        """What is about a sphere so large that it covers what moves onto it."""
        reach = sphere[3] + 0.5 * np.linalg.norm(self._ball[1])
        return super()._near(np.append(sphere[:3], reach))

    def _read(self, near: tuple[Any, Any]) -> NDArray[np.float32]:
        """Readings (n, 3) m, moved."""
        points = super()._read(near)
        times = np.full(len(points), np.nan) if self.scan is None else self.times_of(near[1])
        return np.asarray(unswept(points, times, *self._ball), dtype=np.float32)


def swept_outline(
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the sphere (4,) m and the sweep (3,) m, across the line of sight, that the outline of
    a cluster suggests; None where it is about as long as wide.

    `points` (n, 3) m, of the cluster.
    """
    ranges = np.linalg.norm(points, axis=1)
    middle = points.mean(axis=0)
    view = middle / np.linalg.norm(middle)
    depth = float(ranges.mean())
    across = depth * (points / (points @ view)[:, None] - view)
    axes = np.linalg.svd(across - across.mean(axis=0), full_matrices=False)[2][:2]
    ends = np.quantile(across @ axes.T, [OUTLINE_ENDS, 1.0 - OUTLINE_ENDS], axis=0)
    long, wide = ends[1] - ends[0]
    radius = 0.5 * float(wide)
    if long - wide < SHORTEST_NEW_SWEEP * radius:
        return None
    center = depth * view + 0.5 * (ends[0] + ends[1]) @ axes
    center *= (float(np.quantile(ranges, 0.1)) + radius) / np.linalg.norm(center)
    return np.append(center, radius), float(long - wide) * axes[0]


@allocating_entry
def passing_way(points: Any, place: Any, way: Any) -> Any:
    """Return how far from the nearest place on a way the rays to points (n, 3) m pass, (n,) m.

    `place` (3,) m, the middle of the way; `way` (3,) m, from its beginning to its end.
    """
    passed = np.empty(points.shape[0])
    px, py, pz = place[0], place[1], place[2]
    wx, wy, wz = way[0], way[1], way[2]
    # In a row, which the compiler turns into vector code.
    numbers = points.reshape(-1)
    for i in range(points.shape[0]):
        x, y, z = numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]
        distance = sqrt(x * x + y * y + z * z)
        x, y, z = x / distance, y / distance, z / distance
        along = x * px + y * py + z * pz
        off_x, off_y, off_z = px - along * x, py - along * y, pz - along * z
        along = x * wx + y * wy + z * wz
        side_x, side_y, side_z = wx - along * x, wy - along * y, wz - along * z
        length2 = max(side_x * side_x + side_y * side_y + side_z * side_z, LEAST_SWEEP**2)
        when = -(off_x * side_x + off_y * side_y + off_z * side_z) / length2
        when = min(max(when, -0.5), 0.5)
        off_x, off_y, off_z = off_x + when * side_x, off_y + when * side_y, off_z + when * side_z
        passed[i] = sqrt(off_x * off_x + off_y * off_y + off_z * off_z)
    return passed


@inlined
def _time_and_excess(
    known: float, ux: float, uy: float, uz: float, sphere: Any, sweep: Any
) -> tuple[float, float]:
    """Middle t̄ of the times in which a ray along a unit vector meets the ball, and how much nearer
    h(t̄) is than the mean of h, m; the nearest time and nothing for a ray that never meets it; the
    `known` time and nothing where that is not NaN."""
    if not isnan(known):
        return known, 0.0
    along = ux * sphere[0] + uy * sphere[1] + uz * sphere[2]
    drift = ux * sweep[0] + uy * sweep[1] + uz * sweep[2]
    mx, my, mz = sphere[0] - along * ux, sphere[1] - along * uy, sphere[2] - along * uz
    sx, sy, sz = sweep[0] - drift * ux, sweep[1] - drift * uy, sweep[2] - drift * uz
    a = mx * mx + my * my + mz * mz
    b = mx * sx + my * sy + mz * sz
    c = sx * sx + sy * sy + sz * sz
    if c < LEAST_SWEEP * LEAST_SWEEP:
        return 0.0, 0.0
    nearest = -b / c
    # m² = c ((t - nearest)² - half²) + r².
    half2 = (b * b - c * (a - sphere[3] * sphere[3])) / (c * c)
    if half2 <= 0.0:
        return min(max(nearest, -0.5), 0.5), 0.0
    half = sqrt(half2)
    first, last = max(nearest - half, -0.5), min(nearest + half, 0.5)
    if first >= last:
        return min(max(nearest, -0.5), 0.5), 0.0
    middle = 0.5 * (first + last)
    # ∫ sqrt(w² - x²) dx = (x sqrt(w² - x²) + w² asin(x / w)) / 2
    mean = 0.0
    for side in (-1.0, 1.0):
        x = (last if side > 0.0 else first) - nearest
        x = min(max(x, -half), half)
        mean += 0.5 * side * (x * sqrt(max(half2 - x * x, 0.0)) + half2 * asin(x / half))
    mean *= sqrt(c) / (last - first)
    at = sqrt(c * max(half2 - (middle - nearest) ** 2, 0.0))
    return middle, at - mean


@allocating_entry
def unswept(points: Any, times: Any, sphere: Any, sweep: Any) -> Any:
    """Return readings (n, 3) where they would be of a ball that rests in the middle of its sweep.

    What is not near the ball along its ray stays where it is; a reading of one time goes as far for
    the eye as it would near the ball: its ray passes the ball as it did then.

    `points` (n, 3) m, may hold NaN; `times` (n,) of the readings, NaN where these are of the whole
    exposure; `sphere` (4,) m; `sweep` (3,) m.
    """
    moved = points.copy()
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        distance = sqrt(x * x + y * y + z * z)
        if not distance > 0.0:
            continue
        ux, uy, uz = x / distance, y / distance, z / distance
        time, excess = _time_and_excess(times[i], ux, uy, uz, sphere, sweep)
        cx, cy, cz = (
            sphere[0] + time * sweep[0],
            sphere[1] + time * sweep[1],
            sphere[2] + time * sweep[2],
        )
        ahead = ux * cx + uy * cy + uz * cz - distance
        part = 1.0
        if abs(ahead) > NEAR_SURFACE * sphere[3]:
            if isnan(times[i]) or distance + ahead <= 0.0:
                continue
            part = distance / (distance + ahead)
        moved[i, 0] = x - part * time * sweep[0] - excess * ux
        moved[i, 1] = y - part * time * sweep[1] - excess * uy
        moved[i, 2] = z - part * time * sweep[2] - excess * uz
    return moved


@allocating_entry
def fit_sweep(
    points: Any, times: Any, sphere: Any, sweep: Any, deviation: float, noise: Any, sharing: float
) -> Sweep:
    """Fit centre, radius and sweep together, by Gauss-Newton over the inliers.

    A reading taken at t̄ has the row (n, 1, t̄ n), n the normal of the sphere there: its ends show
    the length of the sweep across the line of sight, their ranges the part along it. The sweep has
    the prior mean `sweep` and the standard deviation `deviation` in each component; the radius that
    of `OUTLINE_DEVIATION`, as no outline takes part here. With the normal
    equations in blocks, A of the sphere and B between both, its covariance S makes the sphere
    differ by A⁻¹ B S Bᵀ A⁻¹. Where fewer readings fit than there are numbers, the sweep is NaN.

    `points` (n, 3) m; `times` (n,) as in `unswept`; `sphere` (4,) m and `sweep` (3,) m to begin
    from; `deviation` in m; `sharing`: as in `refine_sphere`.
    """
    fitted, prior = np.concatenate((sphere, sweep)), OUTLINE_DEVIATION * sphere[3]
    normal, right, row = np.zeros((7, 7)), np.zeros(7), np.zeros(7)
    row[3] = 1.0
    for step in range(SWEEP_STEPS):
        gate = INLIER_SIGMAS * GATES[min(step, len(GATES) - 1)]
        normal[:] = 0.0
        right[:] = 0.0
        for a in range(3):
            normal[4 + a, 4 + a] = 1.0 / deviation**2
            right[4 + a] = (sweep[a] - fitted[4 + a]) / deviation**2
        normal[3, 3] = 1.0 / prior**2
        right[3] = (sphere[3] - fitted[3]) / prior**2
        now, way, inliers = fitted[:4], fitted[4:], 0
        for i in range(points.shape[0]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            distance = sqrt(x * x + y * y + z * z)
            ux, uy, uz = x / distance, y / distance, z / distance
            time, excess = _time_and_excess(times[i], ux, uy, uz, now, way)
            x -= time * way[0] + excess * ux
            y -= time * way[1] + excess * uy
            z -= time * way[2] + excess * uz
            error, variance, spread, ahead, sine = surface_error(
                x, y, z, now[0], now[1], now[2], now[3], noise
            )
            if error * error > gate * gate * variance or ahead < -BEHIND_SIGMAS * spread:
                continue
            inliers += 1
            row[0], row[1], row[2] = normal_where_met(
                x, y, z, ahead, sine, now[0], now[1], now[2], now[3]
            )
            for a in range(3):
                row[4 + a] = time * row[a]
            within = sqrt(max(1.0 - sine * sine, 0.0))
            shared = sharing * spread * spread * within * within
            weight = 1.0 / (variance + shared)
            for a in range(7):
                right[a] += weight * row[a] * error
                for b in range(7):
                    normal[a, b] += weight * row[a] * row[b]
        if inliers < row.size:
            return Sweep(now, np.full(3, np.nan), np.full((4, 4), np.nan))
        change = np.linalg.solve(normal, right)
        for a in range(7):
            fitted[a] += min(max(change[a], -0.5 * fitted[3]), 0.5 * fitted[3])
        fitted[3] = max(fitted[3], 0.25 * sphere[3])
    own = np.ascontiguousarray(normal[:4, :4])
    gain = np.linalg.solve(own, np.ascontiguousarray(normal[:4, 4:]))
    covariance = np.ascontiguousarray(np.linalg.inv(normal)[4:, 4:])
    return Sweep(fitted[:4].copy(), fitted[4:].copy(), gain @ covariance @ gain.T)
