"""Coordinate descent (Sec. III-D): one parameter after the other over all its grid values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.search.update_rules.climbing_rule import ClimbingRule
from intuitive_physics_learner.search.update_rules.grid_search import grid_levels


class CoordinateDescent(ClimbingRule):
    """Sweeps over all parameters, each sweep in a new random order.

    Parameters
    ----------
    increment : δp, step of a parameter on the unit interval (Table I: 0.05)
    """

    name = "coordinate_descent"

    def __init__(
        self,
        size: int,
        generator: np.random.Generator,
        start: ArrayLike | None = None,
        *,
        increment: float = 0.05,
    ) -> None:
        super().__init__(size, generator, start, increment=increment)
        self._levels = grid_levels(self.settings["increment"])
        self._order: list[int] = generator.permutation(size).tolist()
        self._position = 0

    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        points = np.tile(point, (self._levels.size, 1))
        points[:, self._order[self._position]] = self._levels
        return points

    def _after(self, gained: bool) -> None:
        self._position += 1
        if self._position == self.size:
            self._order = self._generator.permutation(self.size).tolist()
            self._position = 0

    def own_state(self) -> dict[str, Any]:
        return {**super().own_state(), "order": list(self._order), "position": self._position}

    def load_own_state(self, state: dict[str, Any]) -> None:
        super().load_own_state(state)
        self._order = list(state["order"])
        self._position = state["position"]
