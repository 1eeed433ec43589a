"""Parameter search (Algorithm 1): propose θ'_s, simulate, keep what lowers J, until ξ is met."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.update_rules import UpdateRule

CostFunction = Callable[[Sequence[StaticParameters]], NDArray[np.float64]]
"""J of several candidates, shape (n_candidates,), in m."""

LARGEST_BATCH = 50
"""Candidates evaluated at once at most; between batches a search can be stopped."""


class SearchSpace(Protocol):
    """What a search needs of `ParameterSpace`, or of a part of it."""

    @property
    def size(self) -> int:
        """Number of parameters that are searched."""

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point of the unit cube, shape (size,), to θ_s."""


class StopReason(str, Enum):
    """Why a search ended."""

    MAX_ITERATIONS = "max_iterations"
    NO_GAIN = "no_gain"
    COST_THRESHOLD = "cost_threshold"
    TIME_LIMIT = "time_limit"
    CANCELLED = "cancelled"
    EXHAUSTED = "exhausted"


@dataclass(frozen=True)
class ConvergenceCriteria:
    """ξ of Algorithm 1; the search ends when any of them is met. None: no such criterion.

    Parameters
    ----------
    max_iterations : evaluations of J
    max_iterations_without_gain : evaluations of J since it last fell by `relative_gain`
    cost_threshold : m; J below this is good enough
    time_limit : s of wall time
    relative_gain : part of J by which it must fall to count as a gain

    Raises
    ------
    InvalidInputError
        When a number is out of its range, or nothing bounds the search.
    """

    max_iterations: int | None = 2000
    max_iterations_without_gain: int | None = None
    cost_threshold: float | None = None
    time_limit: float | None = None
    relative_gain: float = 1e-4

    def __post_init__(self) -> None:
        for name in ("max_iterations", "max_iterations_without_gain"):
            count = getattr(self, name)
            if count is not None and count < 1:
                raise InvalidInputError(f"{name} is {count}; expected at least 1")
        for name in ("cost_threshold", "time_limit"):
            number = getattr(self, name)
            if number is not None and not number >= 0.0:
                raise InvalidInputError(f"{name} is {number}; expected a number ≥ 0")
        if not 0.0 <= self.relative_gain < 1.0:
            raise InvalidInputError(
                f"relative gain is {self.relative_gain}; expected at least 0 and below 1"
            )
        limits = (self.max_iterations, self.max_iterations_without_gain, self.time_limit)
        if all(limit is None for limit in limits):
            raise InvalidInputError(
                "nothing bounds the search; expected max_iterations, "
                "max_iterations_without_gain or time_limit"
            )


@dataclass(frozen=True)
class SearchProgress:
    """What a search tells while it runs.

    Parameters
    ----------
    iteration : evaluations of J so far
    best_cost : lowest J so far, m
    new_costs : lowest J after each iteration since the last progress, m
    seconds : since the search began
    seconds_left : until it ends at the latest, as far as known; infinite when nothing bounds it
    """

    iteration: int
    best_cost: float
    new_costs: tuple[float, ...]
    seconds: float
    seconds_left: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search found.

    Parameters
    ----------
    parameters : θ_s of the lowest J
    cost : that J, m
    history : (iterations,) lowest J after each evaluation, m
    stop_reason : which criterion ended it
    seconds : wall time
    """

    parameters: StaticParameters
    cost: float
    history: NDArray[np.float64]
    stop_reason: StopReason
    seconds: float

    @property
    def iterations(self) -> int:
        """Number of evaluations of J."""
        return int(self.history.size)


class ParameterSearch:
    """A search that can run, be asked for its state, and continue from it exactly.

    Parameters
    ----------
    cost : J, evaluated in batches
    space : maps the rule's unit cube to θ_s
    rule : update rule of the size of the space
    """

    def __init__(self, cost: CostFunction, space: SearchSpace, rule: UpdateRule) -> None:
        if rule.size != space.size:
            raise InvalidInputError(
                f"update rule searches {rule.size} parameters; expected {space.size}"
            )
        self._cost = cost
        self._space = space
        self._rule = rule
        self._best_point: NDArray[np.float64] | None = None
        self._history: list[float] = []
        self._gain_iteration = 0
        self._gain_cost = np.inf

    @property
    def iterations(self) -> int:
        """Evaluations of J so far."""
        return len(self._history)

    @property
    def best_cost(self) -> float:
        """Lowest J so far in m; infinite before the first."""
        return self._history[-1] if self._history else np.inf

    @property
    def best_parameters(self) -> StaticParameters:
        """θ_s of the lowest J so far.

        Raises
        ------
        InvalidInputError
            When nothing was evaluated yet.
        """
        if self._best_point is None:
            raise InvalidInputError("nothing was evaluated yet; expected step() or run() first")
        return self._space.to_parameters(self._best_point)

    def step(self, limit: int, relative_gain: float = 0.0) -> int:
        """Evaluate up to `limit` candidates at once; return how many there were."""
        points = self._rule.ask(limit)
        if len(points) == 0:
            return 0
        costs = self._cost([self._space.to_parameters(point) for point in points])
        self._rule.tell(costs)
        for point, cost in zip(points, costs.tolist(), strict=True):
            if cost < self.best_cost:
                self._best_point = point
            self._history.append(min(cost, self.best_cost))
            if cost < self._gain_cost * (1.0 - relative_gain):
                self._gain_cost = cost
                self._gain_iteration = self.iterations
        return len(points)

    def run(
        self,
        criteria: ConvergenceCriteria,
        *,
        on_progress: Callable[[SearchProgress], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> SearchResult:
        """Step until a criterion is met or `cancelled` returns True; at least one step.

        Iterations of a state that was loaded count, seconds do not.
        """
        began = time.monotonic()
        reason = None
        while reason is None:
            before = self.iterations
            limit = LARGEST_BATCH
            if criteria.max_iterations is not None:
                limit = max(1, min(limit, criteria.max_iterations - before))
            evaluated = self.step(limit, criteria.relative_gain)
            seconds = time.monotonic() - began
            if on_progress is not None and evaluated:
                on_progress(self._progress(before, seconds, criteria))
            reason = self._stop_reason(criteria, seconds, evaluated == 0, cancelled)
        return SearchResult(
            self.best_parameters,
            self.best_cost,
            np.array(self._history),
            reason,
            time.monotonic() - began,
        )

    def state_dict(self) -> dict[str, Any]:
        """Plain data from which a search over the same space and cost continues exactly."""
        point = self._best_point
        return {
            "rule": self._rule.state_dict(),
            "best_point": None if point is None else point.tolist(),
            "history": list(self._history),
            "gain_iteration": self._gain_iteration,
            # JSON has no infinity.
            "gain_cost": self._gain_cost if self._history else None,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Continue from what `state_dict` returned."""
        self._rule.load_state(state["rule"])
        point = state["best_point"]
        self._best_point = None if point is None else np.array(point)
        self._history = list(state["history"])
        self._gain_iteration = state["gain_iteration"]
        self._gain_cost = np.inf if state["gain_cost"] is None else state["gain_cost"]

    def _stop_reason(
        self,
        criteria: ConvergenceCriteria,
        seconds: float,
        exhausted: bool,
        cancelled: Callable[[], bool] | None,
    ) -> StopReason | None:
        without_gain = self.iterations - self._gain_iteration
        if cancelled is not None and cancelled():
            return StopReason.CANCELLED
        if criteria.cost_threshold is not None and self.best_cost < criteria.cost_threshold:
            return StopReason.COST_THRESHOLD
        if _reached(self.iterations, criteria.max_iterations):
            return StopReason.MAX_ITERATIONS
        if _reached(without_gain, criteria.max_iterations_without_gain):
            return StopReason.NO_GAIN
        if _reached(seconds, criteria.time_limit):
            return StopReason.TIME_LIMIT
        return StopReason.EXHAUSTED if exhausted else None

    def _progress(
        self, before: int, seconds: float, criteria: ConvergenceCriteria
    ) -> SearchProgress:
        left = np.inf
        if criteria.time_limit is not None:
            left = max(0.0, criteria.time_limit - seconds)
        if criteria.max_iterations is not None:
            pace = seconds / max(1, self.iterations)
            left = min(left, pace * max(0, criteria.max_iterations - self.iterations))
        return SearchProgress(
            self.iterations, self.best_cost, tuple(self._history[before:]), seconds, float(left)
        )


def _reached(value: float, limit: float | None) -> bool:
    return limit is not None and value >= limit
