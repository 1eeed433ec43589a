"""Spheres to begin fits from: expected ones, those that an outline suggests, and random ones.

A sphere of radius r at distance l is seen under the half angle α, sin α = r / l, and its nearest
point at l - r: r = nearest · sin α / (1 - sin α). Lengths in m, the sensor at the origin; `noise`
as in `sphere_fit`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import Enum
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, allocating_kernel
from intuitive_physics_perception.detection.cluster_view import ClusterView
from intuitive_physics_perception.detection.fitted_sphere import Part, SphereFitter, Start
from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.detection.sphere_fit import (
    BEHIND_SIGMAS,
    INLIER_SIGMAS,
    surface_error,
)
from intuitive_physics_perception.detection.sphere_inspection import inspect_sphere
from intuitive_physics_perception.detection.swept_sphere import swept_outline
from intuitive_physics_perception.settings import PerceptionSettings

SCORED_POINTS = 512
"""Points that hypotheses are scored on."""

MOST_HYPOTHESES = 192
"""Random spheres that are tried on a cluster at most."""

REFINED_HYPOTHESES = 8
"""Random hypotheses that are fitted at most: those that several touching spheres make together have
the best scores."""

SPHERES_IN_CLUSTER = 5
"""Largest number of spheres in one cluster."""

ROUGHLY_ON = 0.6
"""Part of the readings in its outline that must lie on a hypothesis for it to be fitted."""

ALIKE = 0.2
"""Difference of centres and radii, in radii, of hypotheses of which only one is fitted: the widest
gate of a fit reaches farther. Set by hand."""

SPEED_SIGMAS = 3.0
"""Standard deviations of an unknown speed that `max_speed` is."""

LARGEST_SINE = 0.9
"""Sine of the half angle of an outline at most: numerical, a sensor inside a sphere sees none."""

OUTLINE_QUANTILE = 0.97
"""Part of the readings inside an outline: the others may be of its flickering edge."""

NEAREST_QUANTILE = 0.1
"""Part of the readings that count as nearest: their noise averages out. Set by hand."""

SMALLEST_CIRCLE = 0.4
"""Radius of a circle inside an outline, as a part of the largest one's, below which it is left out.
Set by hand."""

OUTLINE_PIXELS = 8192
"""Pixels of an outline in which circles are looked for; of a larger one every second or third row
and column are taken: bounds the time."""

FEWEST_PIXELS = 2.5
"""Radius of a circle inside an outline in pixels at least: fewer readings make no sphere."""

NEIGHBOUR_DRAWS = 12
"""Draws for each of the three points beside the first: enough to find near ones mostly."""

BATCH = 32
"""Hypotheses after which it is checked whether enough were tried."""

MISSED = 1e-3
"""Chance of having tried no four points of the best sphere, at which one stops."""


class Effort(Enum):
    """Effort of the search in a cluster: for spheres that are expected, for those that its outline
    suggests, too, and for any."""

    EXPECTED = 0
    OUTLINE = 1
    RANDOM = 2


class SphereHypotheses:
    """Suggests spheres in clusters."""

    def __init__(
        self, fitter: SphereFitter, settings: PerceptionSettings, rng: np.random.Generator
    ) -> None:
        self._fitter = fitter
        self._settings = settings
        self._rng = rng

    def of_cluster(
        self,
        view: ClusterView,
        expected: Sequence[Start],
        effort: Effort,
        budget: FrameBudget,
        *,
        may_move: bool,
    ) -> Iterator[tuple[Part, Start]]:
        """Spheres to begin fits from, each with the part of the cluster that it is fitted to.

        Those that are expected come first, then one that moves during the exposure, those inside
        the outline, where it is that of several objects that touch, the one that the outline
        suggests, those of known radius, and the best random ones.

        `may_move`: whether what moves during the exposure may be new in it.
        """
        readings = view.readings
        for start in expected:
            yield self._fitter.part_near(view, start), start
        if effort is Effort.EXPECTED:
            return
        if may_move:
            yield from self._swept(view)
        inscribed = (
            inscribed_spheres(view.points, view.cluster, view.pixel) if view.is_organised else []
        )
        if len(inscribed) > 1:
            for sphere in inscribed:
                start = Start(sphere, must_end=True)
                yield self._fitter.part_near(view, start), start
        whole = self._fitter.part(view)
        yield whole, Start(outline_sphere(whole.points))
        for sphere in spheres_of_radius(whole.points, self._fitter.known_radii):
            yield whole, Start(sphere)
        if effort is Effort.OUTLINE:
            return
        limits = self._settings.min_radius, self._settings.max_radius
        scored = self._fitter.some(whole.points, SCORED_POINTS)
        spheres, scores = ransac_spheres(
            scored,
            limits,
            self._fitter.noise,
            MOST_HYPOTHESES,
            self._rng,
            budget,
        )
        # A sphere with enough points has a share of those scored; half allows for a rough start.
        needed = 0.5 * self._settings.min_points * len(scored) / len(readings)
        tried: list[NDArray[np.float64]] = []
        # In single precision, as a frame's points are: `inspect_sphere` is compiled for these.
        single = scored.astype(np.float32)
        for sphere, score in zip(spheres, scores, strict=True):
            if score <= needed or len(tried) >= REFINED_HYPOTHESES or budget.is_spent:
                return
            if any(_are_alike(sphere, other) for other in tried):
                continue
            if self._explains(single, sphere):
                tried.append(sphere)
                yield whole, Start(sphere)

    def _swept(self, view: ClusterView) -> Iterator[tuple[Part, Start]]:
        """The ball that moves as the times of its readings tell, or that an outline suggests that
        is longer than wide; nothing is known of the sweep along the line of sight."""
        longest = self._fitter.longest_sweep(view)
        if view.scan is not None:
            sphere, sweep, deviation = scanned_motion(view.readings, view.times_of(view.cluster))
            if np.linalg.norm(sweep) < longest:
                yield self._fitter.part(view), Start(sphere, sweep, deviation)
            return
        suggested = swept_outline(view.readings) if longest > 0.0 else None
        if suggested is not None:
            yield self._fitter.part(view), Start(*suggested, longest / SPEED_SIGMAS)

    def _explains(self, points: NDArray[np.float32], sphere: NDArray[np.float64]) -> bool:
        """Cheap inlier test before refinement: are most points in the outline on the sphere?"""
        view = inspect_sphere(points, sphere, self._fitter.noise)
        return view.on > ROUGHLY_ON * (view.on + view.against)


def outline_sphere(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (x, y, z, r) of the sphere whose outline and nearest point the cluster has.

    `points` (n, 3) m, of the cluster.
    """
    ranges = np.linalg.norm(points, axis=1)
    directions = points / ranges[:, None]
    low, high = directions.min(axis=0), directions.max(axis=0)
    axis = 0.5 * (low + high)
    axis /= np.linalg.norm(axis)
    sines = np.linalg.norm(np.cross(directions, axis), axis=1)
    sine = _quantile(sines, OUTLINE_QUANTILE)
    return _sphere(axis, sine, _quantile(ranges, NEAREST_QUANTILE))


def scanned_motion(
    points: NDArray[np.float64], times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the sphere (4,) m and the sweep (3,) m of a ball that each reading shows at another
    time, and the standard deviation of the sweep's components, m.

    The mean of its readings moves as its centre does, but for how a scanner's pattern passes over
    it meanwhile: by the spread of its readings at most.

    `points` (n, 3) m, of the cluster; `times` (n,) as in `ClusterView.times_of`.
    """
    since = times - times.mean()
    square = max(float(since @ since), np.finfo(float).tiny)
    sweep = since @ points / square
    rested = points - np.outer(times, sweep)
    deviation = float(rested.std(axis=0).max())
    return outline_sphere(rested), sweep, deviation


def inscribed_spheres(
    points: NDArray[np.float32], cluster: NDArray[np.int64], pixel: float
) -> list[NDArray[np.float64]]:
    """Return spheres (x, y, z, r) whose outlines are circles inside the outline of a cluster.

    The largest circle comes first, then the largest with its centre outside of it, and so on:
    objects that touch make an outline that holds a circle for each.

    `points` (height, width, 3) m, of an organised frame; `cluster` (n,) indices of the cluster's
    points.
    """
    from scipy.ndimage import label

    # `divmod` takes ten times as long.
    rows = cluster // points.shape[1]
    columns = cluster - rows * points.shape[1]
    every = int(np.ceil(np.sqrt(len(cluster) / OUTLINE_PIXELS)))
    if every > 1:
        parts = rows // every, columns // every
        taken = (rows == every * parts[0]) & (columns == every * parts[1])
        cluster, rows, columns = cluster[taken], parts[0][taken], parts[1][taken]
        pixel *= every
    top, left = rows.min() - 1, columns.min() - 1
    mask = np.zeros((rows.max() - top + 2, columns.max() - left + 2), dtype=bool)
    mask[rows - top, columns - left] = True
    # What hangs together with the rim is outside, and holes are not; `binary_fill_holes` takes
    # three times as long.
    outside, _ = label(~mask)
    depth = depths_of(outside != outside[0, 0], rows - top, columns - left)
    readings = points.reshape(-1, 3)[cluster].astype(np.float64)
    ranges = np.linalg.norm(readings, axis=1)
    spheres: list[NDArray[np.float64]] = []
    free, largest = np.ones(len(cluster), dtype=bool), float(depth.max())
    while len(spheres) < SPHERES_IN_CLUSTER and free.any():
        middle = int(np.argmax(np.where(free, depth, -1.0)))
        circle = float(depth[middle])
        if circle < max(SMALLEST_CIRCLE * largest, FEWEST_PIXELS):
            break
        away2 = np.square(rows - rows[middle]) + np.square(columns - columns[middle])
        inside = away2 < circle * circle
        free &= ~inside
        nearest = _quantile(ranges[inside], NEAREST_QUANTILE)
        # The distance to the first pixel outside is half a pixel too long.
        spheres.append(
            _sphere(readings[middle] / ranges[middle], np.sin((circle - 0.5) * pixel), nearest)
        )
    return spheres


@allocating_entry
def depths_of(inside: Any, rows: Any, columns: Any) -> Any:
    """Return how far some pixels are from the nearest one that is not inside, (n,) pixels.

    It takes a third to a tenth of the time of SciPy's `distance_transform_edt`, which finds the
    depth of every pixel.

    `inside` (height, width), nothing of which is in the first and last row and column; `rows` and
    `columns` (n,) of the pixels.
    """
    height, width = inside.shape
    # First along the columns alone.
    along = np.zeros((height, width), dtype=np.int32)
    for v in range(1, height):
        for u in range(width):
            along[v, u] = (along[v - 1, u] + 1) * inside[v, u]
    for v in range(height - 2, 0, -1):
        for u in range(width):
            along[v, u] = min(along[v, u], along[v + 1, u] + 1)
    depths = np.empty(rows.size)
    for i in range(rows.size):
        v, u = rows[i], columns[i]
        nearest2, k = along[v, u] ** 2, 1
        # Ends at the border of the image at last.
        while k * k < nearest2:
            beside2 = min(along[v, u - k] ** 2, along[v, u + k] ** 2)
            nearest2 = min(nearest2, k * k + beside2)
            k += 1
        depths[i] = sqrt(nearest2)
    return depths


def _quantile(values: NDArray[np.float64], part: float) -> float:
    """What `np.quantile` returns, in a tenth of its time for some hundred values (n,)."""
    ordered = np.sort(values)
    at = part * (len(ordered) - 1)
    below, above = ordered[int(at)], ordered[min(int(at) + 1, len(ordered) - 1)]
    return float(below + (at - int(at)) * (above - below))


def _sphere(axis: NDArray[np.float64], sine: float, nearest: float) -> NDArray[np.float64]:
    """Sphere (4,) along a unit vector, by the sine of its half angle and its nearest range."""
    sine = min(sine, LARGEST_SINE)
    radius = nearest * sine / (1.0 - sine)
    return np.append(axis * (nearest + radius), radius)


def ransac_spheres(
    points: NDArray[np.float64],
    limits: tuple[float, float],
    noise: NDArray[np.float64],
    most: int,
    rng: np.random.Generator,
    budget: FrameBudget,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return spheres (m, 4) and their MSAC scores (m,), best first.

    Hypotheses come in batches until the best one's share w of the points says that four of its
    points have been drawn: (1 - w⁴)ⁿ < `MISSED` (Fischler, Bolles 1981); or the time is over.

    `points` (n, 3) m; `noise` (4,) of `RangeNoise`, as in `sphere_fit`.
    """
    spheres, scores = [np.empty((0, 4))], [np.empty(0)]
    tried, best = 0, 0.0
    while tried < _enough(best / len(points), most) and not (tried and budget.is_spent):
        draws = rng.random((BATCH, 2 + 3 * NEIGHBOUR_DRAWS))
        spheres.append(random_spheres(points, draws, *limits))
        scores.append(score_spheres(points, spheres[-1], noise))
        best = max(best, float(scores[-1].max(initial=0.0)))
        tried += BATCH
    order = np.argsort(-np.concatenate(scores), kind="stable")
    return np.concatenate(spheres)[order], np.concatenate(scores)[order]


def _enough(share: float, most: int) -> float:
    """Number of draws of four points that is enough where a sphere has that share of all."""
    chance = min(share, 1.0) ** 4
    if chance <= 0.0:
        return most
    if chance >= 1.0:
        return 1
    return min(most, float(np.log(MISSED) / np.log1p(-chance)))


def spheres_of_radius(
    points: NDArray[np.float64], radii: Sequence[float]
) -> list[NDArray[np.float64]]:
    """Return (x, y, z, r) for each of some radii: as far behind the nearest points as r says.

    `points` (n, 3) m, of the cluster; `radii` in m.
    """
    ranges = np.linalg.norm(points, axis=1)
    near = points[ranges <= _quantile(ranges, 0.2)].mean(axis=0)
    distance = float(np.linalg.norm(near))
    return [np.append(near * (1.0 + radius / distance), radius) for radius in radii]


@allocating_entry
def score_spheres(points: Any, spheres: Any, noise: Any) -> Any:
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
                scores[k] += max(1.0 - error * error / (INLIER_SIGMAS**2 * variance), 0.0)
    return scores


@allocating_entry
def random_spheres(points: Any, draws: Any, min_radius: float, max_radius: float) -> Any:
    """Spheres (m, 4) through four points each, m ≤ n: those of a possible size and bulging towards
    the sensor.

    `draws` (n, 2 + 3 NEIGHBOUR_DRAWS) uniform in [0, 1): first point, scale, and neighbours.
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


def _are_alike(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Whether a fit that begins at one of two spheres (4,) most likely ends as from the other."""
    return bool(np.abs(first - second).max() < ALIKE * min(first[3], second[3]))
