"""Adaptive random search (Sec. III-D): random steps as large as the current cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.search.update_rules.climbing_rule import ClimbingRule


class AdaptiveRandomSearch(ClimbingRule):
    """Adds δp = U(-ε, ε) to all parameters at once, ε being J of the current point.

    The paper gives this rule an α and a β in Table I and none in its text. Here they bound the
    step as they do in parameter gradient search: ε, read in metres and taken as a part of the unit
    interval, is held between β and α.

    Parameters
    ----------
    learning_rate : α, largest ε on the unit interval (Table I: 0.1)
    smallest_step : β, smallest ε (Table I: 0.001)
    """

    name = "adaptive_random"

    def __init__(
        self,
        size: int,
        generator: np.random.Generator,
        start: ArrayLike | None = None,
        *,
        learning_rate: float = 0.1,
        smallest_step: float = 0.001,
    ) -> None:
        super().__init__(
            size, generator, start, learning_rate=learning_rate, smallest_step=smallest_step
        )

    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        largest = max(self.settings["learning_rate"], self.settings["smallest_step"])
        epsilon = np.clip(self.cost, self.settings["smallest_step"], largest)
        steps = self._generator.uniform(-epsilon, epsilon, (1, self.size))
        return np.clip(point + steps, 0.0, 1.0)
