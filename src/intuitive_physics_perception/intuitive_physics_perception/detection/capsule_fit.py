"""Fit a capsule to readings of which only the side near the sensor is seen."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry, allocating_kernel
from intuitive_physics.shapes import Capsule
from intuitive_physics_perception.detection.detections import DetectedSolid
from intuitive_physics_perception.detection.sphere_fit import SURFACE_VARIANCE
from intuitive_physics_perception.environment.planes import plane_axes

CAPSULE_SIGMAS = 3.0
"""Standard deviations from a capsule within which a reading is on it."""

CAPSULE_INLIERS = 0.93
"""Part of the readings that must lie on a capsule."""

CAPSULE_LENGTH = 0.4
"""Smallest length of a capsule's cylinder, in radii."""

CAP_READINGS = 5
"""Smallest number of readings on each cap of a capsule."""

CAPSULE_END_UNCERTAINTY = 0.1
"""Standard deviation of a capsule's end at most, in half its overall length: an end that is hidden
could be anywhere."""

CAPSULE_ARC = 100.0
"""Arc of the cylinder that readings must cover, so that they determine its radius, degrees."""

MAX_STEPS = 40
"""Levenberg-Marquardt steps at most: numerical."""

STILL = 1e-7
"""Change of a parameter in m below which the fit has converged: numerical."""

OUTLIER = 2.0
"""Residual in standard deviations above which Charbonnier's loss grows linearly. Set by hand."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-9, 1e6
"""Levenberg-Marquardt damping at first, at least and at most, a factor: numerical."""

SMALLEST_RADIUS = 1e-3
"""Radius in m that no step goes below: numerical."""


def fit_capsule(
    points: NDArray[np.float64], deviations: NDArray[np.float64], lateral: float
) -> DetectedSolid | None:
    """Return the capsule on whose surface the points lie, None where they lie on none.

    `points` (n, 3) m, the sensor at the origin; `deviations` (n,) m, of the readings along their
    rays; `lateral` in rad, standard deviation of the readings' directions.
    """
    parameters, normal, errors = refine_capsule(points, deviations, lateral, _first_guess(points))
    if not _is_capsule(points, parameters, errors):
        return None
    misfit = float(np.mean(np.square(errors)))
    covariance = _covariance(normal, misfit)
    if covariance is None or not _ends_are_known(parameters, covariance):
        return None
    half = float(np.linalg.norm(parameters[3:6]))
    axis = parameters[3:6] / half
    first, second = plane_axes(axis)
    turn = np.cross(axis, np.eye(3)).T / half
    rotation_covariance = turn @ covariance[3:6, 3:6] @ turn.T + np.pi**2 * np.outer(axis, axis)
    return DetectedSolid(
        shape=Capsule(float(parameters[6]), 2.0 * half),
        center=parameters[:3],
        rotation=np.column_stack([first, second, axis]),
        position_covariance=covariance[:3, :3],
        rotation_covariance=rotation_covariance,
        size_variance=float(covariance[6, 6]),
        points=len(points),
        misfit=misfit,
    )


def _covariance(normal: NDArray[np.float64], misfit: float) -> NDArray[np.float64] | None:
    """(7, 7) of the parameters, None where the readings do not determine them."""
    try:
        return np.asarray(np.linalg.inv(normal) * max(misfit, 1.0))
    except np.linalg.LinAlgError:
        return None


def _ends_are_known(parameters: NDArray[np.float64], covariance: NDArray[np.float64]) -> bool:
    """Whether it is known where both ends are: one that is hidden could be anywhere."""
    half = float(np.linalg.norm(parameters[3:6]))
    axis = parameters[3:6] / half
    limit = CAPSULE_END_UNCERTAINTY * (half + parameters[6])
    for side in (-1.0, 1.0):
        end = np.concatenate([axis, side * axis, [0.0]])
        if not end @ covariance @ end < limit**2:
            return False
    return True


def _first_guess(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """First parameters, from the extents along the cluster's long axis and across it in view."""
    middle = points.mean(axis=0)
    view = middle / np.linalg.norm(middle)
    axis = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    across = np.cross(axis, view)
    across /= max(float(np.linalg.norm(across)), 1e-9)
    radius = 0.5 * float(np.ptp((points - middle) @ across))
    low, high = np.quantile((points - middle) @ axis, [0.01, 0.99])
    half = max(0.5 * float(high - low) - radius, 0.2 * radius)
    # Points on the near side lie about π/4 of the radius before the axis.
    toward = view - (view @ axis) * axis
    center = middle + 0.5 * (low + high) * axis + 0.785 * radius * toward
    return np.concatenate([center, half * axis, [radius]])


def _is_capsule(
    points: NDArray[np.float64], parameters: NDArray[np.float64], errors: NDArray[np.float64]
) -> bool:
    """Whether points lie on it, on both caps, and round enough of it to determine its radius."""
    center, half, radius = parameters[:3], parameters[3:6], float(parameters[6])
    length = 2.0 * float(np.linalg.norm(half))
    if radius <= 0.0 or length < CAPSULE_LENGTH * radius:
        return False
    on = np.mean(np.abs(errors) < CAPSULE_SIGMAS)
    if on < CAPSULE_INLIERS or center @ center < radius**2:
        return False
    # Along the axis, -1 to 1 from end to end.
    along = (points - center) @ half / max(float(half @ half), 1e-12)
    if min((along > 1.0).sum(), (along < -1.0).sum()) < CAP_READINGS:
        return False
    body = points[np.abs(along) <= 1.0] - center
    axis = half / np.linalg.norm(half)
    view = -center / np.linalg.norm(center)
    up = view - (view @ axis) * axis
    if np.linalg.norm(up) < 0.3 or len(body) < 10:
        return False
    up /= np.linalg.norm(up)
    angles = np.arctan2(body @ np.cross(axis, up), body @ up)
    return bool(np.ptp(np.quantile(angles, [0.03, 0.97])) > np.radians(CAPSULE_ARC))


@allocating_entry
def refine_capsule(
    points: Any, deviations: Any, lateral: float, start: Any
) -> tuple[Any, Any, Any]:
    """Fit (centre, half of the axis as a vector, radius), (7,), by Levenberg-Marquardt.

    The distance of a point p from the surface is |p - q| - r, q being the nearest place on the
    axis. Noise acts along the ray, so where the ray meets the surface at the angle θ to its normal
    a reading is off by cos θ of its range error and by sin θ of its lateral one. Residuals above
    `OUTLIER` count less, as in Charbonnier's loss.

    `points` (n, 3) m, the sensor at the origin; `deviations` (n,) m, of the readings along their
    rays; `lateral` in rad, standard deviation of the readings' directions. Returns `parameters`
    (7,); `normal` (7, 7), of the normal equations; `errors` (n,) residuals in standard deviations.
    """
    parameters = start.copy()
    normal, right = np.empty((7, 7)), np.empty(7)
    errors = np.empty(points.shape[0])
    loss = _equations(points, deviations, lateral, parameters, normal, right, errors)
    trial_normal, trial_right = np.empty((7, 7)), np.empty(7)
    trial_errors = np.empty(points.shape[0])
    damping = FIRST_DAMPING
    for _ in range(MAX_STEPS):
        damped = normal.copy()
        for a in range(7):
            damped[a, a] += damping * (normal[a, a] + 1.0)
        change = np.linalg.solve(damped, right)
        trial = parameters + change
        trial[6] = max(trial[6], SMALLEST_RADIUS)
        trial_loss = _equations(
            points, deviations, lateral, trial, trial_normal, trial_right, trial_errors
        )
        if trial_loss < loss:
            parameters, loss = trial, trial_loss
            normal[:], right[:], errors[:] = trial_normal, trial_right, trial_errors
            damping = max(0.2 * damping, LEAST_DAMPING)
            if np.abs(change).max() < STILL:
                break
        else:
            damping *= 5.0
            if damping > MOST_DAMPING or np.abs(change).max() < STILL:
                break
    return parameters, normal, errors


@allocating_kernel
def _equations(
    points: Any,
    deviations: Any,
    lateral: float,
    parameters: Any,
    normal: Any,
    right: Any,
    errors: Any,
) -> float:
    """Write the normal equations and the residuals; return the loss."""
    cx, cy, cz, hx, hy, hz, r = parameters
    length2 = max(hx * hx + hy * hy + hz * hz, 1e-12)
    normal[:] = 0.0
    right[:] = 0.0
    row = np.empty(7)
    loss = 0.0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        along = ((x - cx) * hx + (y - cy) * hy + (z - cz) * hz) / length2
        along = min(max(along, -1.0), 1.0)
        ux, uy, uz = x - cx - along * hx, y - cy - along * hy, z - cz - along * hz
        off = max(sqrt(ux * ux + uy * uy + uz * uz), 1e-9)
        ux, uy, uz = ux / off, uy / off, uz / off
        range2 = x * x + y * y + z * z
        cosine = min(max(-(ux * x + uy * y + uz * z) / sqrt(range2), 0.0), 1.0)
        cosine2 = cosine * cosine
        variance = deviations[i] * deviations[i]
        second = variance * (1.0 - cosine2) / r
        spread = sqrt(
            variance * cosine2
            + lateral * lateral * range2 * (1.0 - cosine2)
            + second * second
            + SURFACE_VARIANCE
        )
        error = (off - r) / spread
        errors[i] = error
        bent = sqrt(1.0 + (error / OUTLIER) ** 2)
        loss += 2.0 * OUTLIER * OUTLIER * (bent - 1.0)
        weight = 1.0 / (bent * spread * spread)
        row[0], row[1], row[2] = ux, uy, uz
        row[3], row[4], row[5] = along * ux, along * uy, along * uz
        row[6] = 1.0
        for a in range(7):
            right[a] += weight * row[a] * (off - r)
            for b in range(7):
                normal[a, b] += weight * row[a] * row[b]
    return loss
