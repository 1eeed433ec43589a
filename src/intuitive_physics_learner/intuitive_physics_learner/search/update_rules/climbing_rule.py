"""What all rules share that improve on one current point."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule


class ClimbingRule(UpdateRule):
    """A rule that starts from one point, random unless given, and moves where J is lower.

    Attributes
    ----------
    point : (n,) current point of the unit cube; None before the first
    cost : J in m at the current point
    """

    def __init__(
        self,
        size: int,
        generator: np.random.Generator,
        start: ArrayLike | None = None,
        **settings: float,
    ) -> None:
        super().__init__(size, generator, start, **settings)
        self.point: NDArray[np.float64] | None = None
        self.cost = np.inf

    def continue_from(self, point: NDArray[np.float64], cost: float) -> None:
        """Take over the point, shape (n,), and cost in m that another rule reached."""
        self.point = point.copy()
        self.cost = cost

    def propose(self) -> NDArray[np.float64]:
        if self.point is None:
            return self._random_points(1)
        return self._neighbours(self.point)

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        first = self.point is None
        best = int(np.argmin(costs))
        gained = bool(costs[best] < self.cost)
        if gained:
            self.point = points[best].copy()
            self.cost = float(costs[best])
        if not first:
            self._after(gained)

    @abstractmethod
    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return candidates, shape (k, n), made from the current point, shape (n,)."""

    def _after(self, gained: bool) -> None:
        """Prepare what comes next, knowing whether the last candidates brought a gain."""

    def own_state(self) -> dict[str, Any]:
        return {
            "point": None if self.point is None else self.point.tolist(),
            # JSON has no infinity.
            "cost": None if self.point is None else self.cost,
        }

    def load_own_state(self, state: dict[str, Any]) -> None:
        self.point = None if state["point"] is None else np.array(state["point"])
        self.cost = np.inf if state["cost"] is None else state["cost"]
