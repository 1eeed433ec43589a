"""Kernel that fits one capsule to points of which only the side near the sensor is seen."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import njit

MAX_STEPS = 40
STILL = 1e-7
SURFACE_VARIANCE = 1e-8
OUTLIER = 2.0
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-9, 1e6
SMALLEST_RADIUS = 1e-3


@njit(nogil=True, cache=True, error_model="numpy")
def refine_capsule(
    points: Any, deviations: Any, lateral: float, start: Any
) -> tuple[Any, Any, Any]:
    """Fit (centre, half of the axis as a vector, radius), (7,), by Levenberg-Marquardt.

    The distance of a point p from the surface is |p - q| - r, q being the nearest place on the
    axis. Noise acts along the ray, so where the ray meets the surface at the angle θ to its normal
    a reading is off by cos θ of its range error and by sin θ of its lateral one. Residuals above
    `OUTLIER` count less, as in Charbonnier's loss.

    Parameters
    ----------
    points : (n, 3) m, the sensor at the origin
    deviations : (n,) m, of the readings along their rays
    lateral : rad, standard deviation of the readings' directions

    Returns
    -------
    parameters : (7,)
    normal : (7, 7), of the normal equations
    errors : (n,) residuals in standard deviations
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


@njit(nogil=True, cache=True, error_model="numpy")
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
