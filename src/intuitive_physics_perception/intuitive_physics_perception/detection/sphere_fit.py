"""Kernels that fit one sphere to readings and judge whether it is one.

Only the side near the sensor is seen. Noise acts along the ray. A reading whose ray meets the
sphere at the angle θ to its normal is therefore off the surface by cos θ of its range error, and by
sin θ of its lateral error. Where the ray grazes the sphere (θ near 90°) a range error δ moves the
point off the surface by δ² / 2 r to second order, always outwards: that bias is taken off.

`noise` is (a², b², limit², lateral²) of `RangeNoise`; lengths in m, the sensor at the origin.
"""

from __future__ import annotations

from math import atan2, pi, sqrt
from typing import Any

import numpy as np

from intuitive_physics.kernels import allocating_entry, allocating_kernel, inlined, kernel

BEHIND_SIGMAS = 3.0
"""Standard deviations behind a sphere's centre from which on a reading is not on its near side."""

GATES = (6.0, 4.0, 3.0, 2.0, 1.5, 1.2, 1.0)
"""Multiples of the gate in the first steps of a fit: a rough start must keep its inliers."""

MAX_STEPS = 20
"""Gauss-Newton steps at most: numerical."""

STILL = 1e-7
"""Change of centre or radius in m below which the fit has converged: numerical."""

SURFACE_VARIANCE = 1e-8
"""Variance of the surface in m²: keeps residuals finite where the noise vanishes, numerical."""

LATTICE = 0.15
"""Spacing, in radii, of the lattice over the outline on which seen places are marked. Set by
hand."""

LATTICE_REACH = 6
"""Lattice points from the centre of the outline to its edge: the outline is covered."""

LATTICE_SIDE = 2 * LATTICE_REACH + 1
"""Lattice points along one side."""

EDGE_PART = 0.9
"""Part of the outline's radius beyond which readings are not judged: they graze. Set by hand."""

OCCLUDER_DEPTH = 0.5
"""Distance before the surface, in radii, from which on a reading hides the sphere instead of
contradicting it. Set by hand."""

SECTORS = 16
"""Of the ring round the outline: each is judged by itself. A ball that touches another of its size
has 2 to 3 of them in common with it."""

RING_WIDTH = 0.35
"""Radii over which the ring outside the outline reaches: a neighbour of the same size in contact
covers a seventh of it. Set by hand."""

PATCH_RINGS = 3
"""Rings of equal area, each of `SECTORS` patches, into which the disc of a sphere is divided."""

STEEPEST_SLOPE = 1.7320508
"""Tangent of 60°, the angle of incidence up to which a surface that goes on is expected to be
read."""

CHANGE_SIGMAS = 4.0
"""Standard deviations by which a reading differs from the one before when something else is seen.
Six in 100,000 do so by chance."""


@inlined
def surface_error(
    x: float,
    y: float,
    z: float,
    cx: float,
    cy: float,
    cz: float,
    r: float,
    noise: Any,
) -> tuple[float, float, float, float, float]:
    """How a reading lies to a sphere.

    Returns
    -------
    error : m, distance outside the surface, its bias taken off
    variance : of that error, m²
    deviation : of the reading along its ray, m
    ahead : m the reading lies nearer to the sensor than the sphere's centre, along the ray
    sine : of the angle at which the ray meets the sphere, above one where it misses
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


@allocating_entry
def refine_sphere(
    points: Any,
    beyond: Any,
    start: Any,
    min_radius: float,
    max_radius: float,
    sigmas: float,
    noise: Any,
    sharing: float,
) -> tuple[Any, Any, float, int]:
    """Fit (x, y, z, r) by Gauss-Newton over the inliers, whose gate narrows step by step.

    Neighbouring readings share their error along the ray. Least squares with the normal equations
    A = Σ w J Jᵀ, w = 1 / σ², has the covariance A⁻¹ (Σᵢⱼ wᵢ wⱼ cov(eᵢ, eⱼ) Jᵢ Jⱼᵀ) A⁻¹. The rows J
    of neighbours are about the same, so the inner sum is A + n B with B = Σ w² σₐ² J Jᵀ, where σₐ²
    is the variance that the error along the ray makes and n the number of other readings that share
    it.

    Parameters
    ----------
    points : (n, 3), those on the sphere among them
    beyond : (m, 3), readings of `readings_beyond`, whose rays must miss the sphere
    sharing : n, other readings among the points that share one's error along the ray

    Returns
    -------
    sphere : (4,)
    covariance : (4, 4), as large as the residuals ask for
    misfit : mean squared residual in variances, about one for a sphere
    inliers : how many points took part; zero where the fit failed
    """
    sphere = start.copy()
    covariance = np.zeros((4, 4))
    normal = np.empty((4, 4))
    shared = np.empty((4, 4))
    right = np.empty(4)
    row = np.empty(4)
    misfit, inliers = 0.0, 0
    for step in range(MAX_STEPS):
        gate = sigmas * GATES[min(step, len(GATES) - 1)]
        cx, cy, cz, r = sphere[0], sphere[1], sphere[2], sphere[3]
        normal[:] = 0.0
        shared[:] = 0.0
        right[:] = 0.0
        inliers, total = 0, 0.0
        for i in range(points.shape[0]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
            if error * error > gate * gate * variance or ahead < -BEHIND_SIGMAS * deviation:
                continue
            # The normal where the ray meets the sphere, and not at the reading: a weight or a
            # direction that depends on the noise would pull the sphere to the sensor's side.
            distance = sqrt(x * x + y * y + z * z)
            meets = (distance + ahead - r * sqrt(max(1.0 - sine * sine, 0.0))) / distance
            scale = 1.0 / (r * max(sine, 1.0))
            row[0] = (x * meets - cx) * scale
            row[1] = (y * meets - cy) * scale
            row[2] = (z * meets - cz) * scale
            row[3] = 1.0
            _add_equation(normal, right, row, error, 1.0 / variance)
            _add_square(shared, row, (deviation / variance) ** 2 * max(1.0 - sine * sine, 0.0))
            inliers += 1
            total += error * error / variance
        for i in range(beyond.shape[0]):
            x, y, z = beyond[i, 0], beyond[i, 1], beyond[i, 2]
            # Where its ray passes the centre nearest, it must pass outside.
            passes = (x * cx + y * cy + z * cz) / (x * x + y * y + z * z)
            dx, dy, dz = x * passes - cx, y * passes - cy, z * passes - cz
            miss = sqrt(dx * dx + dy * dy + dz * dz)
            if 0.5 * r < miss < r:
                row[0], row[1], row[2], row[3] = dx / miss, dy / miss, dz / miss, 1.0
                variance = noise[3] * (cx * cx + cy * cy + cz * cz) + SURFACE_VARIANCE
                _add_equation(normal, right, row, miss - r, 1.0 / variance)
        if inliers < 5 or not _inverted(normal, covariance):
            return sphere, covariance, np.inf, 0
        misfit = total / (inliers - 4)
        move = 0.0
        for a in range(4):
            change = 0.0
            for b in range(4):
                change += covariance[a, b] * right[b]
            # A step never goes further than the sphere is large: the model is far from linear.
            change = min(max(change, -0.5 * r), 0.5 * r)
            sphere[a] += change
            move = max(move, abs(change))
        sphere[3] = min(max(sphere[3], 0.5 * min_radius), 2.0 * max_radius)
        if step >= len(GATES) and move < STILL:
            break
    _widen(covariance, shared, sharing, max(misfit, 1.0))
    return sphere, covariance, misfit, inliers


@inlined
def _add_equation(normal: Any, right: Any, row: Any, error: float, weight: float) -> None:
    """Add one weighted equation row · change = error to the lower half of the normal equations."""
    for a in range(4):
        right[a] += weight * row[a] * error
        for b in range(a + 1):
            normal[a, b] += weight * row[a] * row[b]


@inlined
def _add_square(matrix: Any, row: Any, weight: float) -> None:
    """Add weight · row rowᵀ to a matrix (4, 4)."""
    for a in range(4):
        for b in range(4):
            matrix[a, b] += weight * row[a] * row[b]


@allocating_kernel
def _widen(covariance: Any, shared: Any, sharing: float, misfit: float) -> None:
    """Make of a covariance C = A⁻¹ (4, 4) misfit · (C + sharing · C · shared · C)."""
    half = np.zeros((4, 4))
    for a in range(4):
        for b in range(4):
            for k in range(4):
                half[a, b] += covariance[a, k] * shared[k, b]
    whole = np.zeros((4, 4))
    for a in range(4):
        for b in range(4):
            for k in range(4):
                whole[a, b] += half[a, k] * covariance[k, b]
    for a in range(4):
        for b in range(4):
            covariance[a, b] += 0.5 * sharing * (whole[a, b] + whole[b, a])
            covariance[a, b] *= misfit


@allocating_entry
def readings_beyond(points: Any, sphere: Any, noise: Any) -> Any:
    """Readings (m, 3) of (n, 3) clearly behind a sphere's centre whose rays pass near its outline.

    Parameters
    ----------
    points : may hold NaN
    """
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
    """Write the inverse of a symmetric 4 x 4 matrix, of which only the lower half is read, by
    Cholesky's factors; False where it is not positive definite."""
    n = 4
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


@allocating_entry
def inspect_sphere(
    points: Any, sphere: Any, sigmas: float, noise: Any
) -> tuple[int, int, float, float]:
    """Judge a sphere by every reading in its outline, whatever cluster it belongs to.

    What lies well before the sphere hides it and says nothing. What lies behind its surface could
    not have been seen through it; what lies close before it is a part of something larger.

    Parameters
    ----------
    points : (n, 3), may hold NaN

    Returns
    -------
    on : readings on the surface
    against : readings that contradict it
    visible : part of the outline's disc that has a reading on the surface within LATTICE radii.
        Two scan lines of a LiDAR, which fit a sphere on anything round, make at most 0.4
    density : part of the disc between readings on the surface that has any reading so near. Two
        scan lines make at most 0.7; a sphere cut off by the image's edge makes one
    """
    cx, cy, cz, r = sphere[0], sphere[1], sphere[2], sphere[3]
    across, upwards = line_of_sight_axes(sphere)
    seen = np.zeros((LATTICE_SIDE, LATTICE_SIDE), dtype=np.bool_)
    read = np.zeros((LATTICE_SIDE, LATTICE_SIDE), dtype=np.bool_)
    on, against = 0, 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        toward = x * cx + y * cy + z * cz
        if not toward > 0.0:
            continue
        error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
        if sine > 1.0:
            continue
        # Where the ray passes the centre nearest, in radii across the line of sight.
        scale = toward / ((x * x + y * y + z * z) * r)
        a = (x * across[0] + y * across[1] + z * across[2]) * scale
        b = (x * upwards[0] + y * upwards[1] + z * upwards[2]) * scale
        _mark(read, a, b)
        if error * error < sigmas * sigmas * variance and ahead > -BEHIND_SIGMAS * deviation:
            on += 1
            _mark(seen, a, b)
        elif sine < EDGE_PART:
            before = ahead - r * sqrt(1.0 - sine * sine)
            if before < max(BEHIND_SIGMAS * deviation, OCCLUDER_DEPTH * r):
                against += 1
    visible, density = _marked_parts(seen, read)
    return on, against, visible, density


@allocating_kernel
def line_of_sight_axes(sphere: Any) -> tuple[Any, Any]:
    """Two unit vectors across the line of sight to a sphere."""
    toward = sphere[:3] / sqrt(np.sum(sphere[:3] ** 2))
    helper = np.zeros(3)
    helper[np.argmin(np.abs(toward))] = 1.0
    across = helper - np.sum(helper * toward) * toward
    across /= sqrt(np.sum(across**2))
    return across, np.cross(toward, across)


@kernel
def _mark(seen: Any, a: float, b: float) -> None:
    """Mark what of the lattice over the unit disc lies within LATTICE of (a, b)."""
    i, j = round(a / LATTICE), round(b / LATTICE)
    for k in range(max(i - 1, -LATTICE_REACH), min(i + 1, LATTICE_REACH) + 1):
        for m in range(max(j - 1, -LATTICE_REACH), min(j + 1, LATTICE_REACH) + 1):
            if (k * LATTICE - a) ** 2 + (m * LATTICE - b) ** 2 <= LATTICE**2:
                seen[k + LATTICE_REACH, m + LATTICE_REACH] = True


@allocating_kernel
def _marked_parts(seen: Any, read: Any) -> tuple[float, float]:
    """Part of the disc that is seen, and part of what lies between seen places that is read."""
    marked, total, filled, enclosed = 0, 0, 0, 0
    for k in range(LATTICE_SIDE):
        for m in range(LATTICE_SIDE):
            i, j = k - LATTICE_REACH, m - LATTICE_REACH
            if (i * i + j * j) * LATTICE**2 > EDGE_PART**2:
                continue
            total += 1
            marked += seen[k, m]
            in_row = np.any(seen[k, : m + 1]) and np.any(seen[k, m:])
            in_column = np.any(seen[: k + 1, m]) and np.any(seen[k:, m])
            if in_row or in_column:
                enclosed += 1
                filled += read[k, m]
    return marked / total, filled / max(enclosed, 1)


@allocating_entry
def look_round_outline(
    points: Any, own: Any, before: Any, sphere: Any, pixel: float, sigmas: float, noise: Any
) -> tuple[float, float, float, float, Any]:
    """Judge the ring outside a sphere's outline, and whether its surface is new.

    A free sphere ends at its outline: just outside, the sensor sees something else, or nothing. A
    part of something larger (a corner, a shoulder, the bulge of a mug) goes on as the same surface.
    Such a surface that leaves the outline backwards at the steepest angle that is still read lies,
    s radii across the line of sight, (s - 1) tan(angle) radii behind the outline, and no more.

    Parameters
    ----------
    points : (n, 3) readings about the sphere, may hold NaN
    own : (n,) nonzero where a reading belongs to the cluster in which the sphere was found
    before : (n,) m, range read there when the environment was modelled, NaN where it is unknown
    sphere : (4,)
    pixel : angle between neighbouring pixels, rad
    sigmas : standard deviations from the surface within which a reading is on it

    Returns
    -------
    goes_on : part of the ring's sectors in which the cluster goes on past the outline
    level : part of the ring's sectors in which any surface goes on past the outline, as a plate
        does round a bulge
    ends : part of the ring's sectors in which what is read lies behind all that could go on
    new : part of the readings on the surface that are nearer than what was read there before, or
        where nothing was
    patches : (n_patches, 3) readings on the surface, mean of their distance outside it, m, and mean
        variance of that distance, m², by patch of the disc
    """
    cx, cy, cz, r = sphere[0], sphere[1], sphere[2], sphere[3]
    across, upwards = line_of_sight_axes(sphere)
    distance = sqrt(cx * cx + cy * cy + cz * cz)
    # Readings nearer to the outline may be mixed of both sides of the edge, or fattened.
    inner = 1.0 + 2.5 * pixel * distance / r
    outer = inner + max(RING_WIDTH, 2.0 * pixel * distance / r)
    same = np.zeros(SECTORS, dtype=np.int64)
    near = np.zeros(SECTORS, dtype=np.int64)
    total = np.zeros(SECTORS, dtype=np.int64)
    patches = np.zeros((PATCH_RINGS * SECTORS, 3))
    new, on_surface = 0, 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        toward = x * cx + y * cy + z * cz
        if not toward > 0.0:
            continue
        error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
        if sine > outer or 1.0 < sine < inner:
            continue
        a = x * across[0] + y * across[1] + z * across[2]
        b = x * upwards[0] + y * upwards[1] + z * upwards[2]
        sector = int((atan2(b, a) + pi) / (2.0 * pi) * SECTORS) % SECTORS
        if sine <= 1.0:
            if error * error > sigmas * sigmas * variance or ahead < -BEHIND_SIGMAS * deviation:
                continue
            on_surface += 1
            change = before[i] - sqrt(x * x + y * y + z * z)
            # NaN, where nothing was read, is not at most anything.
            new += not change <= CHANGE_SIGMAS * 1.4142136 * deviation
            if sine < EDGE_PART:
                # Rings of equal area: as many readings in each.
                ring = int(sine * sine / (EDGE_PART * EDGE_PART) * PATCH_RINGS)
                patch = ring * SECTORS + sector
                patches[patch, 0] += 1.0
                patches[patch, 1] += error
                patches[patch, 2] += variance
        else:
            behind = STEEPEST_SLOPE * (sine - 1.0) * r + BEHIND_SIGMAS * deviation
            total[sector] += 1
            near[sector] += ahead > -behind
            same[sector] += own[i] != 0 and ahead > -behind
    goes_on, level, ends = 0, 0, 0
    for k in range(SECTORS):
        goes_on += 2 * same[k] > total[k]
        level += 2 * near[k] > total[k]
        ends += 2 * near[k] <= total[k] and total[k] > 0
    for k in range(patches.shape[0]):
        patches[k, 1:] /= max(patches[k, 0], 1.0)
    return goes_on / SECTORS, level / SECTORS, ends / SECTORS, new / max(on_surface, 1), patches
