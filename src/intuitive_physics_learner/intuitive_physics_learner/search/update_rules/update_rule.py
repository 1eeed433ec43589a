"""The interface of all update rules: ask for candidates, tell their costs (Algorithm 1)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.validation import finite_array, positive_float


class UpdateRule(ABC):
    """Proposes points of the unit cube, one generation after the other.

    A generation is all that a rule can propose before it needs to know a cost. `ask` returns it in
    portions, so the candidates and their order do not depend on how many are asked for at once.
    They depend on what the rule is made with and on the costs that it was given, and on nothing
    else: a rule that was made alike and is given the same costs goes on as this one does.

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
        self._start: NDArray[np.float64] | None = None
        if start is not None:
            self._start = np.clip(finite_array(start, "start of the search", (size,)), 0.0, 1.0)
        self._generation_count = 0
        self._generation: NDArray[np.float64] | None = None
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
        if self._pending:
            raise InvalidInputError(
                f"asked before the costs of {self._pending} candidates were given; expected tell() "
                "first"
            )
        if self._generation is None:
            if self._generation_count == 0 and self._start is not None:
                self._generation = self._start[None, :]
            else:
                self._generation = self.propose()
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

    def _random_points(self, count: int) -> NDArray[np.float64]:
        return self._generator.random((count, self.size))

    @abstractmethod
    def propose(self) -> NDArray[np.float64]:
        """Return the next generation, shape (k, n); k = 0 when there is nothing left to try."""

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        """Take the costs of a whole generation; by default nothing depends on them.

        Parameters
        ----------
        points : (k, n) of the unit cube
        costs : (k,) m
        """
        return
