"""Parameter search (Algorithm 1): propose θ'_s, simulate, accept what lowers J, until ξ is met."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics_learner.search.convergence import (
    ConvergenceCriteria,
    SearchProgress,
    SearchResult,
    StopReason,
)
from intuitive_physics_learner.search.learning_task import LearningTask
from intuitive_physics_learner.search.plain_state import Resumable
from intuitive_physics_learner.search.search_space import SearchSpace
from intuitive_physics_learner.search.update_rules import UpdateRule

CostFunction = Callable[[Sequence[StaticParameters]], NDArray[np.float64]]
"""J of several candidates, shape (n_candidates,), in m."""

LARGEST_BATCH = 50
"""Candidates evaluated at once at most; between batches the criteria are looked at."""

CHECKPOINT_PERIOD = 1.0
"""s between two states that a search hands out while it runs."""

LARGEST_CHECKPOINT_SHARE = 0.05
"""Part of a search's time that may be spent on handing out its state, as to store it."""

RELATIVE_GAIN = 1e-4
"""Part of J by which it must fall to count as a gain; set by hand."""


class Search(Resumable, ABC):
    """A search that can run, return its state, and continue from that exactly."""

    remembered: ClassVar[tuple[str, ...]] = ("_history", "_gain_iteration", "_gain_cost")

    def __init__(self) -> None:
        self._history: list[float] = []
        self._gain_iteration = 0
        self._gain_cost = np.inf

    @property
    def iterations(self) -> int:
        """Evaluations of J so far."""
        return len(self._history)

    @property
    def best_cost(self) -> float:
        """J in m of `best_parameters`; infinite before the first evaluation."""
        return self._history[-1] if self._history else np.inf

    @property
    @abstractmethod
    def best_parameters(self) -> StaticParameters:
        """The estimate of θ_s, of the lowest J so far unless the search has a better reason."""

    @abstractmethod
    def keep_start(self, task: LearningTask) -> bool:
        """Go back to the task's start where it explains the observations better; return whether.

        A search that is stopped early must not replace a θ_s by a worse one.
        """

    def plan(self, criteria: ConvergenceCriteria) -> None:
        """Prepare for what limits the search, before the first evaluation of J."""
        return

    def conclude(self) -> None:
        """Choose the result at the end of `run`, where there is a choice left to make."""
        return

    def initial_spins(self) -> InitialSpins:
        """Return how balls were thrown in the observations; what is not known is left out."""
        return InitialSpins()

    @abstractmethod
    def step(self, limit: int) -> int:
        """Evaluate J up to `limit` times; return how often, 0 when nothing is left to do."""

    def run(
        self,
        criteria: ConvergenceCriteria,
        *,
        on_progress: Callable[[SearchProgress], None] | None = None,
        on_checkpoint: Callable[[dict[str, Any]], None] | None = None,
        reserve: Callable[[float], float] = lambda seconds: 0.0,
    ) -> SearchResult:
        """Step until a criterion is met; at least one step.

        Iterations of a state that was loaded count, seconds do not; where it has met a criterion no
        step is taken.

        Parameters
        ----------
        on_checkpoint : called with the `state` at most every `CHECKPOINT_PERIOD`, less often where
            it takes long, and at the end
        reserve : given the s that the search has taken, returns the s of the time limit to leave
            for what comes after it
        """
        began = time.monotonic()
        next_checkpoint = began + CHECKPOINT_PERIOD
        reason = self._stop_reason(criteria, 0.0, False) if self.iterations else None
        if not self.iterations:
            self.plan(criteria)
        while reason is None:
            before = self.iterations
            limit = LARGEST_BATCH
            if criteria.max_iterations is not None:
                limit = max(1, min(limit, criteria.max_iterations - before))
            evaluated = self.step(limit)
            seconds = time.monotonic() - began
            if on_progress is not None and evaluated:
                on_progress(self._progress_since(before, seconds, criteria))
            now = time.monotonic()
            if on_checkpoint is not None and now >= next_checkpoint:
                on_checkpoint(self.state())
                period = (time.monotonic() - now) / LARGEST_CHECKPOINT_SHARE
                next_checkpoint = now + max(CHECKPOINT_PERIOD, period)
            spent = seconds + reserve(seconds)
            reason = self._stop_reason(criteria, spent, evaluated == 0)
        if on_checkpoint is not None:
            on_checkpoint(self.state())
        self.conclude()
        return SearchResult(
            self.best_parameters,
            self.best_cost,
            np.array(self._history),
            reason,
            time.monotonic() - began,
        )

    def _record(self, cost: float) -> None:
        """Count one evaluation of J, that of `best_parameters` being `cost` after it."""
        self._history.append(cost)
        if cost < self._gain_cost * (1.0 - RELATIVE_GAIN):
            self._gain_cost = cost
            self._gain_iteration = self.iterations

    def _stop_reason(
        self, criteria: ConvergenceCriteria, seconds: float, exhausted: bool
    ) -> StopReason | None:
        without_gain = self.iterations - self._gain_iteration
        if criteria.cost_threshold is not None and self.best_cost < criteria.cost_threshold:
            return StopReason.COST_THRESHOLD
        if _reached(self.iterations, criteria.max_iterations):
            return StopReason.MAX_ITERATIONS
        if _reached(without_gain, criteria.max_iterations_without_gain):
            return StopReason.NO_GAIN
        if _reached(seconds, criteria.time_limit):
            return StopReason.TIME_LIMIT
        return StopReason.EXHAUSTED if exhausted else None

    def _progress_since(
        self, before: int, seconds: float, criteria: ConvergenceCriteria
    ) -> SearchProgress:
        left = np.inf
        if criteria.time_limit is not None:
            left = max(0.0, criteria.time_limit - seconds)
        if criteria.max_iterations is not None:
            pace = seconds / max(1, self.iterations)
            left = min(left, pace * max(0, criteria.max_iterations - self.iterations))
        new_costs = tuple(self._history[before:])
        return SearchProgress(self.iterations, self.best_cost, new_costs, float(left))


class ParameterSearch(Search):
    """Algorithm 1 with an update rule.

    Its state is the costs of all candidates: the rule proposes the same candidates again when it is
    given the same costs, which takes some 10 µs each where nothing is simulated.
    """

    def __init__(self, cost: CostFunction, space: SearchSpace, rule: UpdateRule) -> None:
        super().__init__()
        if rule.size != space.size:
            raise InvalidInputError(
                f"update rule searches {rule.size} parameters; expected {space.size}"
            )
        self._cost = cost
        self._space = space
        self._rule = rule
        self._costs: list[float] = []
        self._best_point: NDArray[np.float64] | None = None

    @property
    def best_parameters(self) -> StaticParameters:
        if self._best_point is None:
            raise InvalidInputError("nothing was evaluated yet; expected step() or run() first")
        return self._space.to_parameters(self._best_point)

    def step(self, limit: int) -> int:
        """Evaluate up to `limit` candidates at once; return how many there were."""
        points = self._rule.ask(limit)
        if len(points):
            self._take(points, self._cost([self._space.to_parameters(point) for point in points]))
        return len(points)

    def _take(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        self._rule.tell(costs)
        self._costs += costs.tolist()
        for point, cost in zip(points, costs.tolist(), strict=True):
            if cost < self.best_cost:
                self._best_point = point
            self._record(min(cost, self.best_cost))

    def keep_start(self, task: LearningTask) -> bool:
        (cost,) = self._cost([task.start]).tolist()
        better = bool(cost < self.best_cost)
        if better:
            self._best_point = task.begin
        return better

    def state(self) -> dict[str, Any]:
        return {"costs": list(self._costs)}

    def load_state(self, state: Mapping[str, Any]) -> None:
        costs = np.array(state["costs"], dtype=np.float64)
        while left := costs.size - self.iterations:
            points = self._rule.ask(left)
            if len(points) == 0:
                raise InvalidInputError(
                    f"{left} costs are left when the rule proposes nothing more; expected those of "
                    "a search by the same rule"
                )
            self._take(points, costs[self.iterations :][: len(points)])


def _reached(value: float, limit: float | None) -> bool:
    return limit is not None and value >= limit
