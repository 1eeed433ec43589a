"""Spheres through random points of a cluster, and how well they explain it.

Lengths in m, the sensor at the origin; `noise` as in `sphere_fit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, allocating_kernel
from intuitive_physics_perception.detection.sphere_fit import BEHIND_SIGMAS, surface_error

NEIGHBOUR_DRAWS = 12
"""Draws for each of the three points beside the first: enough to find near ones mostly."""

BATCH = 32
"""Hypotheses after which it is checked whether enough were tried."""

MISSED = 1e-3
"""Chance of having tried no four points of the best sphere, at which one stops."""


def ransac_spheres(
    points: NDArray[np.float64],
    limits: tuple[float, float],
    sigmas: float,
    noise: NDArray[np.float64],
    most: int,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return spheres (m, 4) and their MSAC scores (m,), best first.

    Hypotheses come in batches until the best one's share w of the points says that four of its
    points have been drawn: (1 - w⁴)ⁿ < `MISSED` (Fischler, Bolles 1981).

    Parameters
    ----------
    points : (n, 3) m
    limits : smallest and largest radius, m
    sigmas : standard deviations within which a point counts
    noise : (4,) of `RangeNoise`, as in `sphere_fit`
    most : hypotheses at most
    """
    spheres, scores = [np.empty((0, 4))], [np.empty(0)]
    tried, best = 0, 0.0
    while tried < _enough(best / len(points), most):
        draws = rng.random((BATCH, 2 + 3 * NEIGHBOUR_DRAWS))
        spheres.append(random_spheres(points, draws, *limits))
        scores.append(score_spheres(points, spheres[-1], sigmas, noise))
        best = max(best, float(scores[-1].max(initial=0.0)))
        tried += BATCH
    order = np.argsort(-np.concatenate(scores), kind="stable")
    return np.concatenate(spheres)[order], np.concatenate(scores)[order]


def _enough(share: float, most: int) -> float:
    """How many draws of four points are enough where a sphere has that share of all."""
    chance = min(share, 1.0) ** 4
    if chance <= 0.0:
        return most
    if chance >= 1.0:
        return 1
    return min(most, float(np.log(MISSED) / np.log1p(-chance)))


def outline_sphere(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (x, y, z, r) of the sphere whose outline and nearest point the cluster has.

    A sphere of radius r at distance l is seen under the half angle α, sin α = r / l, and its
    nearest point at l - r: r = nearest sin α / (1 - sin α).

    Parameters
    ----------
    points : (n, 3) m, of the cluster
    """
    ranges = np.linalg.norm(points, axis=1)
    directions = points / ranges[:, None]
    low, high = directions.min(axis=0), directions.max(axis=0)
    axis = 0.5 * (low + high)
    axis /= np.linalg.norm(axis)
    sines = np.linalg.norm(np.cross(directions, axis), axis=1)
    sine = min(float(np.quantile(sines, 0.97)), 0.9)
    nearest = float(np.quantile(ranges, 0.1))
    radius = nearest * sine / (1.0 - sine)
    return np.append(axis * (nearest + radius), radius)


def spheres_of_radius(
    points: NDArray[np.float64], radii: Sequence[float]
) -> list[NDArray[np.float64]]:
    """Return (x, y, z, r) for each of some radii: as far behind the nearest points as r says.

    Parameters
    ----------
    points : (n, 3) m, of the cluster
    radii : m
    """
    ranges = np.linalg.norm(points, axis=1)
    near = points[ranges <= np.quantile(ranges, 0.2)].mean(axis=0)
    distance = float(np.linalg.norm(near))
    return [np.append(near * (1.0 + radius / distance), radius) for radius in radii]


@allocating_entry
def score_spheres(points: Any, spheres: Any, sigmas: float, noise: Any) -> Any:
    """MSAC score of each sphere (n, 4): what its inliers lie nearer than the tolerance, in its
    squares; the larger the better."""
    scores = np.zeros(spheres.shape[0])
    for k in range(spheres.shape[0]):
        cx, cy, cz, r = spheres[k, 0], spheres[k, 1], spheres[k, 2], spheres[k, 3]
        for i in range(points.shape[0]):
            error, variance, deviation, ahead, _ = surface_error(
                points[i, 0], points[i, 1], points[i, 2], cx, cy, cz, r, noise
            )
            if ahead > -BEHIND_SIGMAS * deviation:
                scores[k] += max(1.0 - error * error / (sigmas * sigmas * variance), 0.0)
    return scores


@allocating_entry
def random_spheres(points: Any, draws: Any, min_radius: float, max_radius: float) -> Any:
    """Spheres (m, 4) through four points each, m ≤ n: those of a possible size and bulging
    towards the sensor.

    Parameters
    ----------
    draws : (n, 2 + 3 NEIGHBOUR_DRAWS) uniform in [0, 1): first point, scale, and neighbours
    """
    n = points.shape[0]
    spheres = np.empty((draws.shape[0], 4))
    corners = np.empty((4, 3))
    found = 0
    for k in range(draws.shape[0]):
        corners[0] = points[int(draws[k, 0] * n)]
        # Points further apart than twice the radius are never on one sphere.
        reach = 2.0 * min_radius * (max_radius / min_radius) ** draws[k, 1]
        chosen = 1
        for j in range(2, draws.shape[1]):
            candidate = points[int(draws[k, j] * n)]
            if np.sum((candidate - corners[0]) ** 2) < reach * reach:
                corners[chosen] = candidate
                chosen += 1
                if chosen == 4:
                    break
        if chosen == 4 and _through(corners, spheres[found]):
            r = spheres[found, 3]
            if 0.8 * min_radius <= r <= 1.25 * max_radius:
                found += 1
    return spheres[:found]


@allocating_kernel
def _through(corners: Any, sphere: Any) -> bool:
    """Write the sphere through four points; False where they lie in a plane or see its inside."""
    # |p - c|² equal for all: 2 (p_i - p_0) · (c - p_0) = |p_i - p_0|², by Cramer's rule.
    ax, ay, az = corners[1] - corners[0]
    bx, by, bz = corners[2] - corners[0]
    dx, dy, dz = corners[3] - corners[0]
    a2, b2 = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
    d2 = dx * dx + dy * dy + dz * dz
    nx, ny, nz = by * dz - bz * dy, bz * dx - bx * dz, bx * dy - by * dx
    volume = ax * nx + ay * ny + az * nz
    if volume * volume <= 1e-8 * a2 * b2 * d2:
        return False
    mx, my, mz = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
    lx, ly, lz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    x = (a2 * nx + b2 * mx + d2 * lx) / (2.0 * volume)
    y = (a2 * ny + b2 * my + d2 * ly) / (2.0 * volume)
    z = (a2 * nz + b2 * mz + d2 * lz) / (2.0 * volume)
    sphere[0], sphere[1], sphere[2] = corners[0, 0] + x, corners[0, 1] + y, corners[0, 2] + z
    sphere[3] = sqrt(x * x + y * y + z * z)
    ahead = 0.0
    for i in range(4):
        toward = sphere[:3] - corners[i]
        ahead += np.sum(toward * corners[i])
    return ahead > 0.0
