"""Where a sensor with fixed pixels reads a direction."""

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
    a, b = x / z, y / z
    basis = np.stack(
        [np.ones_like(a), a, b, a * a, a * b, b * b, a**3, a * a * b, a * b * b, b**3], axis=1
    )
    pixels = np.stack([rows, columns], axis=1).astype(np.float64)
    lens, *_ = np.linalg.lstsq(basis, pixels, rcond=1e-9)
    error2 = np.square(basis @ lens - pixels).sum(axis=1).mean()
    return np.ascontiguousarray(lens) if error2 < LARGEST_ERROR**2 else None


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
