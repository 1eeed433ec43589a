"""Initial states θ_d from points of known noise: a few, or all before the first bounce."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.state import ERROR_SIZE, LINEAR_VELOCITY, POSITION
from intuitive_physics.validation import (
    covariance_matrices,
    finite_array,
    increasing_times,
    positive_float,
)

FEWEST_POINTS = 3
"""Points that a flight is fitted to at least."""

SURPRISE = 16.3
"""χ² of three degrees of freedom that free flight exceeds once in a thousand points."""


def flight_length(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, noise: ArrayLike
) -> int:
    """Count the points from the first one that free flight explains, at least three.

    A point is a surprise when it lies further from where the points before it send the object than
    noise does. The one before the surprise is left out too: the bounce may have begun there.
    Arguments are those of `fit_noisy_flight`.
    """
    flight = _Flight(times, positions, gravity, noise)
    for count in range(FEWEST_POINTS, flight.times.size):
        if flight.surprise(count) > SURPRISE:
            return max(count - 1, FEWEST_POINTS)
    return int(flight.times.size)


def fit_noisy_flight(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, noise: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Fit x(t) = x₀ + v₀ t + g t² / 2 by least squares to points with known noise.

    Times (n,) s, n ≥ 3, strictly increase; positions are (n, 3) m, gravity (3,) m/s². Noise is a
    standard deviation in m on each axis, or the covariance (n, 3, 3) m² of each point. Returns
    position (3,) m and velocity (3,) m/s at the first time, and the covariance (12, 12) of an
    `ObjectState`, in which rotation and spin are zero.
    """
    flight = _Flight(times, positions, gravity, noise)
    start, inverse = flight.fit(flight.times.size)
    covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
    parts = (POSITION, LINEAR_VELOCITY)
    for i, row in enumerate(parts):
        for k, column in enumerate(parts):
            covariance[row, column] = inverse[3 * i : 3 * i + 3, 3 * k : 3 * k + 3]
    return start[:3], start[3:], covariance


class _Flight:
    """Weighted least squares over the first points of a flight, as it would be without gravity."""

    def __init__(
        self, times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, noise: ArrayLike
    ) -> None:
        t = increasing_times(times, "times of flight")
        x = finite_array(positions, "positions of flight", (t.size, 3))
        if t.size < FEWEST_POINTS:
            raise InvalidInputError(
                f"flight has {t.size} points; expected at least {FEWEST_POINTS}"
            )
        self.times = t - t[0]
        fallen = 0.5 * self.times[:, None] ** 2 * finite_array(gravity, "gravity", (3,))
        self._level = x - fallen
        self._covariances = _covariances(noise, t.size)
        # Rows [I, t I] of each point, so that position and velocity are its six unknowns.
        self._rows = np.einsum("nk,ij->nikj", np.stack([self.times**0, self.times], 1), np.eye(3))
        self._rows = self._rows.reshape(t.size, 3, 6)
        weighted = np.einsum(
            "nij,nik->njk", self._rows, np.linalg.solve(self._covariances, self._rows)
        )
        right = np.linalg.solve(self._covariances, self._level[:, :, None])
        self._information = np.cumsum(weighted, axis=0)
        self._right = np.cumsum(np.einsum("nij,nik->nj", self._rows, right), axis=0)

    def fit(self, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return position and velocity (6,) of the first `count` points, and covariance (6, 6)."""
        inverse = np.linalg.inv(self._information[count - 1])
        return inverse @ self._right[count - 1], inverse

    def surprise(self, count: int) -> float:
        """χ² of point `count`, counted from 0, given those before it."""
        start, inverse = self.fit(count)
        row = self._rows[count]
        off = self._level[count] - row @ start
        spread = self._covariances[count] + row @ inverse @ row.T
        return float(off @ np.linalg.solve(spread, off))


def _covariances(noise: ArrayLike, count: int) -> NDArray[np.float64]:
    """Covariances (count, 3, 3) m² of the points."""
    if np.ndim(noise) == 0:
        deviation = positive_float(float(np.asarray(noise)), "noise")
        return np.broadcast_to(deviation**2 * np.eye(3), (count, 3, 3))
    return covariance_matrices(noise, "covariances of flight", count, size=3)
