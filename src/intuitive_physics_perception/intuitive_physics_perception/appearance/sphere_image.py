"""The image of a sphere's surface: brightness by direction, less light and shade."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.appearance.registration import (
    RIM,
    TAPER,
)
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.environment.noise import neighbour_products

GRID_CELLS = 32
"""Cells along each edge of the image of a sphere."""

SAMPLES = 2
"""Samples along each edge of a cell, whose mean is its brightness."""

MIN_READINGS = 90
"""Smallest number of readings with a colour in an image of a sphere."""

ON_SURFACE = 1.15
"""Radii from a sphere's centre beyond which a reading shows something else."""

DARK = 8.0
"""Levels of 255 added to the brightness before its logarithm is taken, so that noise of what is
black stays small."""

LENS_READINGS = 300
"""Readings, about, from which rows and columns are found: of a camera they are exact."""

ROBUST_STEPS = 4
"""Fits of the shading, each with less weight of what is off in the one before."""

LAGS = 5
"""Cells to each side over which an image is compared with itself."""

LEAST_NOISE = 0.3
"""Levels of 255, of rounding."""

MAD_OF_SECOND_DIFFERENCE = 0.6745 * np.sqrt(6.0)
"""Median of |a - 2 b + c| of normal deviates of variance one."""


@dataclass(frozen=True, eq=False)
class SphereImage:
    """Image of a sphere in one frame.

    Parameters
    ----------
    values : (g, g), logarithms of brightness less that of the shading, NaN where nothing was seen
    contrast : standard deviation of the surface in those of the noise of a pixel
    axes : (3, 3), right, down and towards the sensor, as rows
    place_deviation : rad, by which the whole image may be turned, as the centre is off
    """

    values: NDArray[np.float64]
    contrast: float
    axes: NDArray[np.float64]
    place_deviation: float

    @cached_property
    def area(self) -> float:
        """Cells whose values go together, Σ ρ(lag)²."""
        seen = np.isfinite(self.values)
        products = neighbour_products(np.where(seen, self.values, 0.0), LAGS)
        counts = neighbour_products(seen.astype(np.float64), LAGS)
        correlations = products / np.maximum(counts, 1.0) / np.nanvar(self.values)
        return max(float(np.square(correlations).sum()), 1.0)

    @cached_property
    def coarse(self) -> NDArray[np.float64]:
        """Means (g / 2, g / 2) of four values each."""
        size = self.values.shape[0] // 2
        parts = self.values[: 2 * size, : 2 * size].reshape(size, 2, size, 2)
        return np.asarray(parts.mean(axis=(1, 3)))

    def moved(self, rotation: NDArray[np.float64]) -> SphereImage:
        """Return it in another frame, n_other = rotation (3, 3) n."""
        return replace(self, axes=self.axes @ rotation.T)


def pitch_of(cells: int) -> float:
    """Return the pitch of a grid that holds all directions that are compared."""
    return 2.0 * float(np.sqrt(1.0 - RIM**2)) / (cells - 1)


def sphere_image(
    sphere: DetectedSphere,
    pixels: NDArray[np.int64],
    points: NDArray[np.float32],
    colors: NDArray[np.uint8],
) -> SphereImage | None:
    """Return the image of a sphere, None where too little of it is seen.

    `sphere`: in the frame of the points, the sensor at the origin; `pixels` (n,) indices of
    readings on it; `points` (height, width, 3) m and `colors` (height, width, 3), of a frame
    with fixed pixels.
    """
    if len(pixels) < MIN_READINGS:
        return None
    rows, columns = np.divmod(pixels, points.shape[1])
    top, left = max(int(rows.min()) - 1, 0), max(int(columns.min()) - 1, 0)
    part = (slice(top, int(rows.max()) + 2), slice(left, int(columns.max()) + 2))
    axes = _view(sphere.center)
    some = slice(None, None, 1 + len(pixels) // LENS_READINGS)
    places = np.stack([rows - top, columns - left], axis=1)
    lens = _lens(points[rows, columns][some], axes, places[some])
    brightness = colors[part].astype(np.float64).mean(axis=2)
    around = points[part].astype(np.float64) - sphere.center
    away = np.linalg.norm(around, axis=2)
    # Where no range was read the colour may well be the sphere's.
    shown = np.isnan(away) | (away < ON_SURFACE * sphere.radius)
    grid = _sampled(np.where(shown, brightness, np.nan), lens, sphere)
    if np.count_nonzero(np.isfinite(grid)) < 0.25 * GRID_CELLS**2:
        return None
    noise = _noise(brightness, shown & ~np.isnan(away))
    return _image(grid, noise, axes, sphere)


def _sampled(
    brightness: NDArray[np.float64], lens: NDArray[np.float64], sphere: DetectedSphere
) -> NDArray[np.float64]:
    """Brightness (g, g) of each cell, NaN where not all of it is seen, of a part of an image
    (height, width), NaN where it shows something else; `lens` (6, 2) as of `_lens`."""
    from scipy.ndimage import map_coordinates

    fine = (np.arange(SAMPLES * GRID_CELLS) + 0.5) / SAMPLES - 0.5 * GRID_CELLS
    x, y = np.meshgrid(*(pitch_of(GRID_CELLS) * fine,) * 2)
    z = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    depth = np.linalg.norm(sphere.center) / sphere.radius - z
    a, b = x / depth, y / depth
    places = np.tensordot(lens.T, np.stack([np.ones_like(a), a, b, a * a, a * b, b * b]), 1)
    samples = map_coordinates(brightness, places, order=1, cval=np.nan)
    samples[z < RIM] = np.nan
    parts = samples.reshape(GRID_CELLS, SAMPLES, GRID_CELLS, SAMPLES)
    return np.asarray(parts.mean(axis=(1, 3)))


def _image(
    grid: NDArray[np.float64], noise: float, axes: NDArray[np.float64], sphere: DetectedSphere
) -> SphereImage | None:
    """The image of which a grid (g, g) has the brightness, with its noise of a pixel in levels."""
    rows, columns = np.nonzero(~np.isnan(grid))
    x, y = (np.stack([columns, rows]) - 0.5 * (len(grid) - 1)) * pitch_of(len(grid))
    brightness = grid[rows, columns]
    values = _without_shading(np.stack([x, y, np.sqrt(1.0 - x**2 - y**2)]), brightness)
    if not values.any():
        return None
    inner = float(np.std(values[x**2 + y**2 < 1.0 - (RIM + TAPER) ** 2]))
    whole = np.full(grid.shape, np.nan)
    whole[rows, columns] = values
    across = axes[:2] @ sphere.covariance[:3, :3] @ axes[:2].T
    return SphereImage(
        whole,
        inner * float(np.mean(brightness) + DARK) / noise,
        axes,
        float(np.sqrt(0.5 * np.trace(across))) / sphere.radius,
    )


def _lens(
    points: NDArray[np.float32], axes: NDArray[np.float64], pixels: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Row and column as polynomials (6, 2) in the slopes of a ray to the line of sight, from points
    (n, 3) m and their rows and columns (n, 2)."""
    x, y, z = axes @ points.T.astype(np.float64)
    a, b = x / -z, y / -z
    # About 0.1, so that all columns are of one size.
    basis = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=1)
    scale = np.abs(basis).max(axis=0)
    basis /= scale
    solution = np.linalg.solve(basis.T @ basis + 1e-9 * len(a) * np.eye(6), basis.T @ pixels)
    return np.ascontiguousarray(solution / scale[:, None])


def _noise(brightness: NDArray[np.float64], shown: NDArray[np.bool_]) -> float:
    """Standard deviation of the noise of a pixel, in levels: of second differences along rows, of
    which most see no edge."""
    second = brightness[:, :-2] - 2.0 * brightness[:, 1:-1] + brightness[:, 2:]
    inside = shown[:, :-2] & shown[:, 1:-1] & shown[:, 2:]
    if not inside.any():
        return LEAST_NOISE
    deviation = float(np.median(np.abs(second[inside]))) / MAD_OF_SECOND_DIFFERENCE
    return max(deviation, LEAST_NOISE)


def _view(center: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes (3, 3) of a view, as rows: right, down, towards the sensor."""
    x, y, z = toward = -center / np.linalg.norm(center)
    # Across the sensor's y axis, or its x axis where that is the line of sight.
    right = np.array([-z, 0.0, x]) if abs(y) < 0.9 else np.array([0.0, z, -y])
    right /= np.linalg.norm(right)
    a, b, c = right
    return np.array([right, [y * c - z * b, z * a - x * c, x * b - y * a], toward])


def _without_shading(
    places: NDArray[np.float64], brightness: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Logarithms of brightness (n,) at places (3, n) less those of what smooth light makes of a
    surface of one colour, that of most cells: polynomials up to the second degree."""
    x, y, z = places
    basis = np.stack([np.ones_like(x), x, y, z, x * y, x * z, y * z, x * x - y * y, z * z])
    some, chosen = basis[:, ::2], brightness[::2]
    weights = np.ones_like(chosen)
    for _ in range(ROBUST_STEPS):
        weighted = some * weights
        normal = weighted @ some.T + 1e-6 * len(brightness) * np.eye(9)
        coefficients = np.linalg.solve(normal, weighted @ chosen)
        off = np.abs(chosen - coefficients @ some)
        scale = 4.0 * max(float(np.median(off)), LEAST_NOISE)
        weights = np.square(np.maximum(1.0 - np.square(off / scale), 0.0)) + 1e-3
    smooth = coefficients @ basis
    return np.asarray(np.log(brightness + DARK) - np.log(np.maximum(smooth, 0.0) + DARK))
