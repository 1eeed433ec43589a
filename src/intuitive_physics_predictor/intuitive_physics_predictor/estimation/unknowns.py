"""Unknowns of a trajectory fit as a standard normal vector: initial state, offset and θ_s.

The unknowns of one sphere are its position x, velocity v and spin ω at the beginning of the fit,
the offset b that all its detections share, and the parameters u of its material against those of
the environment, on the unit cube. A priori they are normal: z = μ + L ξ with ξ ~ N(0, I).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics.state import ANGULAR_VELOCITY, LINEAR_VELOCITY, POSITION, ObjectState
from intuitive_physics_predictor.estimation.pair_knowledge import PairKnowledge

PLACE, VELOCITY, SPIN, OFFSET = (slice(first, first + 3) for first in (0, 3, 6, 9))
"""Places of position (m), velocity (m/s), spin (rad/s) and offset (m) among the unknowns."""

MOTION = slice(0, 9)
"""Position, velocity and spin."""

KINEMATIC = 12
"""Unknowns before the parameters."""

SMALLEST_SHARE = 1e-13
"""Share of the largest variance below which a variance is rounding."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Prior of the unknowns of one sphere.

    Parameters
    ----------
    mean : (12 + p,) μ
    root : (12 + p, n) L
    parameters : what the p parameters are
    guessed_spin : rad/s on each axis, of a spin that was a guess before the motion; 0: it was seen
    """

    mean: NDArray[np.float64]
    root: NDArray[np.float64]
    parameters: PairKnowledge
    guessed_spin: float = 0.0

    @staticmethod
    def of_moments(
        mean: NDArray[np.float64], covariance: NDArray[np.float64], parameters: PairKnowledge
    ) -> Unknowns:
        """Return the prior with mean (12,) and covariance (12, 12) of x, v, ω and b.

        The parameters are independent of these.
        """
        count = len(parameters.mean)
        whole = np.zeros((KINEMATIC + count,) * 2)
        whole[:KINEMATIC, :KINEMATIC] = covariance
        whole[KINEMATIC:, KINEMATIC:] = parameters.covariance
        scale = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
        variances, axes = np.linalg.eigh(whole / np.outer(scale, scale))
        varies = variances > SMALLEST_SHARE * variances[-1]
        root = scale[:, None] * axes[:, varies] * np.sqrt(variances[varies])
        return Unknowns(np.concatenate([mean, parameters.mean]), root, parameters)

    @staticmethod
    def of_state(
        state: ObjectState, bias: NDArray[np.float64], parameters: PairKnowledge
    ) -> Unknowns:
        """Return the prior of a perceived object, where bias (3, 3) m² is the covariance of b.

        The perceived position is x + b + e: the offset is part of its covariance.
        """
        rows = np.r_[POSITION, LINEAR_VELOCITY, ANGULAR_VELOCITY]
        covariance = np.zeros((KINEMATIC, KINEMATIC))
        covariance[MOTION, MOTION] = state.covariance[np.ix_(rows, rows)]
        # The perceived covariance may be smaller than the shared part: then all of it is shared.
        covariance[PLACE, PLACE] = _at_least(covariance[PLACE, PLACE], bias)
        covariance[OFFSET, OFFSET] = bias
        covariance[PLACE, OFFSET] = covariance[OFFSET, PLACE] = -bias
        mean = np.concatenate(
            [state.position, state.linear_velocity, state.angular_velocity, np.zeros(3)]
        )
        return Unknowns.of_moments(mean, covariance, parameters)

    @property
    def size(self) -> int:
        """Number n of independent unknowns."""
        return self.root.shape[1]

    def values(self, standard: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the unknowns (count, 12 + p) of standard (count, n) normal vectors.

        They are in SI units, the parameters on the unit cube.
        """
        return np.asarray(self.mean + standard @ self.root.T)

    def worlds(self, copies: WorldBatch, values: NDArray[np.float64]) -> WorldBatch:
        """Return copies of a world with one sphere that start from values (count, 12 + p)."""
        count = len(values)
        states = np.zeros((count, 1, 13))
        states[:, 0, 6] = 1.0
        states[:, 0, 0:3] = values[:, PLACE]
        states[:, 0, 7:10] = values[:, VELOCITY]
        states[:, 0, 10:13] = values[:, SPIN]
        return replace(
            copies, states=states, **self.parameters.tables(copies, values[:, KINEMATIC:])
        )


def _at_least(covariance: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a covariance from which `part` can be taken."""
    left, axes = np.linalg.eigh(covariance - part)
    return np.asarray(part + (axes * np.maximum(left, 0.0)) @ axes.T)
