"""Detections and spins of one sphere, compared with simulations of its motion since a moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import SeenSpin
from intuitive_physics.simulation import Simulator
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics_predictor.estimation.unknowns import (
    OFFSET,
    PLACE,
    SPIN,
    VELOCITY,
    Unknowns,
)

LOST = 1e3
"""Residual, in standard deviations, of a point that could not be simulated."""

INSTANT = 2e-4
"""s between the positions of which a parabola gives the velocity, and between the orientations that
give the spin: exact but for rounding, unless a contact lies between them."""

CORRELATION = 2.3
"""Factor on the variances of detections. Their errors are not quite independent from frame to
frame: the ball's place in the image and its range change slowly. With this factor the squared
errors of estimated positions and velocities of rendered balls are 0.83 and 1.07 of the variances
that are stated."""


@dataclass(frozen=True, eq=False)
class FlightSpin:
    """Spin that the surface showed in one flight.

    Parameters
    ----------
    mean : (3,) rad/s
    whitening : (3, 3), what makes standard deviations of an error of it
    time : s after the beginning of the fit, within the flight
    until : s on the clock of the detections, of the newest frame that it is from
    """

    mean: NDArray[np.float64]
    whitening: NDArray[np.float64]
    time: float
    until: float


class TrajectoryFit:
    """Detections and spins since a moment, and the residuals of simulations.

    Parameters
    ----------
    unknowns : with their prior, at the beginning
    world : a batch of one: the sphere in its environment
    begin : s, on the clock of the detections
    simulator : the model of the motion
    """

    def __init__(
        self, unknowns: Unknowns, world: WorldBatch, begin: float, simulator: Simulator
    ) -> None:
        self.unknowns = unknowns
        self.world = world
        self.begin = begin
        self._simulator = simulator
        self._times = np.empty(0)
        self._positions = np.empty((0, 3))
        self._whitening = np.empty((0, 3, 3))
        self._spins: list[FlightSpin] = []
        self._copies: dict[int, WorldBatch] = {}

    @property
    def last(self) -> float:
        """Time of the newest detection, s on their clock; the beginning before there is one."""
        return self.begin + (float(self._times[-1]) if self._times.size else 0.0)

    def add(
        self, time: float, position: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> None:
        """Take a detection at a time (s), later than those before.

        It has position (3,) m and covariance (3, 3) m² of the error that it shares with no other.
        """
        whitening = np.linalg.inv(np.linalg.cholesky(CORRELATION * covariance))
        self._times = np.append(self._times, time - self.begin)
        self._positions = np.concatenate([self._positions, position[None]])
        self._whitening = np.concatenate([self._whitening, whitening[None]])

    def see_spin(self, spin: SeenSpin, time: float) -> None:
        """Take a spin that the surface shows, in place of an earlier one of the same flight.

        `time`, s, is that of the newest frame that it is from.
        """
        if self._spins and spin.since <= self._spins[-1].until:
            del self._spins[-1]
        # The middle of the flight is far from contacts, whose simulated times are not exact.
        middle = 0.5 * (max(spin.since, self.begin) + time) - self.begin
        whitening = np.linalg.inv(np.linalg.cholesky(spin.covariance))
        self._spins.append(FlightSpin(spin.mean, whitening, max(middle, INSTANT), time))

    def residuals(self, standard: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return simulated minus observed values (count, 3 k), in standard deviations of the noise.

        Spins come first, then detections, for unknowns standard (count, n).
        """
        values = self.unknowns.values(standard)
        return self._residuals(values, self._simulated(values, np.empty(0)))

    def residuals_and_states(
        self, standard: NDArray[np.float64], time: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return residuals (count, 3 k), and unknowns (count, 12 + p) carried on to a time (s).

        The unknowns begin at standard (count, n); the time is not before the newest detection.
        """
        values = self.unknowns.values(standard)
        instants = time - self.begin + INSTANT * np.arange(3.0)
        motions = self._simulated(values, instants)
        x, y, z = (motions.positions(instant) for instant in instants)
        moved = values.copy()
        moved[:, PLACE] = x
        moved[:, VELOCITY] = (4.0 * y - 3.0 * x - z) / (2.0 * INSTANT)
        # Sliding changes a spin by 0.03 rad/s meanwhile, and flight not at all.
        moved[:, SPIN] = motions.turn(*instants[:2]) / INSTANT
        return self._residuals(values, motions), moved

    def _simulated(
        self, values: NDArray[np.float64], instants: NDArray[np.float64]
    ) -> SimulatedMotions:
        """Simulate motions at all that was seen, and at further instants (k,) s."""
        spins = [spin.time for spin in self._spins]
        turns = [time - INSTANT for time in spins]
        times = np.unique(np.concatenate([self._times, turns, spins, instants]))
        rollout = self._simulator.rollout_batch(
            self.unknowns.worlds(self._copies_of(len(values)), values),
            times,
            orientations=bool(spins) or instants.size > 0,
        )
        turned = rollout.orientations
        none = np.empty((len(values), 0, 4))
        return SimulatedMotions(
            times, rollout.positions[:, 0], none if turned is None else turned[:, 0]
        )

    def _copies_of(self, count: int) -> WorldBatch:
        """Return as many worlds, all alike; those of each number are kept."""
        if count not in self._copies:
            self._copies[count] = self.world.taken(np.zeros(count, dtype=np.int64))
        return self._copies[count]

    def _residuals(
        self, values: NDArray[np.float64], motions: SimulatedMotions
    ) -> NDArray[np.float64]:
        """Residuals (count, 3 k) of motions that start from unknowns (count, 12 + p)."""
        apart = motions.positions(self._times)
        apart += values[:, None, OFFSET]
        apart -= self._positions
        # One product of matrices for each detection is much faster than one for each residual.
        rows = apart.swapaxes(0, 1) @ self._whitening.swapaxes(1, 2)
        whitened = [rows.swapaxes(0, 1)]
        for measured in self._spins:
            spin = motions.turn(measured.time - INSTANT, measured.time) / INSTANT
            whitened.insert(0, ((spin - measured.mean) @ measured.whitening.T)[:, None])
        whole = np.concatenate(whitened, axis=1).reshape(len(values), -1)
        whole[np.isnan(whole)] = LOST
        return whole


@dataclass(frozen=True, eq=False)
class SimulatedMotions:
    """Motions of one sphere, at some times.

    Parameters
    ----------
    times : (k,) s, increasing
    path : (count, k, 3) m
    orientations : (count, k, 4) unit quaternions (x, y, z, w), or (count, 0, 4): not asked for
    """

    times: NDArray[np.float64]
    path: NDArray[np.float64]
    orientations: NDArray[np.float64]

    def positions(self, at: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return positions (count, …, 3) m at (…,) some of the times, s."""
        return np.asarray(self.path[:, np.searchsorted(self.times, at)])

    def turn(self, before: float, after: float) -> NDArray[np.float64]:
        """Rotation vectors (count, 3) from one of the times to another."""
        first, second = np.searchsorted(self.times, (before, after))
        return _turn(self.orientations[:, first], self.orientations[:, second])


def _turn(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vectors (count, 3) of small turns between quaternions (x, y, z, w)."""
    # The product of one with the other's conjugate, by columns: three times as fast as by np.cross.
    a, b, c, d = before.T
    e, f, g, h = after.T
    axis = np.stack(
        [
            d * e - h * a + b * g - c * f,
            d * f - h * b + c * e - a * g,
            d * g - h * c + a * f - b * e,
        ],
        axis=1,
    )
    cosine = a * e + b * f + c * g + d * h
    sine = np.sqrt(np.einsum("ni,ni->n", axis, axis))
    angle = 2.0 * np.arctan2(sine, np.abs(cosine)) * np.where(cosine < 0.0, -1.0, 1.0)
    return np.asarray(axis * (angle / np.maximum(sine, np.finfo(float).tiny))[:, None])
