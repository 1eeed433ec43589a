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

from intuitive_physics.kernels import allocating_entry, allocating_kernel, inlined

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
def write_normal(
    row: Any, x: float, y: float, z: float, ahead: float, sine: float, sphere: Any
) -> None:
    """Write the normal of a sphere where a ray meets it, and not at the reading: a weight or a
    direction that depends on the noise would pull the sphere to the sensor's side.

    `ahead` and `sine` as of `surface_error`.
    """
    r = sphere[3]
    distance = sqrt(x * x + y * y + z * z)
    meets = (distance + ahead - r * sqrt(max(1.0 - sine * sine, 0.0))) / distance
    scale = 1.0 / (r * max(sine, 1.0))
    row[0] = (x * meets - sphere[0]) * scale
    row[1] = (y * meets - sphere[1]) * scale
    row[2] = (z * meets - sphere[2]) * scale


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
    for step in range(MAX_STEPS):
        gate = INLIER_SIGMAS * GATES[min(step, len(GATES) - 1)]
        # What lies nearer to the outline may have grown: it shows where that is, not the surface.
        away = sqrt(fitted[0] ** 2 + fitted[1] ** 2 + fitted[2] ** 2)
        rim = 1.0 - RIM_SIGMAS * growth * away / fitted[3]
        normal[:] = 0.0
        right[:] = 0.0
        normal[4, 4] = prior
        right[4] = -prior * fitted[4]
        total, inliers = _add_surface(normal, right, points, fitted, rim, gate, noise, sharing)
        _add_outline(normal, right, points, beyond, fitted, rim, gate, noise)
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
def _add_surface(
    normal: Any,
    right: Any,
    points: Any,
    fitted: Any,
    rim: float,
    gate: float,
    noise: Any,
    sharing: float,
) -> tuple[float, int]:
    """Add the equations of points inside the part `rim` of the outline's radius; return the sum of
    their squared errors in variances, and how many they are."""
    cx, cy, cz, r = fitted[0], fitted[1], fitted[2], fitted[3]
    row = np.zeros(UNKNOWNS)
    row[3] = 1.0
    total, inliers = 0.0, 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
        off = error * error > gate * gate * variance or ahead < -BEHIND_SIGMAS * deviation
        if off or (rim < 1.0 and sine > rim):
            continue
        write_normal(row, x, y, z, ahead, sine, fitted)
        along = deviation * deviation * max(1.0 - sine * sine, 0.0)
        _add_equation(normal, right, row, error, 1.0 / (variance + sharing * along))
        total += error * error / variance
        inliers += 1
    return total, inliers


@allocating_kernel
def _add_outline(
    normal: Any,
    right: Any,
    points: Any,
    beyond: Any,
    fitted: Any,
    rim: float,
    gate: float,
    noise: Any,
) -> None:
    """Add the equations of rays on the wrong side of the grown outline."""
    r = fitted[3]
    away2 = fitted[0] ** 2 + fitted[1] ** 2 + fitted[2] ** 2
    grown = r + fitted[4] * sqrt(away2)
    variance = noise[3] * away2 + SURFACE_VARIANCE
    row = np.empty(UNKNOWNS)
    row[3], row[4] = 1.0, sqrt(away2)
    if rim < 1.0:
        widest = grown + gate * sqrt(variance)
        for i in range(points.shape[0]):
            miss = _passes(points[i], fitted, row)
            if grown < miss < widest:
                _add_equation(normal, right, row, miss - grown, 1.0 / variance)
    for i in range(beyond.shape[0]):
        miss = _passes(beyond[i], fitted, row)
        if 0.5 * r < miss < grown:
            _add_equation(normal, right, row, miss - grown, 1.0 / variance)


@inlined
def _passes(point: Any, fitted: Any, row: Any) -> float:
    """Distance, m, of the ray to a point from a sphere's centre; writes the direction there."""
    x, y, z = point[0], point[1], point[2]
    scale = (x * fitted[0] + y * fitted[1] + z * fitted[2]) / (x * x + y * y + z * z)
    dx, dy, dz = x * scale - fitted[0], y * scale - fitted[1], z * scale - fitted[2]
    miss = sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / max(miss, 1e-12)
    row[0], row[1], row[2] = dx * inverse, dy * inverse, dz * inverse
    return miss


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
        if not x * cx + y * cy + z * cz > 0.0:
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
