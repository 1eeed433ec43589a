"""Improving θ_s in slices: search, compare J on the same observations, store what is better."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import observation_materials
from intuitive_physics.settings import check_settings, choice, number
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.methods import DEFAULT_METHOD, METHODS
from intuitive_physics_learner.search.convergence import (
    ConvergenceCriteria,
    SearchProgress,
    StopReason,
)
from intuitive_physics_learner.store import ObservationStore
from intuitive_physics_learner.stored_learning import StoredSearch


@dataclass(frozen=True)
class SliceSettings:
    """How background learning divides a search. None of the defaults has a derivation."""

    first_slice: int = number(
        100,
        1,
        10_000_000,
        "evaluations of J before the first comparison; the next slice is twice as long while one "
        "takes less than half of `longest_slice`",
    )
    longest_slice: float = number(
        8.0, 0.0, 1e6, "CPU time of a slice; observations that arrive meanwhile wait", unit="s"
    )
    smallest_gain: float = number(
        1e-3, 0.0, 1.0, "part of J by which it must fall to be worth a new version"
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class OnlineOptions:
    """How to learn in the background. Ranges are those that a user of the node may give.

    Parameters
    ----------
    seed : of all randomness
    """

    method: str = choice(DEFAULT_METHOD, METHODS, "of the search in the background")
    seed: int = 0
    seconds: float = number(
        30.0,
        0.1,
        1e6,
        "CPU time for searching in the background at most after each new observation",
        unit="s",
    )
    iterations_without_gain: int = number(
        2000,
        1,
        10_000_000,
        "evaluations of J without gain after which learning in the background waits for the next "
        "observation",
    )

    def __post_init__(self) -> None:
        check_settings(self)

    def learning_options(self) -> LearningOptions:
        """Return the options of the search that these stand for."""
        return LearningOptions(
            method=self.method,
            criteria=ConvergenceCriteria(
                max_iterations=None,
                max_iterations_without_gain=self.iterations_without_gain,
            ),
            seed=self.seed,
        )


class OnlineSearch:
    """The search over all observations that a store holds now, in slices.

    It starts from the newest θ_s. After each slice the J of what was found is compared with that of
    the newest θ_s on the same observations, and it is stored as the next version if it is better.
    The state of the search is stored too, so it continues after the process was killed, until it
    has converged or its time is up.

    Parameters
    ----------
    store : of the observations, at least one
    simulator : the engine that simulates candidates
    options : how to learn
    slices : how to divide the search; None for the defaults

    Raises
    ------
    NoObservationsError, UnknownMethodError, UnsupportedSceneError, StorageError
        As `learn_from_store`, from the methods too.
    """

    def __init__(
        self,
        store: ObservationStore,
        simulator: Simulator,
        options: OnlineOptions,
        slices: SliceSettings | None = None,
    ) -> None:
        self._slices = slices or SliceSettings()
        self._store = store
        self._options = options
        self._revision = store.revision()
        self._observations = store.observations()
        self._newest = store.newest_parameters()
        self._search = StoredSearch(
            store,
            "online",
            self._observations,
            simulator,
            options.learning_options(),
            clock=time.process_time,
        )
        self._slice = self._slices.first_slice
        known = () if self._newest is None else self._newest.materials
        seen = observation_materials(self._observations)
        self._materials = tuple(dict.fromkeys((*known, *seen)))
        self._cost = TrajectoryCost(self._observations, simulator, self._materials)
        self._newest_cost = self._cost_of(self._newest or LearnedParameters.defaults(seen))

    @property
    def finished(self) -> bool:
        """Whether the search over these observations has ended."""
        return self._search.finished

    @property
    def outdated(self) -> bool:
        """Whether the store holds other observations, or another newest θ_s, than the search."""
        return (self._store.revision(), self._store.newest_version()) != (
            self._revision,
            self._version,
        )

    def run_slice(
        self,
        *,
        on_progress: Callable[[SearchProgress], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> LearnedParameters | None:
        """Search for one slice; return the new version, or None when there was no improvement."""
        before = self._search.seconds
        criteria = ConvergenceCriteria(
            max_iterations=self._search.iterations + self._slice,
            max_iterations_without_gain=self._options.iterations_without_gain,
        )
        result = self._search.run(criteria, on_progress=on_progress, cancelled=cancelled)
        if self._search.seconds - before < 0.5 * self._slices.longest_slice:
            self._slice *= 2
        improved = self._stored_if_better(result.learned)
        converged = result.search.stop_reason is not StopReason.MAX_ITERATIONS
        self._search.save(
            self._version, finished=converged or self._search.seconds >= self._options.seconds
        )
        return improved

    @property
    def _version(self) -> int:
        return 0 if self._newest is None else self._newest.version

    def _stored_if_better(self, found: LearnedParameters) -> LearnedParameters | None:
        cost = self._cost_of(found)
        if cost >= self._newest_cost * (1.0 - self._slices.smallest_gain):
            return None
        improved = self._store.add_improvement(found, on=self._version)
        if improved is not None:
            self._newest, self._newest_cost = improved, cost
        return improved

    def _cost_of(self, learned: LearnedParameters) -> float:
        """J of a version of θ_s on these observations, m."""
        return float(self._cost.costs([learned.parameters.extended(self._materials)])[0])
