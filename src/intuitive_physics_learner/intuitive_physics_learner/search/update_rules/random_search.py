"""Random search (Sec. III-D): every parameter uniform over its range, nothing remembered."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule

GENERATION = 50


class RandomSearch(UpdateRule):
    """Uniform points of the unit cube."""

    name = "random"

    def propose(self) -> NDArray[np.float64]:
        return self._random_points(GENERATION)

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        pass

    def own_state(self) -> dict[str, Any]:
        return {}

    def load_own_state(self, state: dict[str, Any]) -> None:
        pass
