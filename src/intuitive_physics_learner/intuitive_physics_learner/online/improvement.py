"""Improving θ_s a little at a time: search, judge on the same observations, keep what is better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.convergence import (
    ConvergenceCriteria,
    SearchProgress,
    StopReason,
)
from intuitive_physics_learner.cost import TrajectoryCost
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.store import ObservationStore
from intuitive_physics_learner.stored_learning import StoredSearch

FIRST_SLICE = 1.0
"""s of search before what was found is judged for the first time; twice as long each time after."""

LONGEST_SLICE = 8.0
"""s; observations that arrive meanwhile wait until it is over."""

SMALLEST_GAIN = 1e-3
"""Part of J by which it must fall to be worth a new version."""


@dataclass(frozen=True)
class OnlineOptions:
    """How to learn in the background.

    Parameters
    ----------
    method : name of an update rule
    seed : of all randomness
    seconds : of search at most for one set of observations; the next observation makes a new set
    iterations_without_gain : evaluations of J without gain after which a set is left alone
    """

    method: str = "cma_es"
    seed: int = 0
    seconds: float = 30.0
    iterations_without_gain: int = 2000

    def learning_options(self) -> LearningOptions:
        """Return the options of the search that these stand for."""
        return LearningOptions(
            method=self.method,
            criteria=ConvergenceCriteria(
                max_iterations=None,
                max_iterations_without_gain=self.iterations_without_gain,
                time_limit=self.seconds,
            ),
            seed=self.seed,
        )


class OnlineSearch:
    """The search over all observations that a store holds now, in slices.

    It starts from the newest θ_s. After each slice what was found is judged by J, on the same
    observations, against the newest θ_s, and stored as the next version if it is better. Where it
    stands is kept in the store, so it goes on after the process was killed, until it has converged
    or its time is up.

    Parameters
    ----------
    store : of the observations, at least one
    simulator : the engine that simulates candidates
    options : how to learn

    Raises
    ------
    NoObservationsError, UnknownMethodError, UnsupportedSceneError, StorageError
        As `learn_from_store`, from the methods too.
    """

    def __init__(
        self, store: ObservationStore, simulator: Simulator, options: OnlineOptions
    ) -> None:
        self._store = store
        self._simulator = simulator
        self._options = options
        self._observations = store.observations()
        self._newest = store.newest_parameters()
        self._search = StoredSearch(
            store, "online", self._observations, simulator, options.learning_options()
        )
        self._slice = FIRST_SLICE

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do for these observations."""
        return self._search.finished

    @property
    def outdated(self) -> bool:
        """Whether the store has other observations, or another newest θ_s, by now."""
        version = 0 if self._newest is None else self._newest.version
        return (self._store.count(), self._store.newest_version()) != (
            len(self._observations),
            version,
        )

    def run_slice(
        self,
        *,
        on_progress: Callable[[SearchProgress], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> LearnedParameters | None:
        """Search for a while; return the new version, or None when there was no improvement."""
        end = min(self._search.seconds + self._slice, self._options.seconds)
        self._slice = min(2.0 * self._slice, LONGEST_SLICE)
        criteria = ConvergenceCriteria(
            max_iterations=None,
            max_iterations_without_gain=self._options.iterations_without_gain,
            time_limit=end,
        )
        result = self._search.run(criteria, on_progress=on_progress, cancelled=cancelled)
        improved = None
        if self._is_improvement(result.learned):
            known = 0 if self._newest is None else self._newest.version
            improved = self._store.add_improvement(result.learned, on=known)
        self._newest = improved or self._newest
        converged = result.search.stop_reason is not StopReason.TIME_LIMIT
        self._search.keep(
            0 if self._newest is None else self._newest.version,
            finished=converged or self._search.seconds >= self._options.seconds,
        )
        return improved

    def _is_improvement(self, found: LearnedParameters) -> bool:
        newest = self._newest or LearnedParameters.defaults(found.materials)
        cost = TrajectoryCost(self._observations, self._simulator, found.materials)
        before, after = cost.costs([newest.parameters.extended(found.materials), found.parameters])
        return bool(after < before * (1.0 - SMALLEST_GAIN))
