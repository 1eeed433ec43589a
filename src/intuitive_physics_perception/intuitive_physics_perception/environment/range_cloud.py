"""Points as a range sensor reads them: noise along the ray, neighbours in direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.settings import PerceptionSettings

DIRECTION_CELL = 0.05
"""Edge length of the cells of directions, unit vectors, that hang together when both are filled."""

ANGLES_ASKED = 500
"""Readings, drawn at random, whose angle to the nearest other one is measured: bounds the
time."""

NEIGHBOURS = 200
"""Neighbours of a reading among which one of another scan line is looked for: a scanner reads up to
some twenty times as densely along its lines as across them."""

GRAZING = 0.02
"""Cosine of the angle between ray and normal below which it is unsure where they meet."""


class RangeCloud:
    """Points with what is needed to judge how near to a plane they are.

    `points` (n, 3) m, all finite, the sensor at the origin; `tolerance` m, unevenness of a plane;
    `sigmas`: standard deviations of the noise within which a point belongs to it.
    """

    def __init__(
        self, points: NDArray[np.float64], noise: RangeNoise, tolerance: float, sigmas: float
    ) -> None:
        self.points = np.asarray(points, dtype=np.float64)
        self.ranges = np.linalg.norm(self.points, axis=1)
        self.deviations = noise.deviation(self.ranges)
        self.tolerance, self.sigmas = tolerance, sigmas

    @staticmethod
    def of_scene(
        points: NDArray[np.float64], noise: RangeNoise, settings: PerceptionSettings
    ) -> RangeCloud:
        """Return the cloud of points (n, 3) m, to be compared with planes of an environment."""
        return RangeCloud(points, noise, settings.plane_tolerance, settings.plane_sigmas)

    def scaled_distances(
        self,
        plane: NDArray[np.float64],
        which: NDArray[np.intp] | slice = slice(None),
        heights: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
    ) -> NDArray[np.float64]:
        """Return distances from planes, (..., n), in units of what noise makes likely.

        Noise acts along the ray, so a grazing ray moves a point little away from the plane. Below
        zero beyond the plane, seen from where its normal points.

        `plane` (..., 4) normal and offset in m; `which` (n,) indices of the points; all of them if
        not given; `heights`: of a surface over the plane (n,) m, at points (n, 3); flat if not
        given.
        """
        over = plane[..., :3] @ self.points[which].T
        # In place, as the arrays of many planes are larger than the cache.
        spread = over / self.ranges[which]
        spread *= self.sigmas * self.deviations[which]
        np.square(spread, out=spread)
        spread += self.tolerance**2
        over -= plane[..., 3:]
        if heights is not None:
            over -= heights(self.points[which])
        over /= np.sqrt(spread, out=spread)
        return np.asarray(over)

    def near(
        self, plane: NDArray[np.float64], which: NDArray[np.intp] | slice = slice(None)
    ) -> NDArray[np.bool_]:
        """Mark the points (..., n) that may be on planes, by noise and unevenness.

        `plane` (..., 4) normal and offset in m; `which` (n,) indices of the points; all of them if
        not given.
        """
        return np.abs(self.scaled_distances(plane, which)) < 1.0

    def connected_parts(
        self, plane: NDArray[np.float64], others: Sequence[NDArray[np.float64]] = ()
    ) -> list[NDArray[np.intp]]:
        """Indices (n,) of the points of each part of a plane that is seen as one, largest first.

        Those near one of the other planes too are left out: where two planes cross, a strip of the
        one lies near the other without being part of it.

        `plane` (4,) normal and offset in m; `others` (4,) each, the other planes.
        """
        near = self.near(plane)
        for other in others:
            near &= ~self.near(other)
        return self.connected(np.flatnonzero(near))

    def connected(self, inliers: NDArray[np.intp]) -> list[NDArray[np.intp]]:
        """Split points, `inliers` (n,) their indices, into parts that are seen as one, largest
        first."""
        if not inliers.size:
            return [inliers]
        labels = _connected_labels(self.points[inliers] / self.ranges[inliers, None])
        order = np.argsort(-np.bincount(labels), kind="stable")
        return [inliers[labels == label] for label in order if (labels == label).any()]

    def feet(
        self, plane: NDArray[np.float64], axes: NDArray[np.float64], which: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return the points (n, 2) m, in two axes of a plane, where the rays of readings meet it.

        `plane` (4,) normal and offset in m; `axes` (3, 2), of the plane; `which` (n,) indices of
        the readings.
        """
        points = self.points[which]
        return np.asarray((points @ axes) * (plane[3] / (points @ plane[:3]))[:, None])

    def meeting(self, plane: NDArray[np.float64]) -> NDArray[np.intp]:
        """Indices of the readings whose rays meet a plane (4,) at no grazing angle."""
        return np.flatnonzero(self.points @ plane[:3] < -GRAZING * self.ranges)


def _connected_labels(directions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number of the region of neighbouring directions that each unit vector (n, 3) belongs to."""
    from scipy.ndimage import label

    cells = ((directions + 1.0) / DIRECTION_CELL).astype(np.intp) + 1
    side = int(2.0 / DIRECTION_CELL) + 3
    filled = np.zeros((side, side, side), dtype=bool)
    filled[tuple(cells.T)] = True
    parts, _ = label(filled, structure=np.ones((3, 3, 3), dtype=bool))
    return np.asarray(parts[tuple(cells.T)], dtype=np.int64)


def plane_axes(normal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors, (3,) each: with `normal` (3,) as the third a right-handed frame."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(helper, normal)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def convex_hull(places: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Corners (k, 2) of the hull of `places` (n, 2), counter-clockwise; None if on a line."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        # Qhull's order in the plane is counter-clockwise.
        return np.asarray(places[ConvexHull(places).vertices])
    except QhullError:
        return None


def in_polygon(
    polygon: NDArray[np.float64] | None, places: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Mark the `places` (n, 2) in a convex `polygon` (k, 2), counter-clockwise; none if None."""
    if polygon is None:
        return np.zeros(len(places), dtype=bool)
    along = np.roll(polygon, -1, axis=0) - polygon
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    return np.asarray((places @ outward.T <= (outward * polygon).sum(axis=1)).all(axis=1))


def angle_between_readings(cloud: RangeCloud, rng: np.random.Generator) -> float:
    """Median angle, rad, from a reading to the nearest other one."""
    return _nearest_angle(cloud.points / cloud.ranges[:, None], rng)


def _nearest_angle(directions: NDArray[np.float64], rng: np.random.Generator) -> float:
    """Median angle, rad, from a direction, of unit vectors (n, 3), to the nearest other one."""
    from scipy.spatial import cKDTree

    asked = directions[rng.permutation(len(directions))[:ANGLES_ASKED]]
    distances = cKDTree(directions).query(asked, k=2)[0][:, 1]
    return float(np.median(distances))


def angle_between_lines(points: NDArray[np.float64]) -> float:
    """Return the median angle, rad, from a reading to the nearest one that is not in its line.

    The line of a reading is towards its nearest neighbour, within 45°; of a camera, which reads as
    densely in all directions, this is about the angle between neighbours. Zero where all lies in
    one line.

    `points` (n, 3) m, none at the sensor, which is at the origin.
    """
    from scipy.spatial import cKDTree

    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    asked = directions[:: len(directions) // ANGLES_ASKED + 1]
    # Readings in one direction, as two returns of a beam are, have none between them.
    kept = np.unique(np.round(directions, 6), axis=0)
    distances, nearest = cKDTree(kept).query(asked, k=min(NEIGHBOURS, len(kept)))
    offsets = kept[nearest] - asked[:, None]
    apart = distances > 1e-5
    first = np.take_along_axis(offsets, apart.argmax(axis=1)[:, None, None], axis=1)[:, 0]
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
    along = np.abs(np.einsum("nki,ni->nk", offsets, first))
    across = apart & (along < np.sqrt(0.5) * distances)
    rows = np.flatnonzero(across.any(axis=1))
    return float(np.median(distances[rows, across[rows].argmax(axis=1)])) if rows.size else 0.0


def spacing_of(frame: NDArray[np.float32], rng: np.random.Generator) -> float:
    """Median angle, rad, between neighbouring readings of a frame (height, width, 3) m."""
    if frame.shape[0] == 1:
        points = frame[0][np.isfinite(frame[0, :, 2])].astype(np.float64)
        ranges = np.linalg.norm(points, axis=1)
        return _nearest_angle(points[ranges > 0.0] / ranges[ranges > 0.0, None], rng)
    rays = frame / np.linalg.norm(frame, axis=2, keepdims=True)
    angles = np.linalg.norm(np.diff(rays, axis=1), axis=2)
    finite = angles[np.isfinite(angles)]
    return float(np.median(finite)) if finite.size else 0.0
