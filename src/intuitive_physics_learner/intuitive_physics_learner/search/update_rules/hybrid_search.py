"""Hybrid search (Sec. III-D): random search first, then parameter gradient search."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.search.update_rules.climbing_rule import ClimbingRule
from intuitive_physics_learner.search.update_rules.parameter_gradient_search import (
    ParameterGradientSearch,
)
from intuitive_physics_learner.search.update_rules.random_search import GENERATION
from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule


class HybridSearch(UpdateRule):
    """Follows the gradient of single parameters from the best of some random points.

    Parameters
    ----------
    random_iterations : i, evaluations of J before the switch (Table I: 300)
    learning_rate, smallest_step : as in `ParameterGradientSearch`
    """

    name = "hybrid"

    def __init__(
        self,
        size: int,
        generator: np.random.Generator,
        start: ArrayLike | None = None,
        *,
        random_iterations: int = 300,
        learning_rate: float = 0.1,
        smallest_step: float = 0.001,
    ) -> None:
        super().__init__(
            size,
            generator,
            start,
            random_iterations=random_iterations,
            learning_rate=learning_rate,
            smallest_step=smallest_step,
        )
        self._gradient = ParameterGradientSearch(
            size, generator, learning_rate=learning_rate, smallest_step=smallest_step
        )
        self._evaluated = 0

    @property
    def sweeps_done(self) -> int:
        """How often as many parameters as there are were followed to their end."""
        return self._gradient.targets_done // self.size

    def propose(self) -> NDArray[np.float64]:
        left = int(self.settings["random_iterations"]) - self._evaluated
        if left > 0:
            return self._random_points(min(left, GENERATION))
        return self._gradient.propose()

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        if self._evaluated >= int(self.settings["random_iterations"]):
            self._gradient.update(points, costs)
            return
        self._evaluated += len(points)
        best = int(np.argmin(costs))
        if costs[best] < self._gradient.cost:
            self._gradient.continue_from(points[best], float(costs[best]))

    def hand_over(self, successor: ClimbingRule) -> None:
        """Let another rule continue from the best point found."""
        if self._gradient.point is not None:
            successor.continue_from(self._gradient.point, self._gradient.cost)

    def own_state(self) -> dict[str, Any]:
        return {"evaluated": self._evaluated, "gradient": self._gradient.own_state()}

    def load_own_state(self, state: dict[str, Any]) -> None:
        self._evaluated = state["evaluated"]
        self._gradient.load_own_state(state["gradient"])
