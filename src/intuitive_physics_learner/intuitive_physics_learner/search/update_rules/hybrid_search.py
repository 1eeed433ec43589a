"""Hybrid rules (Sec. III-D): random search first, then descent from the best point it found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.search.update_rules.grid_and_random_search import GENERATION
from intuitive_physics_learner.search.update_rules.single_point_search import (
    AdaptiveRandomSearch,
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

    def _prepare(self) -> None:
        self._gradient = ParameterGradientSearch(
            self.size,
            self._generator,
            learning_rate=self.settings["learning_rate"],
            smallest_step=self.settings["smallest_step"],
        )
        self._evaluated = 0

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


class HybridRandomSearch(HybridSearch):
    """Switches from hybrid to adaptive random search after some sweeps over the parameters."""

    name = "hybrid_random"

    defaults: ClassVar[Mapping[str, float]] = {"sweeps": 5, **HybridSearch.defaults}
    """sweeps: s, how often as many parameters as there are get targeted before the switch;
    others as `HybridSearch`."""

    def _prepare(self) -> None:
        super()._prepare()
        self._adaptive = AdaptiveRandomSearch(self.size, self._generator)

    def propose(self) -> NDArray[np.float64]:
        return self._adaptive.propose() if self._switched else super().propose()

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        if self._switched:
            self._adaptive.update(points, costs)
            return
        super().update(points, costs)
        if self._switched and self._gradient.point is not None:
            self._adaptive.continue_from(self._gradient.point, self._gradient.cost)

    @property
    def _switched(self) -> bool:
        return self._gradient.targets_done // self.size >= self.settings["sweeps"]
