"""Fit a box to two or three of its faces at right angles, which is what one can see of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.shapes import Box
from intuitive_physics_perception.detection.detections import DetectedSolid
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.planes import (
    DetectedPlane,
    least_squares_plane,
    planes_through,
)
from intuitive_physics_perception.environment.range_cloud import RangeCloud

BOX_INLIERS = 0.88
"""Part of the readings that must lie on the faces of a box."""

FACE_HYPOTHESES = 150
"""Random planes that are tried for a face."""

FACE_SCORED_POINTS = 200
"""Points that these are scored on."""

FACE_SIGMAS = 2.5
"""Standard deviations from a face within which a reading is on it."""

SURFACE_DEVIATION = 0.001
"""Unevenness of a surface, as a standard deviation; it biases the centre in every frame, m."""

FACE_ANGLE = 82.0
"""Smallest angle between the normals of two faces, degrees."""

FACE_READINGS = 25
"""Smallest number of readings on a face."""

FACE_PART = 0.08
"""Smallest part of the readings on a face."""

FACE_REFINEMENTS = 3
"""Rounds of assigning readings to faces and fitting."""

FACE_CELLS = 6
"""Cells along each side of a face, counted to see it filled."""

FACE_FILLED = 0.75
"""Part of these cells that must have readings, and of readings in them."""

BEYOND_ENDS = 0.01
"""Part of the readings of a face that may lie beyond each of its ends: flying pixels and edges that
have grown. Set by hand."""

STANDING_GAP = 0.04
"""Gap to a plane up to which a box stands on it, m."""

STANDING_ANGLE = 6.0
"""Largest angle between a box's axis and the plane's normal, degrees."""


def cloud_of_box(points: NDArray[np.float64], noise: RangeNoise) -> RangeCloud:
    """Return the cloud of points (n, 3) m, to be compared with faces of a box."""
    return RangeCloud(points, noise, FACE_SIGMAS * SURFACE_DEVIATION, FACE_SIGMAS)


def fit_box(
    cloud: RangeCloud, planes: Sequence[DetectedPlane], rng: np.random.Generator
) -> DetectedSolid | None:
    """Return the box whose faces hold the points of a cloud, None where there are not two at a
    right angle.

    One face alone does not determine the depth of a box. Readings at the foot of a box are taken
    for the plane it stands on, so a box that almost reaches one of `planes` reaches it.
    """
    points = cloud.points
    faces = find_faces(cloud, rng)
    if faces is None or np.mean(faces.face >= 0) < BOX_INLIERS:
        return None
    low, high = _bounds(points, faces)
    edges = high - low
    if (edges <= 0.0).any() or not _is_filled(points, faces, low, high):
        return None
    pitch = _pitch(points, faces, edges)
    low, high = _down_to_planes(faces, low, high, planes)
    edges = high - low
    if (edges <= 0.0).any():
        # A thin thing that lies beyond the plane: no box stands there.
        return None
    center = faces.rotation @ (0.5 * (low + high))
    variance = (0.5 * pitch) ** 2
    has_face = np.arange(3) < len(faces.offsets)
    # Along a normal the face is known well and only the far side depends on where edges are seen.
    across = faces.rotation @ np.diag(np.where(has_face, 0.25, 0.5) * variance) @ faces.rotation.T
    turn = (np.median(cloud.deviations) / edges.max()) ** 2 * 12.0 / max(len(points), 1) + 1e-4
    return DetectedSolid(
        shape=Box((float(edges[0]), float(edges[1]), float(edges[2]))),
        center=center,
        rotation=faces.rotation,
        position_covariance=across,
        rotation_covariance=turn * np.eye(3),
        size_variance=variance + SURFACE_DEVIATION**2,
        points=len(points),
        misfit=float(np.mean(np.square(faces.errors[faces.face >= 0]))),
    )


def _bounds(
    points: NDArray[np.float64], faces: BoxFaces
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ends of the box along its axes, (3,) and (3,) m."""
    low, high = np.empty(3), np.empty(3)
    for axis in range(3):
        others = (faces.face >= 0) & (faces.face != axis)
        low[axis], high[axis] = ends_of_row(points[others] @ faces.rotation[:, axis])
        if axis < len(faces.offsets):
            high[axis] = faces.offsets[axis]
    return low, high


def ends_of_row(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of an even row of values (n,), all but a few of which lie in it.

    The quantiles q and 1 - q of an even row are 1 - 2 q of its length apart.
    """
    low, high = np.quantile(values, [BEYOND_ENDS, 1.0 - BEYOND_ENDS])
    beyond = BEYOND_ENDS / (1.0 - 2.0 * BEYOND_ENDS) * (high - low)
    return float(low - beyond), float(high + beyond)


def _is_filled(
    points: NDArray[np.float64],
    faces: BoxFaces,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> bool:
    """Whether readings lie all over each face, and none before one: a corner of a room has them."""
    local = points @ faces.rotation
    edges, cells_along = high - low, FACE_CELLS
    for k in range(len(faces.offsets)):
        first, second = [axis for axis in range(3) if axis != k]
        on = local[faces.face == k]
        inside = (on - low) / edges
        cells = np.floor(cells_along * inside[:, [first, second]]).astype(np.intp)
        within = ((cells >= 0) & (cells < cells_along)).all(axis=1)
        filled = len(np.unique(cells[within], axis=0)) / cells_along**2
        if min(filled, float(within.mean())) < FACE_FILLED:
            return False
    return True


def _pitch(points: NDArray[np.float64], faces: BoxFaces, edges: NDArray[np.float64]) -> float:
    """Spacing of readings in m: the area that is seen, divided among them."""
    view = points.mean(axis=0)
    view /= np.linalg.norm(view)
    areas = np.array([edges[1] * edges[2], edges[0] * edges[2], edges[0] * edges[1]])
    cosines = np.abs(faces.rotation.T @ view)
    count = len(faces.offsets)
    return float(np.sqrt((areas * cosines)[:count].sum() / len(points)))


def _down_to_planes(
    faces: BoxFaces,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    planes: Sequence[DetectedPlane],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Let sides that are not seen and almost reach a plane reach it."""
    ends, middle = np.stack([low, high]), 0.5 * (low + high)
    smallest_cosine = float(np.cos(np.radians(STANDING_ANGLE)))
    for axis in range(3):
        direction = faces.rotation[:, axis]
        for plane in planes:
            cosine = float(direction @ plane.normal)
            side = 0 if cosine > 0.0 else 1
            if abs(cosine) < smallest_cosine or (side == 1 and axis < len(faces.offsets)):
                continue
            foot = middle.copy()
            foot[axis] = ends[side, axis]
            gap = float(plane.normal @ (faces.rotation @ foot)) - plane.offset
            if abs(gap) < STANDING_GAP:
                ends[side, axis] -= gap / cosine
    return ends[0], ends[1]


@dataclass(frozen=True, eq=False)
class BoxFaces:
    """Two or three faces at right angles.

    Parameters
    ----------
    rotation : (3, 3), its columns the box's axes, the first two or three normals of faces seen
    offsets : (2,) or (3,) m, normal · p = offset on a face
    face : (n,) which face each point lies on; -1 for none
    errors : (n,) distance to that face in standard deviations
    """

    rotation: NDArray[np.float64]
    offsets: NDArray[np.float64]
    face: NDArray[np.intp]
    errors: NDArray[np.float64]


def find_faces(cloud: RangeCloud, rng: np.random.Generator) -> BoxFaces | None:
    """Return the faces that the points lie on, None where there are not two at a right angle."""
    normals = _face_normals(cloud, rng)
    return _refined(cloud, normals) if len(normals) > 1 else None


def _face_normals(cloud: RangeCloud, rng: np.random.Generator) -> list[NDArray[np.float64]]:
    """Normals of up to three faces at about right angles, the one with most points first."""
    normals: list[NDArray[np.float64]] = []
    free = np.arange(len(cloud.points))
    needed = max(FACE_READINGS, int(FACE_PART * len(free)))
    while len(normals) < 3 and free.size >= needed:
        plane = _best_plane(cloud, free, normals, rng)
        if plane is None:
            break
        near = cloud.near(plane, free)
        if near.sum() < needed:
            break
        normals.append(plane[:3])
        free = free[~near]
    return normals


def _best_plane(
    cloud: RangeCloud,
    free: NDArray[np.intp],
    upright_to: Sequence[NDArray[np.float64]],
    rng: np.random.Generator,
) -> NDArray[np.float64] | None:
    """The plane (4,) with most free points near, at about right angles to some normals."""
    planes = planes_through(cloud.points[free[rng.integers(free.size, size=(FACE_HYPOTHESES, 3))]])
    largest_cosine = float(np.cos(np.radians(FACE_ANGLE)))
    for other in upright_to:
        planes = planes[np.abs(planes[:, :3] @ other) < largest_cosine]
    if not len(planes):
        return None
    scored = free[:: max(free.size // FACE_SCORED_POINTS, 1)]
    best = planes[int(cloud.near(planes, scored).sum(axis=1).argmax())]
    inliers = cloud.points[free[cloud.near(best, free)]]
    return least_squares_plane(inliers) if len(inliers) >= 3 else None


def _refined(cloud: RangeCloud, normals: Sequence[NDArray[np.float64]]) -> BoxFaces | None:
    """Faces at exactly right angles that fit best: each point goes to its nearest face."""
    points, count = cloud.points, len(normals)
    stacked = np.column_stack(normals)
    if count == 3 and np.linalg.det(stacked) < 0.0:
        stacked = stacked[:, [1, 0, 2]]
    rotation = _right_angled(stacked, np.ones(count))
    offsets = np.array([np.quantile(points @ axis, 0.9) for axis in rotation.T[:count]])
    for _ in range(FACE_REFINEMENTS):
        scaled = cloud.scaled_distances(np.column_stack([rotation.T[:count], offsets]))
        face = np.abs(scaled).argmin(axis=0)
        errors = scaled[face, np.arange(len(points))]
        face[np.abs(errors) > 1.0] = -1
        parts = [points[face == k] for k in range(count)]
        if min(len(part) for part in parts) < FACE_READINGS:
            return None
        fitted = [least_squares_plane(part) for part in parts]
        weights = np.array([float(len(part)) for part in parts])
        rotation = _right_angled(np.column_stack([plane[:3] for plane in fitted]), weights)
        offsets = np.array(
            [float(np.median(part @ axis)) for part, axis in zip(parts, rotation.T, strict=False)]
        )
    return BoxFaces(rotation, offsets, face, FACE_SIGMAS * errors)


def _right_angled(
    normals: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The frame (3, 3) whose first axes are nearest to normals (3, 2 or 3), right-handed as they
    are."""
    if normals.shape[1] == 2:
        third = np.cross(normals[:, 0], normals[:, 1])
        normals = np.column_stack([normals, third])
        weights = np.append(weights, 1e-6 * weights.max())
    left, _, right = np.linalg.svd(normals * weights)
    return left @ right
