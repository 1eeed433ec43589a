"""Fit a box to two or three of its faces, which is what one can see of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.shapes import Box
from intuitive_physics_perception.detection.box_faces import SURFACE_DEVIATION, BoxFaces, find_faces
from intuitive_physics_perception.detection.detected_solid import DetectedSolid
from intuitive_physics_perception.environment.planes import DetectedPlane

LEAST_ON_FACES = 0.88
LEAST_FILLED = 0.75
FACE_CELLS = 6
STANDING_GAP, STANDING_COSINE = 0.04, float(np.cos(np.radians(6.0)))


def fit_box(
    points: NDArray[np.float64],
    deviations: NDArray[np.float64],
    planes: Sequence[DetectedPlane],
    rng: np.random.Generator,
) -> DetectedSolid | None:
    """Return the box whose faces hold the points, None where there are not two at a right angle.

    One face alone does not tell how deep a box is. Readings at the foot of a box are taken for the
    plane it stands on, so a box that almost reaches one of `planes` reaches it.

    Parameters
    ----------
    points : (n, 3) m, the sensor at the origin
    deviations : (n,) m, of the readings along their rays
    planes : of the environment, in the sensor's frame
    rng : decides which hypotheses are tried
    """
    faces = find_faces(points, deviations, rng)
    if faces is None or np.mean(faces.face >= 0) < LEAST_ON_FACES:
        return None
    low, high = _bounds(points, faces)
    edges = high - low
    if (edges <= 0.0).any() or not _is_filled(points, faces, low, high):
        return None
    pitch = _pitch(points, faces, edges)
    low, high = _down_to_planes(faces, low, high, planes)
    edges = high - low
    center = faces.rotation @ (0.5 * (low + high))
    variance = (0.5 * pitch) ** 2
    seen = np.arange(3) < len(faces.offsets)
    # Along a normal the face is known well and only the far side depends on where edges are seen.
    across = faces.rotation @ np.diag(np.where(seen, 0.25, 0.5) * variance) @ faces.rotation.T
    turn = (np.median(deviations) / edges.max()) ** 2 * 12.0 / max(len(points), 1) + 1e-4
    return DetectedSolid(
        Box((float(edges[0]), float(edges[1]), float(edges[2]))),
        center,
        faces.rotation,
        across + SURFACE_DEVIATION**2 * np.eye(3),
        turn * np.eye(3),
        variance + SURFACE_DEVIATION**2,
        len(points),
        float(np.mean(np.square(faces.errors[faces.face >= 0]))),
    )


def _bounds(
    points: NDArray[np.float64], faces: BoxFaces
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the box begins and ends along its axes, (3,) and (3,) m."""
    low, high = np.empty(3), np.empty(3)
    for axis in range(3):
        others = (faces.face >= 0) & (faces.face != axis)
        low[axis], high[axis] = _ends(points[others] @ faces.rotation[:, axis])
        if axis < len(faces.offsets):
            high[axis] = faces.offsets[axis]
    return low, high


def _ends(values: NDArray[np.float64]) -> tuple[float, float]:
    """Where a row of readings begins and ends: where their density falls to a half."""
    rough = np.quantile(values, [0.02, 0.98])
    width = max(float(rough[1] - rough[0]), 1e-6)
    bins = int(np.clip(len(values) // 12, 8, 40))
    edges = np.linspace(rough[0] - 0.15 * width, rough[1] + 0.15 * width, bins + 1)
    counts = np.histogram(values, edges)[0]
    half = 0.5 * float(np.median(counts[counts > 0.3 * counts.max()]))
    full = np.flatnonzero(counts >= half)
    first, last, step = int(full[0]), int(full[-1]), float(edges[1] - edges[0])
    # What spills over into the next bin tells how far into it the row reaches.
    before = counts[first - 1] if first > 0 else 0
    after = counts[last + 1] if last + 1 < bins else 0
    low = edges[first] - step * min(float(before) / (2.0 * half), 1.0)
    high = edges[last + 1] + step * min(float(after) / (2.0 * half), 1.0)
    if counts[first] < 2.0 * half and before == 0:
        low = edges[first + 1] - step * float(counts[first]) / (2.0 * half)
    if counts[last] < 2.0 * half and after == 0:
        high = edges[last] + step * float(counts[last]) / (2.0 * half)
    return float(low), float(high)


def _is_filled(
    points: NDArray[np.float64],
    faces: BoxFaces,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> bool:
    """Whether readings lie all over each face, and none before one: a corner of a room has them."""
    local = points @ faces.rotation
    edges = high - low
    for k in range(len(faces.offsets)):
        first, second = [axis for axis in range(3) if axis != k]
        on = local[faces.face == k]
        inside = (on - low) / edges
        cells = np.floor(FACE_CELLS * inside[:, [first, second]]).astype(np.intp)
        within = ((cells >= 0) & (cells < FACE_CELLS)).all(axis=1)
        filled = len(np.unique(cells[within], axis=0)) / FACE_CELLS**2
        if filled < LEAST_FILLED or within.mean() < LEAST_FILLED:
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
    for axis in range(3):
        direction = faces.rotation[:, axis]
        for plane in planes:
            cosine = float(direction @ plane.normal)
            side = 0 if cosine > 0.0 else 1
            if abs(cosine) < STANDING_COSINE or (side == 1 and axis < len(faces.offsets)):
                continue
            foot = middle.copy()
            foot[axis] = ends[side, axis]
            gap = float(plane.normal @ (faces.rotation @ foot)) - plane.offset
            if abs(gap) < STANDING_GAP:
                ends[side, axis] -= gap / cosine
    return ends[0], ends[1]
