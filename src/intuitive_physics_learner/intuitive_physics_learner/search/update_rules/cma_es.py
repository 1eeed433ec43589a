"""CMA-ES (Sec. III-D, [20]), by pycma."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.errors import MissingDependencyError
from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule


class CmaEs(UpdateRule):
    """Samples generations from a normal distribution that it fits to the best of each.

    It starts from the given point, else from the middle of the cube, and has no more candidates
    once pycma finds the search converged.

    Raises
    ------
    MissingDependencyError
        When pycma is not installed.
    """

    name = "cma_es"

    defaults: ClassVar[Mapping[str, float]] = {"step_size": 0.2, "population": 20}
    """step_size: σ, first standard deviation on the unit interval; population: λ, candidates in a
    generation."""

    def _prepare(self) -> None:
        try:
            import cma
        except ImportError:
            raise MissingDependencyError(
                "the update rule cma_es needs the package pycma, which is not installed; "
                "install it with: pip install cma"
            ) from None
        self._strategy = cma.CMAEvolutionStrategy(
            np.full(self.size, 0.5) if self._start is None else self._start,
            self.settings["step_size"],
            {
                "bounds": [0.0, 1.0],
                "popsize": int(self.settings["population"]),
                "randn": lambda *shape: self._generator.standard_normal(shape),
                # NaN: leave NumPy's global generator alone.
                "seed": np.nan,
                "verbose": -9,
                "signals_filename": "",
            },
        )

    def propose(self) -> NDArray[np.float64]:
        if self._strategy.stop():
            return np.empty((0, self.size))
        return np.array(self._strategy.ask())

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        if self._generation_count == 0 and self._start is not None:
            return
        self._strategy.tell(list(points), costs.tolist())
