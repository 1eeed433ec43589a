"""Where a sensor with fixed pixels reads a direction, and which direction a pixel reads."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import kernel

TERMS = 10
"""Polynomials up to the third degree in two slopes: a pinhole camera needs three, and what is left
of the distortion of rectified images is in the others."""

FITTED_READINGS = 2000
"""Readings, evenly over a frame, that the polynomials are fitted to: bounds the time."""

LARGEST_ERROR = 0.5
"""Pixels, root mean square, by which the polynomials may miss: the nearest pixel is found."""

NEWTON_STEPS = 4
"""Steps to the slopes that a pixel reads: numerical, the polynomials are nearly linear."""


def fitted_lens(points: NDArray[np.float32]) -> NDArray[np.float64] | None:
    """Return row and column as polynomials (10, 2) in the slopes x/z and y/z of a ray; None where
    pixels are no such function of them, as those of a scanner that turns.

    `points` (height, width, 3) m of a frame, NaN where nothing was read.
    """
    rows, columns = np.nonzero(points[:, :, 2] > 0.0)
    every = 1 + len(rows) // FITTED_READINGS
    rows, columns = rows[::every], columns[::every]
    if len(rows) < 10 * TERMS:
        return None
    x, y, z = points[rows, columns].T.astype(np.float64)
    basis = _terms(x / z, y / z).T
    pixels = np.stack([rows, columns], axis=1).astype(np.float64)
    lens, *_ = np.linalg.lstsq(basis, pixels, rcond=1e-9)
    error2 = np.square(basis @ lens - pixels).sum(axis=1).mean()
    return np.ascontiguousarray(lens) if error2 < LARGEST_ERROR**2 else None


def slopes_of(
    pixels: NDArray[np.float64], lens: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the slopes (n, 2) of the rays of pixels (n, 2), rows and columns; and there the
    derivatives (n, 2, 2) of row and column with respect to them. By Newton's steps.

    `lens` (10, 2) as of `fitted_lens`.
    """
    linear = lens[1:3].T
    slopes = (pixels - lens[0]) @ np.linalg.inv(linear).T
    jacobian = np.broadcast_to(linear, (len(pixels), 2, 2))
    for _ in range(NEWTON_STEPS):
        a, b = slopes.T
        one, none = np.ones_like(a), np.zeros_like(a)
        by_a = np.stack([none, one, none, 2 * a, b, none, 3 * a * a, 2 * a * b, b * b, none])
        by_b = np.stack([none, none, one, none, a, 2 * b, none, a * a, 2 * a * b, 3 * b * b])
        jacobian = np.stack([by_a.T @ lens, by_b.T @ lens], axis=2)
        miss = pixels - _terms(a, b).T @ lens
        slopes = slopes + np.linalg.solve(jacobian, miss[:, :, None])[:, :, 0]
    return slopes, jacobian


def _terms(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Terms (10, n) of polynomials up to the third degree in slopes (n,)."""
    one = np.ones_like(a)
    return np.stack([one, a, b, a * a, a * b, b * b, a**3, a * a * b, a * b * b, b**3])


@kernel
def pixel_of(x: Any, y: Any, z: Any, lens: Any) -> tuple[Any, Any]:
    """Row and column, between pixels, of a point before the sensor; `lens` as of `fitted_lens`."""
    a, b = x / z, y / z
    aa, ab, bb = a * a, a * b, b * b
    row = lens[0, 0] + a * lens[1, 0] + b * lens[2, 0]
    row += aa * lens[3, 0] + ab * lens[4, 0] + bb * lens[5, 0]
    row += aa * (a * lens[6, 0] + b * lens[7, 0]) + bb * (a * lens[8, 0] + b * lens[9, 0])
    column = lens[0, 1] + a * lens[1, 1] + b * lens[2, 1]
    column += aa * lens[3, 1] + ab * lens[4, 1] + bb * lens[5, 1]
    column += aa * (a * lens[6, 1] + b * lens[7, 1]) + bb * (a * lens[8, 1] + b * lens[9, 1])
    return row, column
