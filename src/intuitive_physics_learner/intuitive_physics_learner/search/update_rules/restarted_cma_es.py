"""CMA-ES that starts again where it has converged, by the package pycma."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.search.update_rules.cma_es import CmaEs

GROWTH = 2
"""Of the population, with each restart."""


class RestartedCmaEs(CmaEs):
    """CMA-ES that never ends: converged, it starts from a random point with twice the population.

    Auger and Hansen (2005), *A restart CMA evolution strategy with increasing population size*.
    Settings are those of `CmaEs`.
    """

    name = "restarted_cma_es"

    def _begin(self) -> None:
        self._population = int(self.settings["population"])
        super()._begin()

    def _tell(self, points: list[NDArray[np.float64]], costs: list[float]) -> None:
        super()._tell(points, costs)
        if self._strategy.stop():
            self._population *= GROWTH
            mean = self._random_points(1)[0]
            self._strategy = self._new_strategy(mean, self._population)
