"""When a search ends (ξ of Algorithm 1), its progress, and its result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters


class StopReason(str, Enum):
    """Why a search ended."""

    MAX_ITERATIONS = "max_iterations"
    NO_GAIN = "no_gain"
    COST_THRESHOLD = "cost_threshold"
    TIME_LIMIT = "time_limit"
    EXHAUSTED = "exhausted"


@dataclass(frozen=True)
class ConvergenceCriteria:
    """ξ of Algorithm 1; the search ends when any of them is met. None: no such criterion.

    Parameters
    ----------
    max_iterations : evaluations of J
    max_iterations_without_gain : evaluations of J since it last fell by 0.01 %
    cost_threshold : m; J below this is good enough
    time_limit : s of wall time; `learn` leaves part of it for the identifiability of the result

    Raises
    ------
    InvalidInputError
        When a number is out of its range, or nothing bounds the search.
    """

    max_iterations: int | None = 2000
    max_iterations_without_gain: int | None = None
    cost_threshold: float | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        for name in ("max_iterations", "max_iterations_without_gain"):
            count = getattr(self, name)
            if count is not None and count < 1:
                raise InvalidInputError(f"{name} is {count}; expected at least 1")
        for name in ("cost_threshold", "time_limit"):
            number = getattr(self, name)
            if number is not None and not number >= 0.0:
                raise InvalidInputError(f"{name} is {number}; expected a number ≥ 0")
        limits = (self.max_iterations, self.max_iterations_without_gain, self.time_limit)
        if all(limit is None for limit in limits):
            raise InvalidInputError(
                "nothing bounds the search; expected max_iterations, "
                "max_iterations_without_gain or time_limit"
            )

    def after(self, seconds: float) -> ConvergenceCriteria:
        """Return the same with what is left of the time limit after some s."""
        if self.time_limit is None:
            return self
        return replace(self, time_limit=max(0.0, self.time_limit - seconds))


@dataclass(frozen=True)
class SearchProgress:
    """The progress of a search, at first of one that has just begun.

    Parameters
    ----------
    iteration : evaluations of J so far
    best_cost : lowest J so far, m
    new_costs : lowest J after each iteration since the last progress, m
    seconds_left : until it ends at the latest, as far as known; infinite when nothing bounds it
    """

    iteration: int = 0
    best_cost: float = np.inf
    new_costs: tuple[float, ...] = ()
    seconds_left: float = np.inf


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Result of a search.

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
