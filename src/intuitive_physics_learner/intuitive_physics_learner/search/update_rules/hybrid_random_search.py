"""Hybrid-random search (Sec. III-D): hybrid search first, then adaptive random search."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.search.update_rules.adaptive_random_search import (
    AdaptiveRandomSearch,
)
from intuitive_physics_learner.search.update_rules.hybrid_search import HybridSearch
from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule


class HybridRandomSearch(UpdateRule):
    """Switches from hybrid to adaptive random search after some sweeps over the parameters.

    Parameters
    ----------
    sweeps : s, how often as many parameters as there are get targeted before the switch
        (Table I: 5)
    random_iterations, learning_rate, smallest_step : as in `HybridSearch`
    """

    name = "hybrid_random"

    def __init__(
        self,
        size: int,
        generator: np.random.Generator,
        start: ArrayLike | None = None,
        *,
        sweeps: int = 5,
        random_iterations: int = 300,
        learning_rate: float = 0.1,
        smallest_step: float = 0.001,
    ) -> None:
        steps = {"learning_rate": learning_rate, "smallest_step": smallest_step}
        super().__init__(
            size, generator, start, sweeps=sweeps, random_iterations=random_iterations, **steps
        )
        self._hybrid = HybridSearch(size, generator, random_iterations=random_iterations, **steps)
        self._adaptive = AdaptiveRandomSearch(size, generator, **steps)

    def propose(self) -> NDArray[np.float64]:
        return self._adaptive.propose() if self._switched else self._hybrid.propose()

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        if self._switched:
            self._adaptive.update(points, costs)
            return
        self._hybrid.update(points, costs)
        if self._switched:
            self._hybrid.hand_over(self._adaptive)

    @property
    def _switched(self) -> bool:
        return self._hybrid.sweeps_done >= self.settings["sweeps"]

    def own_state(self) -> dict[str, Any]:
        return {"hybrid": self._hybrid.own_state(), "adaptive": self._adaptive.own_state()}

    def load_own_state(self, state: dict[str, Any]) -> None:
        self._hybrid.load_own_state(state["hybrid"])
        self._adaptive.load_own_state(state["adaptive"])
