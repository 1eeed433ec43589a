"""Kernels that fit one sphere to readings.

Only the side near the sensor is seen. Noise acts along the ray. A reading whose ray meets the
sphere at the angle θ to its normal is therefore off the surface by cos θ of its range error, and by
sin θ of its lateral error. Where the ray grazes the sphere (θ near 90°) a range error δ moves the
point off the surface by δ² / 2 r to second order, always outwards: that bias is taken off.

`noise` is (a², b², limit², lateral²) of `RangeNoise`; lengths in m, the sensor at the origin.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from intuitive_physics.kernels import allocating_entry, allocating_kernel, inlined, kernel

INLIER_SIGMAS = 3.0
"""Standard deviations from the surface within which a reading is on it."""

BEHIND_SIGMAS = 3.0
"""Standard deviations behind a sphere's centre from which on a reading is not on its near side."""

GATES = (6.0, 4.0, 3.0, 2.0, 1.5, 1.2, 1.0)
"""Multiples of the gate in the first steps of a fit: a rough start must keep its inliers."""

MAX_STEPS = 20
"""Gauss-Newton steps at most: numerical."""

STILL = 1e-7
"""Change of centre or radius in m below which the fit has converged: numerical."""

UNKNOWNS = 5
"""Unknowns of a fit: centre, radius and the angle by which edges have grown."""

RIM_SIGMAS = 2.0
"""Standard deviations of the growth of edges within which of the outline a reading may be of what
has grown."""

SMALLEST_GROWTH = 1e-7
"""Standard deviation, rad, of the growth of edges at least: numerical."""

SURFACE_VARIANCE = 1e-8
"""Variance of the surface in m²: keeps residuals finite where the noise vanishes, numerical."""

CLEARLY = 1e-5
"""Part by which a ray passes a sphere in any case: numerical, single precision is finer."""

BLOCK = 256
"""Readings that are compared with a sphere together: a distance between their rows that is known
before lets the compiler write vector code, and they fit into the nearest cache."""

X, Y, Z, MISS, NORMAL_X, NORMAL_Y, NORMAL_Z, ERROR, WEIGHT, SQUARE = range(0, 10 * BLOCK, BLOCK)
"""Where the rows of a block of readings begin: their places, m; the distances, m, of their rays
from the sphere's centre; and their equations: normal, error in m, weight in 1/m², and square of the
error in variances."""

RAY_ROWS, SURFACE_ROWS = 4, 10
"""Rows of a block for rays alone, and for readings of a surface."""


class SphereSolution(NamedTuple):
    """A sphere fitted to readings.

    Parameters
    ----------
    sphere : (4,) centre and radius, m
    covariance : (4, 4) m², the part of the noise
    shift : (4,) m, by which a growth of the edges by one standard deviation moves the fit
    misfit : mean squared residual in variances, about one for a sphere
    inliers : number of points that took part; zero where the fit failed
    """

    sphere: Any
    covariance: Any
    shift: Any
    misfit: float
    inliers: int


@inlined
def surface_error(
    x: float, y: float, z: float, cx: float, cy: float, cz: float, r: float, noise: Any
) -> tuple[float, float, float, float, float]:
    """Place of a reading relative to a sphere.

    Returns `error` m, distance outside the surface, its bias taken off; `variance` of that error,
    m²; `deviation` of the reading along its ray, m; `ahead` m the reading lies nearer to the sensor
    than the sphere's centre, along the ray; `sine` of the angle at which the ray meets the sphere,
    above one where it misses.
    """
    range2 = x * x + y * y + z * z
    distance = sqrt(range2)
    along = (x * cx + y * cy + z * cz) / distance
    ahead = along - distance
    miss2 = max(cx * cx + cy * cy + cz * cz - along * along, 0.0)
    sine2 = miss2 / (r * r)
    inside2 = min(sine2, 1.0)
    variance = min(noise[0] + noise[1] * range2 * range2, noise[2])
    off = sqrt(miss2 + ahead * ahead)
    second = variance * inside2 / (2.0 * r)
    spread = (
        variance * (1.0 - inside2)
        + noise[3] * range2 * inside2
        + 2.0 * second * second
        + SURFACE_VARIANCE
    )
    return off - r - second, spread, sqrt(variance), ahead, sqrt(sine2)


@inlined
def passes_by(x: float, y: float, z: float, cx: float, cy: float, cz: float, reach: float) -> bool:
    """Return whether a ray leads away from a sphere's centre or passes it clearly farther off than
    `reach`, m: a product where `surface_error` takes roots and divides."""
    toward = x * cx + y * cy + z * cz
    length2 = (x * x + y * y + z * z) * (cx * cx + cy * cy + cz * cz - reach * reach)
    # NaN compares false with everything.
    return not (toward > 0.0 and toward * toward >= (1.0 - CLEARLY) * length2)


@inlined
def normal_where_met(
    x: float,
    y: float,
    z: float,
    ahead: float,
    sine: float,
    cx: float,
    cy: float,
    cz: float,
    r: float,
) -> tuple[float, float, float]:
    """Return the normal of a sphere where a ray meets it, and not at the reading: a weight or a
    direction that depends on the noise would pull the sphere to the sensor's side.

    `ahead` and `sine` as of `surface_error`.
    """
    distance = sqrt(x * x + y * y + z * z)
    meets = (distance + ahead - r * sqrt(max(1.0 - sine * sine, 0.0))) / distance
    scale = 1.0 / (r * max(sine, 1.0))
    return (x * meets - cx) * scale, (y * meets - cy) * scale, (z * meets - cz) * scale


@allocating_entry
def refine_sphere(
    points: Any,
    beyond: Any,
    start: Any,
    min_radius: float,
    max_radius: float,
    noise: Any,
    sharing: float,
    growth: float,
) -> SphereSolution:
    """Fit (x, y, z, r) by Gauss-Newton over the inliers, whose gate narrows step by step.

    Edges grow or shrink in the image: a ray that passes the sphere of radius r at the distance l
    within g l of its outline may have a reading of it (g > 0), one that meets it there none (g <
    0). The angle g is a fifth unknown of mean zero and standard deviation `growth`. It is the same
    in all frames, so what it does to the fit is kept apart: the normal equations A with the prior's
    1 / growth² in the last place, e = (0, 0, 0, 0, 1), have the error A⁻¹ (Σ w J ε - e g /
    growth²), of which the first part is the noise's and the second one the growth's.

    Neighbouring readings share their error along the ray: n others of variance σₐ² that share it
    and have about the same row J add as much to the normal equations as one reading whose error has
    the variance σ² + n σₐ².

    `points` (n, 3), those on the sphere among them; `beyond` (m, 3), readings of `readings_beyond`,
    whose rays must miss the sphere; `sharing`: n, other readings among the points that share one's
    error along the ray; `growth` in rad, standard deviation of the growth of edges.
    """
    fitted = np.zeros(UNKNOWNS)
    fitted[:4] = start
    prior = 1.0 / max(growth, SMALLEST_GROWTH) ** 2
    inverse = np.zeros((UNKNOWNS, UNKNOWNS))
    normal = np.empty((UNKNOWNS, UNKNOWNS))
    right = np.empty(UNKNOWNS)
    misfit, inliers = 0.0, 0
    surface, passing = _in_blocks(points, SURFACE_ROWS), _in_blocks(beyond, RAY_ROWS)
    for step in range(MAX_STEPS):
        gate = INLIER_SIGMAS * GATES[min(step, len(GATES) - 1)]
        # What lies nearer to the outline may have grown: it shows where that is, not the surface.
        away = sqrt(fitted[0] ** 2 + fitted[1] ** 2 + fitted[2] ** 2)
        rim = 1.0 - RIM_SIGMAS * growth * away / fitted[3]
        normal[:] = 0.0
        right[:] = 0.0
        normal[4, 4] = prior
        right[4] = -prior * fitted[4]
        total, inliers = _add_surface(
            normal, right, surface, points.shape[0], fitted, rim, gate, noise, sharing
        )
        rays = (surface, points.shape[0]), (passing, beyond.shape[0])
        _add_outline(normal, right, rays, fitted, rim, gate, noise)
        if inliers < 5 or not _inverted(normal, inverse):
            return SphereSolution(fitted[:4].copy(), inverse[:4, :4].copy(), np.zeros(4), np.inf, 0)
        misfit = total / (inliers - 4)
        move = 0.0
        for a in range(UNKNOWNS):
            change = 0.0
            for b in range(UNKNOWNS):
                change += inverse[a, b] * right[b]
            # A step never goes further than the sphere is large: the model is far from linear.
            change = min(max(change, -0.5 * fitted[3]), 0.5 * fitted[3])
            fitted[a] += change
            move = max(move, abs(change))
        fitted[3] = min(max(fitted[3], 0.5 * min_radius), 2.0 * max_radius)
        if step >= len(GATES) and move < STILL:
            break
    shift = -inverse[:4, 4] * sqrt(prior)
    covariance = inverse[:4, :4] - np.outer(shift, shift)
    return SphereSolution(fitted[:4].copy(), covariance, shift, misfit, inliers)


@allocating_kernel
def _in_blocks(points: Any, rows: int) -> Any:
    """Return points (n, 3) as blocks (n_blocks, rows * BLOCK) with the rows `X`, `Y` and `Z`."""
    blocks = np.empty(((points.shape[0] + BLOCK - 1) // BLOCK, rows * BLOCK))
    for i in range(points.shape[0]):
        k, j = i // BLOCK, i % BLOCK
        blocks[k, X + j], blocks[k, Y + j], blocks[k, Z + j] = (
            points[i, 0],
            points[i, 1],
            points[i, 2],
        )
    return blocks


@kernel
def _add_surface(
    normal: Any,
    right: Any,
    blocks: Any,
    count: int,
    fitted: Any,
    rim: float,
    gate: float,
    noise: Any,
    sharing: float,
) -> tuple[float, int]:
    """Add the equations of readings inside the part `rim` of the outline's radius; return the sum
    of their squared errors in variances, and how many they are."""
    total, inliers = 0.0, 0
    for first in range(0, count, BLOCK):
        block, n = blocks[first // BLOCK], min(count - first, BLOCK)
        _write_equations(block, n, fitted, rim, gate, noise, sharing)
        total, inliers = _add_written(normal, right, block, n, total, inliers)
    return total, inliers


@kernel
def _write_equations(
    block: Any, n: int, fitted: Any, rim: float, gate: float, noise: Any, sharing: float
) -> None:
    """Write the equations of the first n readings of a block, with the weight 0 where a reading is
    off the surface or farther out than `rim`.

    No branch, which the compiler turns into vector code.
    """
    cx, cy, cz, r = fitted[0], fitted[1], fitted[2], fitted[3]
    levels = noise[0], noise[1], noise[2], noise[3]
    largest = rim if rim < 1.0 else np.inf
    for i in range(n):
        x, y, z = block[X + i], block[Y + i], block[Z + i]
        error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, levels)
        normal = normal_where_met(x, y, z, ahead, sine, cx, cy, cz, r)
        off = (error * error > gate * gate * variance) | (ahead < -BEHIND_SIGMAS * deviation)
        along = deviation * deviation * max(1.0 - sine * sine, 0.0)
        weight = 1.0 / (variance + sharing * along)
        block[NORMAL_X + i], block[NORMAL_Y + i], block[NORMAL_Z + i] = normal
        block[ERROR + i] = error
        block[WEIGHT + i] = 0.0 if off | (sine > largest) else weight
        block[SQUARE + i] = error * error / variance


@kernel
def _add_written(
    normal: Any, right: Any, block: Any, n: int, total: float, inliers: int
) -> tuple[float, int]:
    """Add the first n equations of a block, and to `total` and `inliers` what `_add_surface`
    returns. All sums are numbers of their own, which the compiler keeps in registers."""
    xx, yx, yy = normal[0, 0], normal[1, 0], normal[1, 1]
    zx, zy, zz = normal[2, 0], normal[2, 1], normal[2, 2]
    rx, ry, rz, rr = normal[3, 0], normal[3, 1], normal[3, 2], normal[3, 3]
    ex, ey, ez, er = right[0], right[1], right[2], right[3]
    for i in range(n):
        weight, error = block[WEIGHT + i], block[ERROR + i]
        if weight == 0.0:
            continue
        x, y, z = block[NORMAL_X + i], block[NORMAL_Y + i], block[NORMAL_Z + i]
        wx, wy, wz = weight * x, weight * y, weight * z
        xx, yx, yy = xx + wx * x, yx + wy * x, yy + wy * y
        zx, zy, zz = zx + wz * x, zy + wz * y, zz + wz * z
        rx, ry, rz, rr = rx + wx, ry + wy, rz + wz, rr + weight
        ex, ey, ez, er = ex + wx * error, ey + wy * error, ez + wz * error, er + weight * error
        total, inliers = total + block[SQUARE + i], inliers + 1
    normal[0, 0], normal[1, 0], normal[1, 1] = xx, yx, yy
    normal[2, 0], normal[2, 1], normal[2, 2] = zx, zy, zz
    normal[3, 0], normal[3, 1], normal[3, 2], normal[3, 3] = rx, ry, rz, rr
    right[0], right[1], right[2], right[3] = ex, ey, ez, er
    return total, inliers


@allocating_kernel
def _add_outline(
    normal: Any, right: Any, rays: Any, fitted: Any, rim: float, gate: float, noise: Any
) -> None:
    """Add the equations of rays on the wrong side of the grown outline.

    `rays`: of the readings on the sphere and of those beyond it, as of `_add_rays`.
    """
    surface, beyond = rays
    r = fitted[3]
    away2 = fitted[0] ** 2 + fitted[1] ** 2 + fitted[2] ** 2
    grown = r + fitted[4] * sqrt(away2)
    variance = noise[3] * away2 + SURFACE_VARIANCE
    if rim < 1.0:
        widest = grown + gate * sqrt(variance)
        _add_rays(normal, right, surface, fitted, grown, widest, grown, variance)
    _add_rays(normal, right, beyond, fitted, 0.5 * r, grown, grown, variance)


@allocating_kernel
def _add_rays(
    normal: Any,
    right: Any,
    rays: Any,
    fitted: Any,
    least: float,
    most: float,
    grown: float,
    variance: float,
) -> None:
    """Add the equations of rays that pass the centre between two distances, m.

    `rays`: blocks and the number of rays; `grown` in m, radius of the grown outline; `variance` in
    m², of its distance from a ray.
    """
    blocks, count = rays
    cx, cy, cz = fitted[0], fitted[1], fitted[2]
    row = np.empty(UNKNOWNS)
    row[3], row[4] = 1.0, sqrt(cx**2 + cy**2 + cz**2)
    for first in range(0, count, BLOCK):
        block, n = blocks[first // BLOCK], min(count - first, BLOCK)
        for i in range(n):
            block[MISS + i] = _passing(block[X + i], block[Y + i], block[Z + i], cx, cy, cz)[3]
        for i in range(n):
            miss = block[MISS + i]
            if least < miss < most:
                dx, dy, dz, _ = _passing(block[X + i], block[Y + i], block[Z + i], cx, cy, cz)
                inverse = 1.0 / max(miss, 1e-12)
                row[0], row[1], row[2] = dx * inverse, dy * inverse, dz * inverse
                _add_equation(normal, right, row, miss - grown, 1.0 / variance)


@inlined
def _passing(
    x: float, y: float, z: float, cx: float, cy: float, cz: float
) -> tuple[float, float, float, float]:
    """From a sphere's centre to where the ray to a reading passes it: along each axis, and the
    distance, m."""
    scale = (x * cx + y * cy + z * cz) / (x * x + y * y + z * z)
    dx, dy, dz = x * scale - cx, y * scale - cy, z * scale - cz
    return dx, dy, dz, sqrt(dx * dx + dy * dy + dz * dz)


@inlined
def _add_equation(normal: Any, right: Any, row: Any, error: float, weight: float) -> None:
    """Add one weighted equation row · change = error to the lower half of the normal equations."""
    for a in range(UNKNOWNS):
        right[a] += weight * row[a] * error
        for b in range(a + 1):
            normal[a, b] += weight * row[a] * row[b]


@allocating_entry
def readings_beyond(points: Any, sphere: Any, noise: Any) -> Any:
    """Return those (m, 3) of `points` (n, 3) clearly behind a sphere with rays near its outline."""
    cx, cy, cz, r = sphere[0], sphere[1], sphere[2], sphere[3]
    kept = np.empty((points.shape[0], 3))
    count = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if passes_by(x, y, z, cx, cy, cz, 1.5 * r):
            continue
        _, _, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
        if 0.6 < sine < 1.5 and ahead < -BEHIND_SIGMAS * deviation - 0.3 * r:
            kept[count, 0], kept[count, 1], kept[count, 2] = x, y, z
            count += 1
    return kept[:count]


@allocating_kernel
def _inverted(matrix: Any, inverse: Any) -> bool:
    """Write the inverse of a symmetric matrix (n, n), of which only the lower half is read, by
    Cholesky's factors; False where it is not positive definite."""
    n = matrix.shape[0]
    lower = np.zeros((n, n))
    for a in range(n):
        for b in range(a + 1):
            rest = matrix[a, b]
            for k in range(b):
                rest -= lower[a, k] * lower[b, k]
            if a == b:
                if rest <= 1e-12 * matrix[a, a]:
                    return False
                lower[a, a] = sqrt(rest)
            else:
                lower[a, b] = rest / lower[b, b]
    for column in range(n):
        for a in range(n):
            rest = 1.0 if a == column else 0.0
            for k in range(a):
                rest -= lower[a, k] * inverse[k, column]
            inverse[a, column] = rest / lower[a, a]
        for a in range(n - 1, -1, -1):
            rest = inverse[a, column]
            for k in range(a + 1, n):
                rest -= lower[k, a] * inverse[k, column]
            inverse[a, column] = rest / lower[a, a]
    return True
