"""Trials that a cost simulates: observations, each under a θ_s and from initial states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters


@dataclass(frozen=True, eq=False)
class Trials:
    """N simulations, each of one observation; any part of them can be run anywhere.

    Parameters
    ----------
    parameters : the θ_s that occur
    parameter_index : (N,) which of them each trial has
    observation_index : (N,) which observation each trial simulates
    states : (N, O, 13) initial states as `ObjectState.to_vector`, O being the largest number of
        objects of an observation; None: those of the observations
    until : (N,) s after the start; later points are neither simulated nor counted, but there is
        always a first. None: all points count
    columns : (P,) index of each point that residuals are wanted of, among those of an observation,
        object after object; None: all points
    """

    parameters: Sequence[StaticParameters]
    parameter_index: NDArray[np.int64]
    observation_index: NDArray[np.int64]
    states: NDArray[np.float64] | None = None
    until: NDArray[np.float64] | None = None
    columns: NDArray[np.int64] | None = None

    @property
    def size(self) -> int:
        """Number of trials N."""
        return int(self.parameter_index.size)

    @staticmethod
    def crossed(parameters: Sequence[StaticParameters], observations: int) -> Trials:
        """Every observation under every θ_s, the observations of one θ_s after the other."""
        candidates = len(parameters)
        return Trials(
            parameters,
            np.repeat(np.arange(candidates), observations),
            np.tile(np.arange(observations), candidates),
        )

    def taken(self, trials: NDArray[np.int64]) -> Trials:
        """Return some, `trials` (k,) by index in the order wanted, with only the θ_s they need."""
        used, index = np.unique(self.parameter_index[trials], return_inverse=True)
        return Trials(
            [self.parameters[i] for i in used],
            index,
            self.observation_index[trials],
            None if self.states is None else self.states[trials],
            None if self.until is None else self.until[trials],
            self.columns,
        )


def resting(*shape: int) -> NDArray[np.float64]:
    """Return states (*shape, 13), in SI units, at rest in the origin."""
    states = np.zeros((*shape, 13))
    states[..., 6] = 1.0
    return states
