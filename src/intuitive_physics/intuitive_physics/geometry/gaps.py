"""Gaps between bodies: the distance of their surfaces, for whole arrays of poses at once.

A gap is the distance where bodies are apart, and zero or below where they overlap; then it does not
measure how deep. `closest_points` has the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere

SEARCH_STEPS = 40
"""Steps of the golden-section search along a capsule's axis, which leave 4e-9 of its length."""


@dataclass(frozen=True, eq=False)
class Body:
    """A shape at many poses.

    Parameters
    ----------
    shape : a Sphere, Box or Capsule
    positions : (…, 3) m
    orientations : (…, 4) unit quaternions (x, y, z, w)
    """

    shape: Shape
    positions: NDArray[np.float64]
    orientations: NDArray[np.float64]

    def axis(self, k: int) -> NDArray[np.float64]:
        """Return the body's k-th axis in the environment's frame, (…, 3)."""
        return self._rotations[..., k]

    @cached_property
    def _rotations(self) -> NDArray[np.float64]:
        return rotation_matrix(self.orientations)


def gap_to_plane(body: Body, plane: Plane) -> NDArray[np.float64]:
    """Return the gap between a body and a plane, (…), m.

    A sphere may touch the edge of a bounded plane; of a box or capsule only the point nearest to
    the plane counts. A body whose centre is behind a bounded plane does not touch it.
    """
    nearest, radius = _point_towards(body, -plane.normal)
    if plane.boundary is None:
        return plane.signed_distances(nearest) - radius
    gaps = _distance_to_sheet(nearest, plane, plane.boundary) - radius
    behind = plane.signed_distances(body.positions) < 0.0
    apart = np.linalg.norm(body.positions - nearest, axis=-1) + body.shape.bounding_radius
    return np.where(behind, apart, gaps)


def gap_between(a: Body, b: Body) -> NDArray[np.float64]:
    """Return the gap between two bodies at poses that broadcast against each other, (…), m.

    Boxes: the widest gap along the normals of their faces and across their edges, which is at
    most the distance and above zero exactly where they are apart (separating axis theorem).
    """
    if isinstance(a.shape, Box):
        if isinstance(b.shape, Box):
            return _gap_of_boxes(a.positions - b.positions, _half_edges(a), _half_edges(b))
        a, b = b, a
    middle, half, radius = _segment(a)
    if isinstance(b.shape, Box):
        return _distance_of_segment_to_box(middle - b.positions, half, _half_edges(b)) - radius
    other_middle, other_half, other_radius = _segment(b)
    apart = _distance_of_segments(middle, half, other_middle, other_half)
    return apart - radius - other_radius


def _segment(body: Body) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return middle and half length as vectors, (…, 3) m, and the radius around a core segment."""
    match body.shape:
        case Sphere():
            return body.positions, np.zeros(3), body.shape.radius
        case Capsule():
            return body.positions, 0.5 * body.shape.length * body.axis(2), body.shape.radius
    raise InvalidInputError(f"shape is {body.shape!r}; expected a Sphere, Box or Capsule")


def _point_towards(body: Body, direction: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the point of a body's core farthest in a direction, and the radius around the core."""
    if isinstance(body.shape, Box):
        halves = _half_edges(body)
        corner = sum((np.sign(half @ direction)[..., None] * half for half in halves), np.zeros(3))
        return body.positions + corner, 0.0
    middle, half, radius = _segment(body)
    return middle + np.sign(half @ direction)[..., None] * half, radius


def _distance_to_sheet(
    points: NDArray[np.float64], plane: Plane, corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance of points (…, 3) from a bounded plane; below zero behind it."""
    height = plane.signed_distances(points)
    edges = np.roll(corners, -1, axis=0) - corners
    outward = np.cross(edges, plane.normal)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    beyond = ((points[..., None, :] - corners) * outward).sum(axis=-1)
    to_edges = np.min(
        [
            np.linalg.norm(points - _nearest_on_segment(points, corner, edge), axis=-1)
            for corner, edge in zip(corners, edges, strict=True)
        ],
        axis=0,
    )
    return np.where((beyond <= 0.0).all(axis=-1), height, to_edges)


def _nearest_on_segment(
    points: NDArray[np.float64], start: NDArray[np.float64], along: NDArray[np.float64]
) -> NDArray[np.float64]:
    part = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return start + part[..., None] * along


def _distance_of_segments(
    p: NDArray[np.float64],
    u: NDArray[np.float64],
    q: NDArray[np.float64],
    v: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Distance between p + s u and q + t v, s and t from -1 to 1 (Ericson 2005, sec. 5.1.9)."""
    w = p - q
    a, b, c = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    d, e = (u * w).sum(-1), (v * w).sum(-1)
    tiny = 1e-300
    across = a * c - b * b
    s = np.clip((b * e - c * d) / np.maximum(across, tiny), -1.0, 1.0)
    t = np.clip((b * s + e) / np.maximum(c, tiny), -1.0, 1.0)
    s = np.clip((b * t - d) / np.maximum(a, tiny), -1.0, 1.0)
    t = np.clip((b * s + e) / np.maximum(c, tiny), -1.0, 1.0)
    return np.asarray(np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1))


def _distance_of_segment_to_box(
    middle: NDArray[np.float64], half: NDArray[np.float64], half_edges: list[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Distance of middle + s half, s from -1 to 1, from a box about 0, by search: convex in s."""

    def distance(s: NDArray[np.float64]) -> NDArray[np.float64]:
        return _distance_to_box(middle + s[..., None] * half, half_edges)

    shape = np.broadcast_shapes(middle.shape, half.shape, half_edges[0].shape)[:-1]
    low, high = np.full(shape, -1.0), np.full(shape, 1.0)
    if not np.any(half):
        return distance(0.5 * (low + high))
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(SEARCH_STEPS):
        left, right = high - golden * (high - low), low + golden * (high - low)
        nearer = distance(left) < distance(right)
        low, high = np.where(nearer, low, left), np.where(nearer, right, high)
    return distance(0.5 * (low + high))


def _distance_to_box(
    points: NDArray[np.float64], half_edges: list[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Distance of points (…, 3) from a solid box about 0, zero inside."""
    squares = np.zeros(np.broadcast_shapes(points.shape, half_edges[0].shape)[:-1])
    for half in half_edges:
        length = np.linalg.norm(half, axis=-1)
        beyond = np.abs((points * half).sum(axis=-1)) / length - length
        squares += np.maximum(beyond, 0.0) ** 2
    return np.sqrt(squares)


def _gap_of_boxes(
    apart: NDArray[np.float64],
    first: list[NDArray[np.float64]],
    second: list[NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Widest gap of two boxes whose centres are `apart`, by their half edges as vectors (…, 3)."""
    shape = np.broadcast_shapes(apart.shape, first[0].shape, second[0].shape)[:-1]
    widest = np.full(shape, -np.inf)
    scales = [np.linalg.norm(half, axis=-1, keepdims=True) for half in (*first, *second)]
    units = [half / scale for half, scale in zip((*first, *second), scales, strict=True)]
    for axis in [*units, *(np.cross(x, y) for x in units[:3] for y in units[3:])]:
        length = np.linalg.norm(axis, axis=-1)
        reach = sum(np.abs((half * axis).sum(axis=-1)) for half in (*first, *second))
        gap = (np.abs((apart * axis).sum(axis=-1)) - reach) / np.maximum(length, 1e-300)
        # Parallel edges have no direction across them: the faces' normals decide.
        widest = np.where(length > 1e-6, np.maximum(widest, gap), widest)
    return widest


def _half_edges(body: Body) -> list[NDArray[np.float64]]:
    """Half the edges of a box as vectors (…, 3) in the environment's frame."""
    match body.shape:
        case Box():
            return [0.5 * edge * body.axis(k) for k, edge in enumerate(body.shape.edge_lengths)]
    raise InvalidInputError(f"shape is {body.shape!r}; expected a Box")
