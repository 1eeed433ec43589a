"""Alternatives that can be installed or written instead of our perception, on the same frames.

Both are given the numbers of planes and balls and limits of the radius, which they cannot know.
"""

from __future__ import annotations

import random
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import MissingPeerError
from benchmarks.perception.score import Ball
from intuitive_physics_perception.environment.planes import DetectedPlane

PLANE_TOLERANCE = 0.03  # m from a plane within which a point belongs to it
SPHERE_TOLERANCE = 0.01  # m from a sphere's surface within which a point belongs to it
SMALLEST, LARGEST = 0.02, 0.10  # m, limits of a ball's radius
HYPOTHESES = 1000  # random planes or spheres of each RANSAC
MIN_POINTS = 30  # that a ball must have
CLUSTER_GAP = 0.04  # m between neighbours of a cluster, at most

Points = NDArray[np.float64]  # (n, 3) m, in the sensor's frame


class Peer(ABC):
    """Finds the balls of single frames."""

    name: str
    how: str

    @abstractmethod
    def balls(self, points: Points, planes: int, count: int) -> list[Ball]:
        """Return at most `count` balls in points (n, 3) m of a scene with that number of planes."""

    def timed(self, points: Points, planes: int, count: int) -> tuple[list[Ball], float]:
        """Return the balls and the processor's seconds it took to find them."""
        start = time.process_time()
        balls = self.balls(points, planes, count)
        return balls, time.process_time() - start


class Open3dAndPyransac(Peer):
    """Open3D takes the planes out and clusters, pyRANSAC-3D fits a sphere to each cluster."""

    name = "Open3D + pyRANSAC-3D"
    how = (
        f"`segment_plane` ({PLANE_TOLERANCE * 1e3:g} mm, 3 points, {HYPOTHESES} iterations) once "
        f"for each plane, `cluster_dbscan` ({CLUSTER_GAP * 1e3:g} mm), then "
        f"`pyransac3d.Sphere.fit` ({SPHERE_TOLERANCE * 1e3:g} mm, {HYPOTHESES} iterations) on the "
        "clusters of a ball's size; the spheres with most points are kept"
    )

    def __init__(self) -> None:
        try:
            import open3d
            import pyransac3d
        except ImportError as error:
            raise MissingPeerError(
                f"{error.name} is not installed: run `make bench-perception`, which brings it"
            ) from None
        self._open3d, self._sphere = open3d, pyransac3d.Sphere
        open3d.utility.random.seed(0)
        random.seed(0)

    def balls(self, points: Points, planes: int, count: int) -> list[Ball]:
        """See `Peer`."""
        cloud = self._open3d.geometry.PointCloud(self._open3d.utility.Vector3dVector(points))
        for _ in range(planes):
            _, inliers = cloud.segment_plane(PLANE_TOLERANCE, 3, HYPOTHESES)
            cloud = cloud.select_by_index(inliers, invert=True)
        rest, labels = np.asarray(cloud.points), np.asarray(cloud.cluster_dbscan(CLUSTER_GAP, 8))
        balls = []
        for label in range(labels.max(initial=-1) + 1):
            cluster = rest[labels == label]
            if len(cluster) < MIN_POINTS or np.ptp(cluster, axis=0).max() > 2.5 * LARGEST:
                continue
            fit = self._sphere().fit(cluster, SPHERE_TOLERANCE, HYPOTHESES)
            if SMALLEST <= fit.radius <= LARGEST:
                balls.append((len(fit.inliers), np.asarray(fit.center), float(fit.radius)))
        balls.sort(key=lambda ball: -ball[0])
        return [(center, radius) for _, center, radius in balls[:count]]


class FrameByFrame(Peer):
    """The paper's method (Sec. VI-C): planes known, all other points in one RANSAC."""

    name = "frame by frame, as the paper"
    how = (
        f"points within {PLANE_TOLERANCE * 1e3:g} mm of the planes that we found are removed; "
        f"RANSAC ({HYPOTHESES} spheres through 4 points, {SPHERE_TOLERANCE * 1e3:g} mm) over all "
        "others, least squares over the inliers; again for each further ball"
    )

    def __init__(self, planes: Sequence[DetectedPlane], rng: np.random.Generator) -> None:
        self._planes = planes
        self._rng = rng

    def balls(self, points: Points, planes: int, count: int) -> list[Ball]:
        """See `Peer`."""
        near = [np.abs(points @ p.normal - p.offset) < PLANE_TOLERANCE for p in self._planes]
        rest = points[~np.any(near, axis=0)]
        balls: list[Ball] = []
        while len(balls) < count and len(rest) >= MIN_POINTS:
            best = self._ransac(rest)
            if best is None:
                break
            balls.append(best)
            away = np.linalg.norm(rest - best[0], axis=1) > best[1] + 3.0 * SPHERE_TOLERANCE
            rest = rest[away]
        return balls

    def _ransac(self, points: Points) -> Ball | None:
        corners = points[self._rng.integers(len(points), size=(HYPOTHESES, 4))]
        edges = corners[:, 1:] - corners[:, :1]
        flat = np.abs(np.linalg.det(edges)) < 1e-12
        edges[flat] = np.eye(3)
        # |p - c|² is the same for all four corners: 2 (p_i - p_0) · (c - p_0) = |p_i - p_0|².
        offset = np.linalg.solve(2.0 * edges, np.square(edges).sum(axis=2)[:, :, None])[:, :, 0]
        radii = np.linalg.norm(offset, axis=1)
        good = ~flat & (radii > SMALLEST) & (radii < LARGEST)
        if not good.any():
            return None
        centers, radii = (corners[:, 0] + offset)[good], radii[good]
        counts = [
            (np.abs(np.linalg.norm(points - c, axis=1) - r) < SPHERE_TOLERANCE).sum()
            for c, r in zip(centers, radii, strict=True)
        ]
        best = int(np.argmax(counts))
        if counts[best] < MIN_POINTS:
            return None
        error = np.linalg.norm(points - centers[best], axis=1) - radii[best]
        return _least_squares(points[np.abs(error) < SPHERE_TOLERANCE])


def _least_squares(points: Points) -> Ball:
    """The sphere with |p|² = 2 c · p + r² - |c|² in least squares."""
    design = np.column_stack([2.0 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(design, np.square(points).sum(axis=1), rcond=None)[0]
    center = solution[:3]
    return center, float(np.sqrt(solution[3] + center @ center))
