"""The interface of all update rules: ask for candidates, tell their costs (Algorithm 1)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.validation import finite_array, positive_float
from intuitive_physics_learner.search.plain_state import restore, state_of


class UpdateRule(ABC):
    """Proposes points of the unit cube, one generation after the other.

    A generation is all that a rule can propose before it needs to know a cost. `ask` returns it in
    portions, so the candidates and their order do not depend on how many are asked for at once.

    Parameters
    ----------
    size : number of parameters n
    generator : the only source of randomness; owned by the rule from now on
    start : (n,) point of the unit cube proposed before all others; None leaves it to the rule
    settings : numbers above zero, instead of those of `defaults`
    """

    name: ClassVar[str]

    defaults: ClassVar[Mapping[str, float]] = {}
    """Constants of the rule, as in Table I."""

    remembered: ClassVar[tuple[str, ...]] = ()
    """Attributes of plain data that the rule needs to continue; `own_state` has the others."""

    def __init__(
        self,
        size: int,
        generator: np.random.Generator,
        start: ArrayLike | None = None,
        **settings: float,
    ) -> None:
        if size < 1:
            raise InvalidInputError(f"size of the search space is {size}; expected at least 1")
        for key in settings:
            if key not in self.defaults:
                expected = ", ".join(self.defaults) or "none"
                raise UnknownNameError(f"setting of {self.name} is {key!r}; expected {expected}")
        self.size = size
        self.settings = {
            key: positive_float(value, f"{key} of {self.name}")
            for key, value in {**self.defaults, **settings}.items()
        }
        self._generator = generator
        self._start = None if start is None else _unit_point(start, size)
        self._generation_count = 0
        self._generation: NDArray[np.float64] | None = None
        self._generator_before = generator.bit_generator.state
        self._costs: list[float] = []
        self._pending = 0
        self._prepare()

    def _prepare(self) -> None:
        """Set up what the rule remembers, once the settings are known; by default nothing."""
        return

    def ask(self, limit: int) -> NDArray[np.float64]:
        """Return the next candidates, shape (k, n) with k ≤ limit; k = 0 when there are no more.

        Raises
        ------
        InvalidInputError
            When the limit is below one or the costs of the last candidates were not given.
        """
        if limit < 1:
            raise InvalidInputError(f"asked for {limit} candidates; expected at least 1")
        self._check_updated("asked")
        if self._generation is None:
            self._generator_before = self._generator.bit_generator.state
            self._generation = self._next_generation()
        portion = self._generation[len(self._costs) : len(self._costs) + limit]
        self._pending = len(portion)
        return portion.copy()

    def tell(self, costs: ArrayLike) -> None:
        """Take the costs of the candidates that were asked for last.

        Parameters
        ----------
        costs : (k,) m
        """
        values = finite_array(costs, "costs", (self._pending,))
        self._pending = 0
        self._costs += values.tolist()
        if self._generation is not None and len(self._costs) == len(self._generation) > 0:
            self.update(self._generation, np.array(self._costs))
            self._generation_count += 1
            self._generation = None
            self._costs = []

    def state_dict(self) -> dict[str, Any]:
        """Everything a rule of the same kind and settings needs to continue exactly, as plain data.

        Raises
        ------
        InvalidInputError
            When the costs of the last candidates were not given.
        """
        self._check_updated("asked for the state")
        within = self._generation is not None
        return {
            "rule": self.name,
            "size": self.size,
            "settings": dict(self.settings),
            "start": None if self._start is None else self._start.tolist(),
            "generation_count": self._generation_count,
            "generator": self._generator_before if within else self._generator.bit_generator.state,
            "costs": list(self._costs),
            "own": self.own_state(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Continue from what `state_dict` of a rule of the same kind and settings returned.

        Raises
        ------
        InvalidInputError
            When the state is of another rule, size or settings.
        """
        for key, expected in (
            ("rule", self.name),
            ("size", self.size),
            ("settings", self.settings),
        ):
            if state.get(key) != expected:
                raise InvalidInputError(
                    f"state of the search has the {key} {state.get(key)!r}; expected {expected!r}"
                )
        self._start = None if state["start"] is None else _unit_point(state["start"], self.size)
        self._generation_count = state["generation_count"]
        self.load_own_state(state["own"])
        self._generator.bit_generator.state = state["generator"]
        self._generation = None
        self._costs = list(state["costs"])
        self._pending = 0
        if self._costs:
            self._generator_before = state["generator"]
            self._generation = self._next_generation()

    def _next_generation(self) -> NDArray[np.float64]:
        if self._generation_count == 0 and self._start is not None:
            return self._start[None, :].copy()
        return self.propose()

    def _check_updated(self, what: str) -> None:
        if self._pending:
            raise InvalidInputError(
                f"{what} before the costs of {self._pending} candidates were given; "
                "expected tell() first"
            )

    def _random_points(self, count: int) -> NDArray[np.float64]:
        return self._generator.random((count, self.size))

    @abstractmethod
    def propose(self) -> NDArray[np.float64]:
        """Return the next generation, shape (k, n); k = 0 when there is nothing left to try.

        Must change nothing but the generator, so that it can be repeated from a saved state.
        """

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        """Take the costs of a whole generation; by default nothing depends on them.

        Parameters
        ----------
        points : (k, n) of the unit cube
        costs : (k,) m
        """
        return

    def own_state(self) -> dict[str, Any]:
        """Return the part of the state that belongs to this rule, as plain data."""
        return state_of(self, self.remembered)

    def load_own_state(self, state: dict[str, Any]) -> None:
        """Read what `own_state` returned."""
        restore(self, self.remembered, state)


def _unit_point(value: ArrayLike, size: int) -> NDArray[np.float64]:
    return np.clip(finite_array(value, "start of the search", (size,)), 0.0, 1.0)
