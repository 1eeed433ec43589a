"""Noise of the readings of a range sensor."""

from __future__ import annotations

from dataclasses import dataclass
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
    """

    constant: float
    quadratic: float
    limit: float
    lateral: float

    @staticmethod
    def from_settings(settings: PerceptionSettings) -> RangeNoise:
        """Return the noise one assumes before anything was measured."""
        return RangeNoise(
            settings.range_noise_constant,
            settings.range_noise_quadratic,
            settings.range_noise_max,
            settings.lateral_noise,
        )

    def deviation(self, ranges: ArrayLike) -> NDArray[np.float64]:
        """Return the standard deviation (...,) m, along the ray, at `ranges` (...,) m."""
        r2 = np.square(np.asarray(ranges, dtype=np.float64))
        return np.minimum(np.hypot(self.constant, self.quadratic * r2), self.limit)

    def measured(self, ranges: NDArray[np.float64], errors: NDArray[np.float64]) -> RangeNoise:
        """Return the noise that explains the errors along the ray of readings on known planes.

        The scatter in bins of range is matched by least squares in its square; what too few
        readings determine is left as it was.

        Parameters
        ----------
        ranges : (n,) m
        errors : (n,) m, may hold outliers
        """
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
        solution = _non_negative(design * weights[:, None], np.ones_like(variance))
        a, b = np.sqrt(solution)
        return RangeNoise(
            _within(a, self.constant), _within(b, self.quadratic), self.limit, self.lateral
        )


def _non_negative(design: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Least squares in two unknowns that may not be negative."""
    best = np.asarray(np.linalg.lstsq(design, target, rcond=None)[0], dtype=np.float64)
    if (best >= 0.0).all():
        return best
    alone = np.maximum((design * target[:, None]).sum(axis=0) / np.square(design).sum(axis=0), 0.0)
    residuals = np.square(design * alone - target[:, None]).sum(axis=0)
    keep = int(np.argmin(residuals))
    solution = np.zeros(2)
    solution[keep] = alone[keep]
    return solution


def _within(value: float, expected: float) -> float:
    return float(np.clip(value, SMALLEST_FACTOR * expected, LARGEST_FACTOR * expected))
