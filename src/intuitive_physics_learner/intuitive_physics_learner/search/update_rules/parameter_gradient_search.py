"""Parameter gradient search (Sec. III-D): follow one random parameter while it brings gain."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.search.update_rules.climbing_rule import ClimbingRule


class ParameterGradientSearch(ClimbingRule):
    """Adds δp to one parameter as long as J falls, else turns around with half the step.

    Parameters
    ----------
    learning_rate : α, first step on the unit interval (Table I: 0.1)
    smallest_step : β, below which the next parameter is targeted (Table I: 0.001)

    Attributes
    ----------
    targets_done : how many parameters were followed to their end
    """

    name = "parameter_gradient"

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
        self._step = self.settings["learning_rate"]
        self._target = int(generator.integers(size))
        self.targets_done = 0

    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = point.copy()
        moved[self._target] = np.clip(moved[self._target] + self._step, 0.0, 1.0)
        return moved[None, :]

    def _after(self, gained: bool) -> None:
        if gained:
            return
        self._step = -0.5 * self._step
        if abs(self._step) < self.settings["smallest_step"]:
            self._step = self.settings["learning_rate"]
            self._target = int(self._generator.integers(self.size))
            self.targets_done += 1

    def own_state(self) -> dict[str, Any]:
        return {
            **super().own_state(),
            "step": self._step,
            "target": self._target,
            "targets_done": self.targets_done,
        }

    def load_own_state(self, state: dict[str, Any]) -> None:
        super().load_own_state(state)
        self._step = state["step"]
        self._target = state["target"]
        self.targets_done = state["targets_done"]
