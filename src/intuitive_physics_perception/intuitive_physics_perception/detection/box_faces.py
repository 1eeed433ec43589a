"""Two or three faces at right angles, which is what one can see of a box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

HYPOTHESES = 150
SCORED_POINTS = 200
FACE_SIGMAS = 2.5
SURFACE_DEVIATION = 0.001
UPRIGHT_COSINE = float(np.cos(np.radians(82.0)))
LEAST_FACE_POINTS, LEAST_FACE_PART = 25, 0.08
REFINEMENTS = 3


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


def find_faces(
    points: NDArray[np.float64], deviations: NDArray[np.float64], rng: np.random.Generator
) -> BoxFaces | None:
    """Return the faces that points (n, 3) lie on, None where there are not two at a right angle.

    Parameters
    ----------
    deviations : (n,) m, of the readings along their rays
    rng : decides which hypotheses are tried
    """
    normals = _face_normals(points, deviations, rng)
    return _refined(points, deviations, normals) if len(normals) > 1 else None


def _face_normals(
    points: NDArray[np.float64], deviations: NDArray[np.float64], rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Normals of up to three faces at about right angles, the one with most points first."""
    normals: list[NDArray[np.float64]] = []
    free = np.ones(len(points), dtype=bool)
    needed = max(LEAST_FACE_POINTS, int(LEAST_FACE_PART * len(points)))
    while len(normals) < 3 and free.sum() >= needed:
        plane = _best_plane(points[free], deviations[free], normals, rng)
        if plane is None:
            break
        near = np.abs(_scaled(points, deviations, plane)) < FACE_SIGMAS
        if (near & free).sum() < needed:
            break
        normals.append(plane[:3])
        free &= ~near
    return normals


def _best_plane(
    points: NDArray[np.float64],
    deviations: NDArray[np.float64],
    upright_to: Sequence[NDArray[np.float64]],
    rng: np.random.Generator,
) -> NDArray[np.float64] | None:
    """The plane (4,) with most points near, at about right angles to some normals."""
    triples = points[rng.integers(len(points), size=(HYPOTHESES, 3))]
    crossed = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(crossed, axis=1)
    good = lengths > 1e-9
    normals = crossed[good] / lengths[good, None]
    for other in upright_to:
        upright = np.abs(normals @ other) < UPRIGHT_COSINE
        normals, good = normals[upright], _narrowed(good, upright)
    if not len(normals):
        return None
    offsets = (normals * triples[good, 0]).sum(axis=1)
    normals[offsets > 0.0] *= -1.0
    planes = np.column_stack([normals, -np.abs(offsets)])
    every = max(len(points) // SCORED_POINTS, 1)
    # Other types of array would be compiled for while a frame waits.
    arrays = points[::every], deviations[::every], planes
    scores = _near_counts(*(np.ascontiguousarray(array, np.float64) for array in arrays))
    best = planes[int(scores.argmax())]
    inliers = points[np.abs(_scaled(points, deviations, best)) < FACE_SIGMAS]
    return _least_squares_plane(inliers) if len(inliers) >= 3 else None


def _narrowed(chosen: NDArray[np.bool_], kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of the chosen ones those that are kept."""
    narrowed = np.zeros_like(chosen)
    narrowed[np.flatnonzero(chosen)[kept]] = True
    return narrowed


def _least_squares_plane(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Plane (4,) through points (n, 3), its normal to the sensor's side."""
    middle = points.mean(axis=0)
    centred = points - middle
    normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    normal = normal if normal @ middle < 0.0 else -normal
    return np.append(normal, normal @ middle)


def _scaled(
    points: NDArray[np.float64], deviations: NDArray[np.float64], planes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distances from planes (..., 4), (..., n), in standard deviations; noise acts along rays."""
    along = planes[..., :3] @ points.T
    cosine = along / np.linalg.norm(points, axis=1)
    spread = np.sqrt(np.square(deviations * cosine) + SURFACE_DEVIATION**2)
    return (along - planes[..., 3:]) / spread


@njit(nogil=True, cache=True, error_model="numpy")
def _near_counts(points: Any, deviations: Any, planes: Any) -> Any:
    """How many points are near each plane (n, 4), as `_scaled` has it."""
    counts = np.zeros(planes.shape[0], dtype=np.int64)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        sway = deviations[i] * deviations[i] / (x * x + y * y + z * z)
        for k in range(planes.shape[0]):
            along = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z
            error = along - planes[k, 3]
            spread2 = sway * along * along + SURFACE_DEVIATION**2
            counts[k] += error * error < FACE_SIGMAS * FACE_SIGMAS * spread2
    return counts


def _refined(
    points: NDArray[np.float64],
    deviations: NDArray[np.float64],
    normals: Sequence[NDArray[np.float64]],
) -> BoxFaces | None:
    """Faces at exactly right angles that fit best: each point goes to its nearest face."""
    count = len(normals)
    stacked = np.column_stack(normals)
    if count == 3 and np.linalg.det(stacked) < 0.0:
        stacked = stacked[:, [1, 0, 2]]
    rotation = _right_angled(stacked, np.ones(count))
    offsets = np.array([np.quantile(points @ axis, 0.9) for axis in rotation.T[:count]])
    for _ in range(REFINEMENTS):
        planes = np.column_stack([rotation.T[:count], offsets])
        scaled = _scaled(points, deviations, planes)
        face = np.abs(scaled).argmin(axis=0)
        errors = scaled[face, np.arange(len(points))]
        face[np.abs(errors) > FACE_SIGMAS] = -1
        own = [points[face == k] for k in range(count)]
        if min(len(part) for part in own) < LEAST_FACE_POINTS:
            return None
        fitted = [_least_squares_plane(part) for part in own]
        weights = np.array([float(len(part)) for part in own])
        rotation = _right_angled(np.column_stack([plane[:3] for plane in fitted]), weights)
        offsets = np.array(
            [float(np.median(part @ axis)) for part, axis in zip(own, rotation.T, strict=False)]
        )
    return BoxFaces(rotation, offsets, face, errors)


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
