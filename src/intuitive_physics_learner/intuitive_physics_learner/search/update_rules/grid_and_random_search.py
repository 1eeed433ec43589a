"""Grid search and random search (Sec. III-D): rules whose candidates depend on no cost."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice, product
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule

GENERATION = 50
"""Points proposed at once; no cost decides what comes next, so it only bounds the memory."""


class GridSearch(UpdateRule):
    """Counts through the grid, the first parameter changing fastest."""

    name = "grid"

    defaults: ClassVar[Mapping[str, float]] = {"increment": 0.05}
    """increment: δp, step of each parameter on the unit interval."""

    def _prepare(self) -> None:
        self._points = product(grid_levels(self.settings["increment"]), repeat=self.size)

    def propose(self) -> NDArray[np.float64]:
        # The last factor of a product changes fastest.
        points = np.array([*islice(self._points, GENERATION)])
        return points.reshape(-1, self.size)[:, ::-1]


def grid_levels(increment: float) -> NDArray[np.float64]:
    """The 1/δp values of a parameter, δp apart, in the middle of the interval, shape (n_levels,).

    The paper gives their number and not where they lie: with the middles of 1/δp equal parts, none
    of the interval is further than δp / 2 from one of them.
    """
    count = max(1, int(1.0 / increment + 1e-9))
    steps = np.arange(count, dtype=np.float64) - 0.5 * (count - 1)
    return np.asarray(0.5 + increment * steps)


class RandomSearch(UpdateRule):
    """Uniform points of the unit cube."""

    name = "random"

    def propose(self) -> NDArray[np.float64]:
        return self._random_points(GENERATION)
