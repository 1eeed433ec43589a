"""Detections of one sphere, compared with simulations of its motion since a moment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
"""Standard deviations that a point counts as which could not be simulated."""

INSTANT = 2e-4
"""s between the positions from which a velocity and a spin are taken: a parabola through three, so
exact but for rounding unless a contact lies between them."""


CORRELATION = 3.0
"""Factor on the variances of detections. Their errors are not quite independent from frame to
frame: the ball's place in the image and its range change slowly. Of rendered balls, fits to 0.3 s
of flight had squared errors of 2.7 times the variance that independent errors would leave."""


class TrajectoryFit:
    """The detections since a moment, and how far simulations are from them.

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
        self._times: list[float] = []
        self._positions: list[NDArray[np.float64]] = []
        self._whitening: list[NDArray[np.float64]] = []

    @property
    def last(self) -> float:
        """Time of the newest detection, s on their clock; the beginning before there is one."""
        return self.begin + (self._times[-1] if self._times else 0.0)

    def add(
        self, time: float, position: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> None:
        """Take a detection.

        Parameters
        ----------
        time : s, later than those before
        position : (3,) m
        covariance : (3, 3) m², of the error that no other detection shares
        """
        self._times.append(time - self.begin)
        self._positions.append(position)
        self._whitening.append(np.linalg.inv(np.linalg.cholesky(CORRELATION * covariance)))

    def residuals(self, standard: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return simulated less detected positions, in standard deviations of the noise.

        Parameters
        ----------
        standard : (count, n) standard normal vectors of the unknowns

        Returns
        -------
        (count, 3 k) for k detections
        """
        values = self.unknowns.values(standard)
        worlds = self.unknowns.worlds(self.world, values)
        rollout = self._simulator.rollout_batch(worlds, self._times, orientations=False)
        return self._whitened(values, rollout.positions[:, 0])

    def residuals_and_states(
        self, standard: NDArray[np.float64], time: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals, and the unknowns with the motion carried on to a time.

        Parameters
        ----------
        standard : (count, n)
        time : s, not before the newest detection

        Returns
        -------
        residuals : (count, 3 k)
        values : (count, 12 + p)
        """
        values = self.unknowns.values(standard)
        worlds = self.unknowns.worlds(self.world, values)
        count, after = len(self._times), time - self.begin
        instants = after + INSTANT * np.arange(3.0)
        is_new = count == 0 or after > self._times[-1]
        times = np.concatenate([self._times, instants[0 if is_new else 1 :]])
        rollout = self._simulator.rollout_batch(worlds, times)
        path, turns = rollout.positions[:, 0], np.asarray(rollout.orientations)[:, 0, -3:]
        x, y, z = path[:, -3], path[:, -2], path[:, -1]
        moved = values.copy()
        moved[:, PLACE] = x
        moved[:, VELOCITY] = (4.0 * y - 3.0 * x - z) / (2.0 * INSTANT)
        moved[:, SPIN] = _spins(turns)
        return self._whitened(values, path[:, :count]), moved

    def _whitened(
        self, values: NDArray[np.float64], path: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Residuals (count, 3 k) of positions (count, k, 3) m."""
        apart = path + values[:, None, OFFSET] - np.array(self._positions).reshape(-1, 3)
        whitened = np.array(self._whitening).reshape(-1, 3, 3) @ apart[..., None]
        return np.nan_to_num(whitened.reshape(len(values), -1), nan=LOST)


def _spins(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angular velocities (count, 3) rad/s at the first of three orientations (count, 3, 4)."""
    first, second = (_turn(orientations[:, k], orientations[:, k + 1]) for k in range(2))
    # The mean rates of two intervals, carried back to the first instant.
    return np.asarray((1.5 * first - 0.5 * second) / INSTANT)


def _turn(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vectors (count, 3) of small turns between quaternions (x, y, z, w)."""
    u, s = -before[:, :3], before[:, 3:]
    v, t = after[:, :3], after[:, 3:]
    axis = t * u + s * v + np.cross(v, u)
    cosine = (s * t)[:, 0] - np.einsum("ni,ni->n", v, u)
    sine = np.linalg.norm(axis, axis=1)
    angle = 2.0 * np.arctan2(sine, np.abs(cosine)) * np.where(cosine < 0.0, -1.0, 1.0)
    return np.asarray(axis * (angle / np.maximum(sine, np.finfo(float).tiny))[:, None])
