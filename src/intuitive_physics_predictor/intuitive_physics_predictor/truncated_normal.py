"""Normal distributions between two ends, of which many quantiles are asked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

EXACT = 1e-30
"""Smaller deviations count as this: beside any mean it is nothing."""


class TruncatedNormal:
    """Independent normal distributions, each cut off at two ends.

    Parameters
    ----------
    mean : (n,)
    deviation : (n,) ≥ 0; where it is infinite, the distribution is uniform between the ends
    lower, upper : (n,) ends, on either side of the mean or at it
    """

    def __init__(
        self,
        mean: NDArray[np.float64],
        deviation: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
    ) -> None:
        self._mean, self._lower, self._upper = mean, lower, upper
        self._uniform = np.isinf(deviation)
        self._deviation = np.where(self._uniform, 1.0, np.maximum(deviation, EXACT))
        # Shares of the whole normal distribution that are below the lower end and between both.
        self._below = ndtr((lower - mean) / self._deviation)
        self._between = ndtr((upper - mean) / self._deviation) - self._below

    def quantiles(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return below what these shares (…, n) of the distributions are."""
        return self._quantiles(shares, self._between, self._lower, self._upper)

    def quantiles_up_to(
        self, most: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return `quantiles` of the distributions cut off at `most` (…, n) too.

        Where that is below the lower end it is the answer.
        """
        upper = np.minimum(self._upper, most)
        below_most = ndtr((most - self._mean) / self._deviation)
        between = np.minimum(self._between, below_most - self._below)
        return self._quantiles(shares, between, np.minimum(self._lower, upper), upper)

    def _quantiles(
        self,
        shares: NDArray[np.float64],
        between: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        normal = self._mean + self._deviation * ndtri(self._below + shares * between)
        drawn = np.where(self._uniform, lower + shares * (upper - lower), normal)
        return np.asarray(np.minimum(np.maximum(drawn, lower), upper))
