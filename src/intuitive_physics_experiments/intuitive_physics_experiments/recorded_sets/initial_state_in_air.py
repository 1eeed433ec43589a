"""Initial state θ_d of a recorded ball that air slows down and turns aside, spin included.

Drag and Magnus force follow from velocity and spin, which the fit is after. So it repeats: take the
accelerations along the last fit's flight, integrate them twice, and solve for what is linear then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    POSITION,
    ObjectState,
)
from intuitive_physics.validation import finite_array, increasing_times, non_negative_float
from intuitive_physics_experiments.recorded_sets.initial_state import noise_variance

LIKELY_SPIN = 100.0
"""rad/s, standard deviation of the spin of a shot ball, before its flight is fitted."""

CONVERGED = 1e-7
"""m; the fit ends when no point moves further than that."""

DIVERGED = 1e3
"""m; a fit whose points move as far as that finds no end."""

MOST_ROUNDS = 60
"""Iterations of the fit at most."""


@dataclass(frozen=True)
class AirFactors:
    """Accelerations by air: -drag |v| v + magnus ω × v."""

    drag: float  # 1/m, ½ ρ C_d A / m
    magnus: float  # ½ ρ A r C_M / m

    def __post_init__(self) -> None:
        non_negative_float(self.drag, "drag factor")
        non_negative_float(self.magnus, "Magnus factor")


def fit_initial_state_in_air(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, air: AirFactors
) -> ObjectState:
    """Fit position, velocity and spin to points (n, 3) m in free flight at times (n,) s, n ≥ 3.

    The state is that of the first time. The flight determines only the part of the spin across it;
    of the rest the covariance says `LIKELY_SPIN`. Air that is too strong for the fit to converge is
    an error.
    """
    t = increasing_times(times, "times of free flight")
    x = finite_array(positions, "positions of free flight", (t.size, 3))
    g = finite_array(gravity, "gravity", (3,))
    if t.size < 3:
        raise InvalidInputError(f"free flight has {t.size} points; expected at least 3")
    since = t - t[0]
    falling = 0.5 * since[:, None] ** 2 * g
    by_air = velocity_by_air = np.zeros_like(x)
    spin = np.zeros(3)
    start = np.polynomial.polynomial.polyfit(since, x - falling, 1)
    variance = noise_variance(x - falling - start[0] - since[:, None] * start[1], parameters=2)
    for _ in range(MOST_ROUNDS):
        velocity = start[1] + since[:, None] * g + velocity_by_air
        flight = _LinearisedFlight(since, velocity, air)
        solution, covariance, residuals = flight.fit(x - falling, variance)
        start, spin = solution[:6].reshape(2, 3), solution[6:]
        before, (velocity_by_air, by_air) = by_air, flight.by_air(spin)
        variance = noise_variance(residuals, parameters=3)
        moved = float(np.abs(by_air - before).max())
        if not moved < DIVERGED:
            break
        if moved < CONVERGED:
            return ObjectState(
                start[0],
                linear_velocity=start[1],
                angular_velocity=spin,
                covariance=_state_covariance(covariance),
            )
    raise InvalidInputError(
        f"fit of a flight of {since[-1]:.2f} s in air with the drag factor {air.drag:g} 1/m does "
        "not converge; expected air that bends the flight and does not stop it"
    )


class _LinearisedFlight:
    """Displacements by air along known velocities (n, 3): linear in the spin."""

    def __init__(
        self, since: NDArray[np.float64], velocity: NDArray[np.float64], air: AirFactors
    ) -> None:
        self._since = since
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        self._by_drag = _integrated_twice(since, -air.drag * speed * velocity)
        self._by_spin = [
            _integrated_twice(since, air.magnus * np.cross(axis, velocity)) for axis in np.eye(3)
        ]

    def by_air(self, spin: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Changes of velocity and of position, each (n, 3)."""
        velocity, position = (
            self._by_drag[k]
            + sum(s * column[k] for s, column in zip(spin, self._by_spin, strict=True))
            for k in range(2)
        )
        return velocity, position

    def fit(
        self, positions: NDArray[np.float64], variance: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return position, velocity and spin (9,), covariance (9, 9) and residuals (n, 3) m."""
        n = len(positions)
        design = np.zeros((3, n, 9))
        for axis in range(3):
            design[axis, :, axis] = 1.0
            design[axis, :, 3 + axis] = self._since
            for k, (_, displacement) in enumerate(self._by_spin):
                design[axis, :, 6 + k] = displacement[:, axis]
        target = (positions - self._by_drag[1]).T
        weights = 1.0 / variance
        information = np.einsum("ani,a,anj->ij", design, weights, design)
        information[6:, 6:] += np.eye(3) / LIKELY_SPIN**2
        covariance = np.linalg.inv(information)
        solution = covariance @ np.einsum("ani,a,an->i", design, weights, target)
        return solution, covariance, (target - design @ solution).T


def _integrated_twice(
    times: NDArray[np.float64], acceleration: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Velocity and displacement, each (n, 3), of an acceleration linear between its points."""
    steps = np.diff(times)[:, None]
    first, last = acceleration[:-1], acceleration[1:]
    velocity = np.zeros_like(acceleration)
    velocity[1:] = np.cumsum(0.5 * (first + last) * steps, axis=0)
    displacement = np.zeros_like(acceleration)
    moved = velocity[:-1] * steps + (2.0 * first + last) * steps**2 / 6.0
    displacement[1:] = np.cumsum(moved, axis=0)
    return velocity, displacement


def _state_covariance(fitted: NDArray[np.float64]) -> NDArray[np.float64]:
    covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
    parts = (POSITION, LINEAR_VELOCITY, ANGULAR_VELOCITY)
    for i, row in enumerate(parts):
        for k, column in enumerate(parts):
            covariance[row, column] = fitted[3 * i : 3 * i + 3, 3 * k : 3 * k + 3]
    return covariance
