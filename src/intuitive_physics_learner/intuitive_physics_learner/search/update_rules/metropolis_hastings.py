"""1D-MH (Sec. III-D): a Markov chain that changes one parameter at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule


class MetropolisHastings(UpdateRule):
    """Adds δp = U(-α, α) to one random parameter and accepts as Metropolis and Hastings do.

    A candidate of cost J' replaces the current one of cost J with the chance
    min(1, exp((J - J') / temperature)); the paper names no temperature.

    Parameters
    ----------
    learning_rate : α, largest step on the unit interval (Table I: 0.05)
    temperature : m of cost by which a candidate is accepted with the chance 1/e
    """

    name = "metropolis_hastings"

    def __init__(
        self,
        size: int,
        generator: np.random.Generator,
        start: ArrayLike | None = None,
        *,
        learning_rate: float = 0.05,
        temperature: float = 0.001,
    ) -> None:
        super().__init__(
            size, generator, start, learning_rate=learning_rate, temperature=temperature
        )
        self._point: NDArray[np.float64] | None = None
        self._cost = np.inf

    def propose(self) -> NDArray[np.float64]:
        if self._point is None:
            return self._random_points(1)
        alpha = self.settings["learning_rate"]
        moved = self._point.copy()
        target = self._generator.integers(self.size)
        # Reflected at the bounds, not clipped: else the chain would not be symmetric and stick.
        there = np.abs(moved[target] + self._generator.uniform(-alpha, alpha)) % 2.0
        moved[target] = min(there, 2.0 - there)
        return moved[None, :]

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        rise = max(float(costs[0]) - self._cost, 0.0)
        if self._generator.random() < np.exp(-rise / self.settings["temperature"]):
            self._point = points[0].copy()
            self._cost = float(costs[0])

    def own_state(self) -> dict[str, Any]:
        return {
            "point": None if self._point is None else self._point.tolist(),
            # JSON has no infinity.
            "cost": None if self._point is None else self._cost,
        }

    def load_own_state(self, state: dict[str, Any]) -> None:
        self._point = None if state["point"] is None else np.array(state["point"])
        self._cost = np.inf if state["cost"] is None else state["cost"]
