"""What is known of the states of throws in segments, from the points before and after each.

As a smoother knows it (Rauch, Tung and Striebel 1965). With links that are nearly exact a state can
hardly move while its neighbours are held, but all states of a throw can move together, each in
proportion to the next one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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

    def losses(
        self,
        throws: NDArray[np.int64],
        segments: NDArray[np.int64],
        changes: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Losses (r, M) that changes (r, M, 12) of a state bring before it, if all others follow.

        `throws` (r,) and `segments` (r,) by their indices.
        """
        precisions = self.precisions[throws, segments]
        losses = 0.5 * np.einsum("rmi,rij,rmj->rm", changes, precisions, changes)
        return np.asarray(np.maximum(losses, 0.0))

    def before(self, throw: int, segment: int, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the changes (segment, 12) of all states before one with a `change` (12,)."""
        changes = np.empty((segment, change.size))
        for k in reversed(range(segment)):
            change = changes[k] = self.gains[throw, k] @ change
        return changes
