"""Spheres to begin fits from: expected ones, and those that an outline suggests.

A sphere of radius r at distance l is seen under the half angle α, sin α = r / l, and its nearest
point at l - r: r = nearest · sin α / (1 - sin α). Lengths in m, the sensor at the origin.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry
from intuitive_physics_perception.detection.cluster_view import ClusterView
from intuitive_physics_perception.detection.fitted_sphere import Part, SphereFitter, Start
from intuitive_physics_perception.detection.swept_sphere import swept_outline

SPHERES_IN_CLUSTER = 5
"""Largest number of spheres in one cluster."""

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

LOST_EDGES = 1.5
"""Radius of a ball's outline over that of its readings, where its edges were lost: about a pixel of
three, in a frame of 240 pixels focal length at 2 m."""

FEWEST_PIXELS = 2.5
"""Radius of a circle inside an outline in pixels at least: fewer readings make no sphere."""


def sphere_hypotheses(
    view: ClusterView,
    expected: Sequence[Start],
    fitter: SphereFitter,
    *,
    is_searched: bool,
    may_move: bool,
) -> Iterator[tuple[Part, Start]]:
    """Spheres to begin fits from, each with the part of a cluster that it is fitted to.

    Those that are expected come first, then one that moves during the exposure, those inside the
    outline, where it is that of several objects that touch, the one that the outline suggests,
    those of known radius, the one of the least algebraic error, and one with a larger outline.

    `is_searched`: whether for others than those that are expected, too; `may_move`: whether what
    moves during the exposure may be new in it.
    """
    for start in expected:
        yield fitter.part_near(view, start), start
    if not is_searched:
        return
    if may_move:
        yield from _swept(view, fitter)
    inscribed = (
        inscribed_spheres(view.points, view.cluster, view.pixel) if view.is_organised else []
    )
    if len(inscribed) > 1:
        for sphere in inscribed:
            start = Start(sphere, must_end=True)
            yield fitter.part_near(view, start), start
    whole = fitter.part(view)
    axis, sine, nearest = _outline_of(whole.points)
    yield whole, Start(_sphere(axis, sine, nearest))
    for sphere in spheres_of_radius(whole.points, fitter.known_radii):
        yield whole, Start(sphere)
    yield whole, Start(algebraic_sphere(whole.points))
    yield whole, Start(_sphere(axis, LOST_EDGES * sine, nearest))


def _swept(view: ClusterView, fitter: SphereFitter) -> Iterator[tuple[Part, Start]]:
    """The ball that moves as the times of its readings tell, or that an outline suggests that is
    longer than wide; nothing is known of the sweep along the line of sight."""
    longest = fitter.longest_sweep(view)
    if view.scan is not None:
        sphere, sweep, deviation = scanned_motion(view.readings, view.times_of(view.cluster))
        if np.linalg.norm(sweep) < longest:
            yield fitter.part(view), Start(sphere, sweep, deviation)
        return
    suggested = swept_outline(view.readings) if longest > 0.0 else None
    if suggested is not None:
        yield fitter.part(view), Start(*suggested, longest / SPEED_SIGMAS)


def outline_sphere(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (x, y, z, r) of the sphere whose outline and nearest point the cluster has.

    `points` (n, 3) m, of the cluster.
    """
    return _sphere(*_outline_of(points))


def _outline_of(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """Axis (3,) of the outline of points (n, 3) m, the sine of its half angle, and the nearest
    range in m."""
    ranges = np.linalg.norm(points, axis=1)
    directions = points / ranges[:, None]
    low, high = directions.min(axis=0), directions.max(axis=0)
    axis = 0.5 * (low + high)
    axis /= np.linalg.norm(axis)
    sines = np.linalg.norm(np.cross(directions, axis), axis=1)
    return axis, _quantile(sines, OUTLINE_QUANTILE), _quantile(ranges, NEAREST_QUANTILE)


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


def algebraic_sphere(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (x, y, z, r), m, of the least Σ(|p - c|² - r²)², a linear problem (Coope 1993).

    It depends only on the shape of the surface, not on the outline.

    `points` (n, 3) m, of the cluster.
    """
    middle = points.mean(axis=0)
    about = points - middle
    design = np.column_stack([2.0 * about, np.ones(len(points))])
    squares = np.square(about).sum(axis=1)
    solution, *_ = np.linalg.lstsq(design, squares, rcond=None)
    centre = solution[:3]
    return np.append(middle + centre, np.sqrt(max(solution[3] + centre @ centre, 0.0)))
