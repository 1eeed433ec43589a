"""Noise of the readings of a range sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_perception.settings import PerceptionSettings

RANGE_BINS = 12
"""Bins of range, of equally many readings, in which the scatter is measured. Set by hand."""

MIN_READINGS_IN_BIN = 50
"""Readings that a bin needs: the scatter of this number is known to 16 %. Set by hand."""

GAUSSIAN_MAD = 1.4826
"""Standard deviation of a normal distribution in median absolute deviations, 1 / Φ⁻¹(3/4)."""

CORRELATION_REACH = 8
"""Pixels up to which errors of neighbouring readings are compared: matching windows of stereo
cameras have 3 to 11 pixels, and errors of readings farther apart than a window share nothing."""

STILL_SIGMAS = 5.0
"""Standard deviations by which a reading of what stands still changes from frame to frame at most;
what changes by more has moved. Set by hand."""

MIN_COMPARED_READINGS = 10000
"""Readings in which the correlation of errors is measured at least: their sum over the
(2 · 8 + 1)² neighbours is then known to about √(289 / 10000), 0.2 readings."""

CELL_SPACINGS = 8.0
"""Edge of a cell of directions in which errors are averaged, in angles between neighbours: wider
than the matching windows of most cameras."""

MIN_READINGS_IN_CELL = 16
"""Readings that a cell needs for its mean to show how their errors are correlated."""

MIN_CELLS = 30
"""Smallest number of such cells: their median square is then known to a fifth."""

CHANGE_SIGMAS = 4.0
"""Standard deviations by which a reading differs from the one before when something else is seen.
Six in 100,000 do so by chance."""

SMALLEST_FACTOR = 0.1
"""Part of the assumed noise parameters that measured ones never fall below. Set by hand."""

LARGEST_FACTOR = 10.0
"""Multiple of the assumed noise parameters that measured ones never exceed. Set by hand."""


@dataclass(frozen=True)
class RangeNoise:
    """Standard deviation of a reading at range ρ: along its ray √(a² + (b ρ²)²), at most `limit`.

    Parameters
    ----------
    constant : a in m
    quadratic : b in 1/m
    limit : m
    lateral : standard deviation of the direction of a reading, rad
    correlated : neighbouring readings that share one error along the ray: the variance of a mean of
        n readings is this many times σ² / n
    between_lines : angle between the lines in which a scanner reads, rad; 0 where it has none
    """

    constant: float
    quadratic: float
    limit: float
    lateral: float
    correlated: float = 1.0
    between_lines: float = 0.0

    @staticmethod
    def from_settings(settings: PerceptionSettings) -> RangeNoise:
        """Return the noise one assumes before anything was measured."""
        return RangeNoise(
            settings.range_noise_constant,
            settings.range_noise_quadratic,
            settings.range_noise_max,
            settings.lateral_noise,
            settings.correlated_readings,
        )

    @property
    def squares(self) -> NDArray[np.float64]:
        """Squares (4,) of the constant, the quadratic part, the limit and the lateral deviation."""
        return np.square([self.constant, self.quadratic, self.limit, self.lateral])

    def deviation(self, ranges: ArrayLike) -> NDArray[np.float64]:
        """Return the standard deviation (...,) m, along the ray, at `ranges` (...,) m."""
        r2 = np.square(np.asarray(ranges, dtype=np.float64))
        return np.minimum(np.hypot(self.constant, self.quadratic * r2), self.limit)

    def measured(self, ranges: NDArray[np.float64], errors: NDArray[np.float64]) -> RangeNoise:
        """Return the noise that explains the errors along the ray of readings on known planes.

        The scatter in bins of range is matched by least squares in its square; what too few
        readings determine is left as it was.

        `ranges` (n,) m; `errors` (n,) m, may hold outliers.
        """
        from scipy.optimize import nnls

        if not ranges.size:
            return self
        edges = np.quantile(ranges, np.linspace(0.0, 1.0, RANGE_BINS + 1))
        at, variances = [], []
        for low, high in pairwise(edges):
            inside = (ranges >= low) & (ranges <= high)
            if inside.sum() >= MIN_READINGS_IN_BIN:
                at.append(float(np.median(ranges[inside])))
                centred = errors[inside] - np.median(errors[inside])
                variances.append((GAUSSIAN_MAD * float(np.median(np.abs(centred)))) ** 2)
        if len(at) < 2:
            return self
        # σ² = a² + b² ρ⁴ is linear in a² and b²; weights 1/σ² make the fit relative.
        fourth, variance = np.array(at) ** 4, np.maximum(variances, 1e-10)
        weights = 1.0 / variance
        design = np.column_stack([np.ones_like(fourth), fourth])
        a, b = np.sqrt(nnls(design * weights[:, None], np.ones_like(variance))[0])
        return replace(
            self,
            constant=_within(a, self.constant),
            quadratic=_within(b, self.quadratic),
        )

    def with_correlation_on_surfaces(
        self, points: NDArray[np.float64], errors: NDArray[np.float64], spacing: float
    ) -> RangeNoise:
        """Return the noise with the correlation that readings of one frame on known planes show.

        For clouds without pixels and for cameras that move. In cells of directions the mean of n
        errors has the variance c / n of one, where c is the correlation, and the unevenness of the
        planes adds to it. The median over the cells leaves out what is no plane. Too few readings
        leave it as it was.

        `points` (n, 3) m, of the readings; `errors` (n,) of them, along their rays, in standard
        deviations; `spacing` in rad, angle between neighbouring readings.
        """
        still = np.abs(errors) < STILL_SIGMAS
        directions = points[still] / np.linalg.norm(points[still], axis=1, keepdims=True)
        cells = np.floor(directions / (CELL_SPACINGS * spacing)).astype(np.int64)
        _, cell_of = np.unique(cells, axis=0, return_inverse=True)
        counts = np.bincount(cell_of.ravel())
        sums = np.bincount(cell_of.ravel(), weights=errors[still])
        full = counts >= MIN_READINGS_IN_CELL
        if full.sum() < MIN_CELLS:
            return self
        means2 = float(np.median(np.square(sums[full]) / counts[full])) * GAUSSIAN_MAD**2
        one2 = float(np.median(np.square(errors[still]))) * GAUSSIAN_MAD**2
        return replace(self, correlated=max(means2 / max(one2, 1e-12), 1.0))

    def with_correlation(
        self, before: NDArray[np.float64], after: NDArray[np.float64]
    ) -> RangeNoise:
        """Return the noise with the correlation that two frames of the same scene show.

        What stands still makes no difference between the frames, so the difference of two readings
        of a pixel is the difference of their errors. The autocorrelation of that over the image,
        summed over all neighbours up to `CORRELATION_REACH`, is the factor by which the variance of
        a mean exceeds that of as many independent readings. Too few readings, or frames without
        noise, leave it as it was.

        `before` (height, width) and `after` (height, width) m, ranges in the two frames, NaN where
        nothing was read.
        """
        if before.shape != after.shape or min(before.shape) <= CORRELATION_REACH:
            return self
        scaled = (after - before) / (np.sqrt(2.0) * self.deviation(before))
        still = np.abs(scaled) < STILL_SIGMAS
        errors = np.where(still, scaled, 0.0)
        squares = float(np.square(errors).sum())
        if still.sum() < MIN_COMPARED_READINGS or squares == 0.0:
            return self
        compared = neighbour_products(still.astype(np.float64), CORRELATION_REACH)
        products = neighbour_products(errors, CORRELATION_REACH)
        correlations = products / np.maximum(compared, 1.0) * (still.sum() / squares)
        return replace(self, correlated=max(float(correlations.sum()), 1.0))


def neighbour_products(image: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Return sums over an image of the products of two pixels, by their offset.

    `image` (height, width). Returns (2 · reach + 1, 2 · reach + 1) by offset of rows and columns.
    """
    # Zeros beyond the edges keep opposite edges from being neighbours.
    size = tuple(length + reach for length in image.shape)
    spectrum = np.fft.rfft2(image, size)
    products = np.fft.irfft2(np.square(np.abs(spectrum)), size)
    offsets = np.arange(-reach, reach + 1)
    return np.asarray(products[np.ix_(offsets, offsets)])


def _within(value: float, expected: float) -> float:
    return float(np.clip(value, SMALLEST_FACTOR * expected, LARGEST_FACTOR * expected))
