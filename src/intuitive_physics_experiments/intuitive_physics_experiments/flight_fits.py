"""Initial states θ_d by least squares over points in free flight.

The noise of the points is known (`fit_noisy_flight`), or follows from the residuals
(`fit_initial_state`), also of a ball that air slows down and turns aside, spin included
(`fit_initial_state_in_air`). Drag and Magnus force follow from velocity and spin, which that fit
is to find. So it repeats: take the accelerations along the last fit's flight, integrate them twice,
and solve for the unknowns, in which the problem is linear then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import SceneObject
from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    POSITION,
    ROTATION,
    ObjectState,
)
from intuitive_physics.validation import (
    covariance_matrices,
    finite_array,
    increasing_times,
    non_negative_float,
    positive_float,
)

MOTION = (POSITION, LINEAR_VELOCITY)  # Parts of a state that free flight shows
FEWEST_POINTS = 3  # Points that a flight is fitted to at least
SURPRISE = 16.3  # χ² of three degrees of freedom that free flight exceeds once in a thousand points
UNKNOWN_SPIN = 30.0  # rad/s, standard deviation of a spin that nobody measured
SMALLEST_NOISE = 5e-4  # m; points that fit better than this fit by chance

# rad/s, standard deviation of the spin of a shot ball, before its flight is fitted.
LIKELY_SPIN = 100.0

CONVERGED = 1e-7  # m; the fit ends when no point moves further than that
DIVERGED = 1e3  # m; a fit whose points move as far as that finds no end
MOST_ROUNDS = 60  # Iterations of the fit at most


def state_covariance(
    fitted: NDArray[np.float64], parts: Sequence[slice] = MOTION
) -> NDArray[np.float64]:
    """Covariance (12, 12) of a state of which only `parts` were fitted, to the covariance `fitted`.

    The covariance `fitted` (n, n) has the parts in their order.
    """
    rows = np.r_[tuple(parts)]
    covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
    covariance[np.ix_(rows, rows)] = fitted
    return covariance


def with_known_rotation(
    known: ObjectState,
    position: NDArray[np.float64],
    velocity: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> ObjectState:
    """State of a fitted position (3,) and velocity (3,); orientation and spin are the known ones.

    The `covariance` (12, 12) gets their part of the known covariance.
    """
    for part in (ROTATION, ANGULAR_VELOCITY):
        covariance[part, part] = known.covariance[part, part]
    return ObjectState(position, known.orientation, velocity, known.angular_velocity, covariance)


def _without_gravity(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, fewest: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) s from the first one on, and points (n, 3) m without their fall."""
    t = increasing_times(times, "times of free flight")
    x = finite_array(positions, "positions of free flight", (t.size, 3))
    if t.size < fewest:
        raise InvalidInputError(f"free flight has {t.size} points; expected at least {fewest}")
    since = t - t[0]
    return since, x - 0.5 * since[:, None] ** 2 * finite_array(gravity, "gravity", (3,))


def flight_length(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, noise: ArrayLike
) -> int:
    """Count the points from the first one that free flight explains, at least three.

    A point is a surprise when it lies further from where the points before it send the object than
    noise does. The one before the surprise is left out too: the bounce may have begun there.
    `times` (n,) s, `positions` (n, 3) m, `gravity` (3,) m/s² and `noise` (...) are those of
    `fit_noisy_flight`.
    """
    flight = _NoisyFlight(times, positions, gravity, noise)
    for count in range(FEWEST_POINTS, flight.times.size):
        if flight.surprise(count) > SURPRISE:
            return max(count - 1, FEWEST_POINTS)
    return int(flight.times.size)


def fit_noisy_flight(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, noise: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Fit x(t) = x₀ + v₀ t + g t² / 2 by least squares to points with known noise.

    The `times` (n,) s, n ≥ 3, strictly increase; `positions` (n, 3) m, gravity (3,) m/s². The
    `noise` () m is a standard deviation on each axis, or (n, 3, 3) m² the covariance of each point.
    Returns position (3,) m and velocity (3,) m/s at the first time, and the covariance (12, 12) of
    an `ObjectState`, in which rotation and spin are zero.
    """
    flight = _NoisyFlight(times, positions, gravity, noise)
    start, inverse = flight.fit(flight.times.size)
    return start[:3], start[3:], state_covariance(inverse)


class _NoisyFlight:
    """Weighted least squares over the first points of a flight, as it would be without gravity."""

    def __init__(
        self, times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, noise: ArrayLike
    ) -> None:
        self.times, self._level = _without_gravity(times, positions, gravity, FEWEST_POINTS)
        count = self.times.size
        self._covariances = _covariances(noise, count)
        # Rows [I, t I] of each point, so that position and velocity are its six unknowns.
        self._rows = np.einsum("nk,ij->nikj", np.stack([self.times**0, self.times], 1), np.eye(3))
        self._rows = self._rows.reshape(count, 3, 6)
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


def fit_initial_state(times: ArrayLike, positions: ArrayLike, gravity: ArrayLike) -> ObjectState:
    """Fit x(t) = x₀ + v₀ t + g t² / 2 to positions (n, 3) m in free flight at times (n,) s, n ≥ 2.

    Three points are the paper's choice; more points average more noise but feel more of what the
    model lacks, such as air drag, beside `gravity` (3,) m/s². The covariance counts both: it comes
    from the residuals, and neighbours whose residuals go together count as fewer points. The state
    is that of the first time; the spin is zero with the standard deviation `UNKNOWN_SPIN`.
    """
    since, level = _without_gravity(times, positions, gravity, 2)
    design = np.column_stack([np.ones_like(since), since])
    solution, *_ = np.linalg.lstsq(design, level, rcond=None)
    variance = noise_variance(level - design @ solution, parameters=2)
    fitted = np.kron(np.linalg.inv(design.T @ design), np.diag(variance))
    covariance = state_covariance(np.asarray(fitted, dtype=np.float64))
    covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = UNKNOWN_SPIN**2 * np.eye(3)
    return ObjectState(solution[0], linear_velocity=solution[1], covariance=covariance)


def noise_variance(residuals: NDArray[np.float64], parameters: int) -> NDArray[np.float64]:
    """Variance (3,) m² of a point on each axis, as if neighbours were independent.

    The `residuals` (n, 3) m are of points along one track; `parameters` were fitted on each axis.
    """
    n = len(residuals)
    freedom = max(n - parameters, 1)
    variance = np.maximum((residuals**2).sum(axis=0) / freedom, SMALLEST_NOISE**2)
    if n <= 4:
        return variance
    lagged = (residuals[1:] * residuals[:-1]).sum(axis=0)
    correlation = np.clip(lagged / np.maximum((residuals**2).sum(axis=0), 1e-300), 0.0, 0.95)
    # A first-order autoregressive series of n points is worth n (1 - ρ) / (1 + ρ).
    return variance * (1.0 + correlation) / (1.0 - correlation)


@dataclass(frozen=True)
class AirFactors:
    """Accelerations by air: -drag |v| v + magnus ω × v."""

    drag: float  # 1/m, ½ ρ C_d A / m
    magnus: float  # ½ ρ A r C_M / m

    def __post_init__(self) -> None:
        non_negative_float(self.drag, "drag factor")
        non_negative_float(self.magnus, "Magnus factor")

    @staticmethod
    def of(ball: SceneObject, air_density: float, mass: float) -> AirFactors:
        """Return the factors of a ball of a mass in kg in air of a density in kg/m³."""
        radius = ball.shape.bounding_radius
        pressed = 0.5 * air_density * np.pi * radius**2 / mass
        return AirFactors(
            pressed * ball.drag_coefficient, pressed * radius * ball.magnus_coefficient
        )


def fit_initial_state_in_air(
    times: ArrayLike, positions: ArrayLike, gravity: ArrayLike, air: AirFactors
) -> ObjectState:
    """Fit position, velocity and spin to positions (n, 3) m in free flight at times (n,) s, n ≥ 3.

    The state is that of the first time, under `gravity` (3,) m/s² and in air. The flight determines
    only the part of the spin across it; of the rest the covariance says `LIKELY_SPIN`. Air that is
    too strong for the fit to converge is an error.
    """
    since, level = _without_gravity(times, positions, gravity, 3)
    g = np.asarray(gravity, dtype=np.float64)
    by_air = velocity_by_air = np.zeros_like(level)
    spin = np.zeros(3)
    start = np.polynomial.polynomial.polyfit(since, level, 1)
    variance = noise_variance(level - start[0] - since[:, None] * start[1], parameters=2)
    for _ in range(MOST_ROUNDS):
        velocity = start[1] + since[:, None] * g + velocity_by_air
        flight = _LinearisedFlight(since, velocity, air)
        solution, covariance, residuals = flight.fit(level, variance)
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
                covariance=state_covariance(covariance, (*MOTION, ANGULAR_VELOCITY)),
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
