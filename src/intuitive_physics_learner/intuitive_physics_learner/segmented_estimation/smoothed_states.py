"""What is known of the states of throws in segments, from the points before and after each.

As a smoother knows it (Rauch, Tung and Striebel 1965). With links that are nearly exact a state can
hardly move while its neighbours are held, but all states of a throw can move together, each in
proportion to the next one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.segmented_estimation.chaotic_states import change


@dataclass(frozen=True, eq=False)
class KnownStates:
    """What is known of one state of each of r throws by all before its own segment.

    Parameters
    ----------
    centres : (r, 13) of the least loss
    precisions : (r, 12, 12) about them
    deviations : (r, 12) standard deviations by all points, also those after it
    """

    centres: NDArray[np.float64]
    precisions: NDArray[np.float64]
    deviations: NDArray[np.float64]

    def losses(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Losses (r, m) of `states` (r, m, 13), if all before follow."""
        changes = change(states, self.centres[:, None])
        losses = 0.5 * np.einsum("rmi,rij,rmj->rm", changes, self.precisions, changes)
        return np.asarray(np.maximum(losses, 0.0))

    def scores(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Gradients (r, m, 12) of these losses at `states` (r, m, 13)."""
        return change(states, self.centres[:, None]) @ self.precisions


@dataclass(frozen=True, eq=False)
class SmoothedStates:
    """The states of A throws of up to K segments near a path, θ_s held.

    Parameters
    ----------
    covariances : (A, K, 12, 12) of each state
    precisions : (A, K, 12, 12) of each state, by what was seen and linked before its own segment
    gains : (A, K, 12, 12) change of each state (rows) with that of the next one (columns)
    """

    covariances: NDArray[np.float64]
    precisions: NDArray[np.float64]
    gains: NDArray[np.float64]

    def drawn(
        self,
        throws: NDArray[np.int64],
        segments: NDArray[np.int64],
        scales: NDArray[np.float64],
        generator: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Draw changes (r, M, 12) of one state of each of r throws.

        `throws` (r,) and `segments` (r,) by their indices; `scales` (M,) of the draws.
        """
        values, vectors = np.linalg.eigh(self.covariances[throws, segments])
        factors = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
        normal = generator.normal(size=(throws.size, scales.size, values.shape[1]))
        return np.asarray((scales[:, None] * normal) @ factors.swapaxes(1, 2), dtype=np.float64)

    def before(self, throw: int, segment: int, moves: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the changes (segment, 12) of all states before one that moves by `moves` (12,)."""
        changes = np.empty((segment, moves.size))
        for k in reversed(range(segment)):
            moves = changes[k] = self.gains[throw, k] @ moves
        return changes
