"""Hybrid rules (Sec. III-D): random search first, then descent from the best point it found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.search.update_rules.grid_and_random_search import GENERATION
from intuitive_physics_learner.search.update_rules.single_point_search import (
    AdaptiveRandomSearch,
    ClimbingRule,
    ParameterGradientSearch,
)
from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule


class HybridSearch(UpdateRule):
    """Follows the gradient of single parameters from the best of some random points."""

    name = "hybrid"

    defaults: ClassVar[Mapping[str, float]] = {
        "random_iterations": 300,
        "learning_rate": 0.1,
        "smallest_step": 0.001,
    }
    """random_iterations: i, evaluations of J before the switch; others as
    `ParameterGradientSearch`."""

    remembered = ("_evaluated",)

    def _prepare(self) -> None:
        self._gradient = ParameterGradientSearch(
            self.size,
            self._generator,
            learning_rate=self.settings["learning_rate"],
            smallest_step=self.settings["smallest_step"],
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
        return {**super().own_state(), "gradient": self._gradient.own_state()}

    def load_own_state(self, state: dict[str, Any]) -> None:
        super().load_own_state(state)
        self._gradient.load_own_state(state["gradient"])


class HybridRandomSearch(UpdateRule):
    """Switches from hybrid to adaptive random search after some sweeps over the parameters."""

    name = "hybrid_random"

    defaults: ClassVar[Mapping[str, float]] = {"sweeps": 5, **HybridSearch.defaults}
    """sweeps: s, how often as many parameters as there are get targeted before the switch;
    others as `HybridSearch`."""

    def _prepare(self) -> None:
        of_hybrid = {key: self.settings[key] for key in HybridSearch.defaults}
        self._hybrid = HybridSearch(self.size, self._generator, **of_hybrid)
        self._adaptive = AdaptiveRandomSearch(self.size, self._generator)

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
