"""CMA-ES (Sec. III-D, [20]), with full and with diagonal covariance and with restarts, by pycma."""

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

    def _prepare(self) -> None:
        self._first_generator = self._generator.bit_generator.state
        self._strategy: Any = None
        self._begin()
        self._generation_costs: list[list[float]] = []

    def propose(self) -> NDArray[np.float64]:
        if self._strategy.stop():
            return np.empty((0, self.size))
        return np.array(self._strategy.ask())

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        if self._generation_count == 0 and self._start is not None:
            return
        self._update_strategy(list(points), costs.tolist())
        self._generation_costs.append(costs.tolist())

    def own_state(self) -> dict[str, Any]:
        return {"first_generator": self._first_generator, "told": list(self._generation_costs)}

    def load_own_state(self, state: dict[str, Any]) -> None:
        self._first_generator = state["first_generator"]
        self._generator.bit_generator.state = self._first_generator
        self._begin()
        self._generation_costs = list(state["told"])
        for costs in self._generation_costs:
            self._update_strategy(self._strategy.ask(), costs)

    def _begin(self) -> None:
        """Make a strategy without any generation."""
        self._strategy = self._new_strategy(self._first_mean(), int(self.settings["population"]))

    def _update_strategy(self, points: list[NDArray[np.float64]], costs: list[float]) -> None:
        """Tell the strategy the costs of a generation."""
        self._strategy.tell(points, costs)

    def _first_mean(self) -> NDArray[np.float64]:
        return np.full(self.size, 0.5) if self._start is None else self._start

    def _new_strategy(self, mean: NDArray[np.float64], population: int, **options: Any) -> Any:
        try:
            import cma
        except ImportError:
            raise MissingDependencyError(
                "the update rule cma_es needs the package pycma, which is not installed; "
                "install it with: pip install cma"
            ) from None
        return cma.CMAEvolutionStrategy(
            mean,
            self.settings["step_size"],
            {
                "bounds": [0.0, 1.0],
                "popsize": population,
                "randn": lambda *shape: self._generator.standard_normal(shape),
                # NaN: leave NumPy's global generator alone.
                "seed": np.nan,
                "verbose": -9,
                "signals_filename": "",
                **options,
            },
        )


class SeparableCmaEs(CmaEs):
    """CMA-ES that fits a spread of each parameter and no correlations.

    Of n parameters it has n numbers to learn instead of n² / 2, and learns them n / 3 times as
    fast: Ros and Hansen (2008), *A simple modification in CMA-ES achieving linear time and space
    complexity*. Settings are those of `CmaEs`.
    """

    name = "separable_cma_es"

    def _new_strategy(self, mean: NDArray[np.float64], population: int, **options: Any) -> Any:
        return super()._new_strategy(mean, population, CMA_diagonal=True, **options)


GROWTH = 2
"""Factor on the population with each restart."""


class RestartedCmaEs(CmaEs):
    """CMA-ES that never ends: converged, it starts from a random point with twice the population.

    Auger and Hansen (2005), *A restart CMA evolution strategy with increasing population size*.
    Settings are those of `CmaEs`.
    """

    name = "restarted_cma_es"

    def _begin(self) -> None:
        self._population = int(self.settings["population"])
        super()._begin()

    def _update_strategy(self, points: list[NDArray[np.float64]], costs: list[float]) -> None:
        super()._update_strategy(points, costs)
        if self._strategy.stop():
            self._population *= GROWTH
            mean = self._random_points(1)[0]
            self._strategy = self._new_strategy(mean, self._population)
