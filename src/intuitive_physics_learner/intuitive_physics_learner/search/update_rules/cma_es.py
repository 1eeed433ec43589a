"""CMA-ES (Sec. III-D, [20]), by pycma."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.errors import MissingDependencyError
from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule


class CmaEs(UpdateRule):
    """Samples generations from a normal distribution that it fits to the best of each.

    It starts from the given point, else from the middle of the cube, and has no more candidates
    once pycma finds the search converged.

    pycma has no plain state, so the state saved is the costs of all generations: loading it repeats
    the search with these costs, which takes a part of a millisecond a generation and gives the same
    search to the bit.

    Raises
    ------
    MissingDependencyError
        When pycma is not installed.
    """

    name = "cma_es"

    defaults: ClassVar[Mapping[str, float]] = {"step_size": 0.2, "population": 20}
    """step_size: σ, first standard deviation on the unit interval; population: λ, candidates in a
    generation."""

    remembered = ("_first_generator", "_told")

    def _prepare(self) -> None:
        self._first_generator = self._generator.bit_generator.state
        self._strategy = self._new_strategy()
        self._told: list[list[float]] = []

    def propose(self) -> NDArray[np.float64]:
        if self._strategy.stop():
            return np.empty((0, self.size))
        return np.array(self._strategy.ask())

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        if self._generation_count == 0 and self._start is not None:
            return
        self._strategy.tell(list(points), costs.tolist())
        self._told.append(costs.tolist())

    def load_own_state(self, state: dict[str, Any]) -> None:
        super().load_own_state(state)
        self._generator.bit_generator.state = self._first_generator
        self._strategy = self._new_strategy()
        for costs in self._told:
            self._strategy.tell(self._strategy.ask(), costs)

    def _new_strategy(self) -> Any:
        """Make a strategy without any generation."""
        try:
            import cma
        except ImportError:
            raise MissingDependencyError(
                "the update rule cma_es needs the package pycma, which is not installed; "
                "install it with: pip install cma"
            ) from None
        return cma.CMAEvolutionStrategy(
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
