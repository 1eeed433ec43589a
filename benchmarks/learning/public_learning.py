"""Learning as users do it: the public function, the default method, a limit of wall time."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner import ConvergenceCriteria, LearningOptions, LearningResult, learn

THREADS = 2
"""Of the learner's simulator."""


@dataclass(frozen=True, eq=False)
class Learned:
    """What learning returned.

    Parameters
    ----------
    result : θ_s with its uncertainty, and how the search went
    seconds : wall time of the whole call
    fell_back : whether joint estimation was given up for plain descent of J
    """

    result: LearningResult
    seconds: float
    fell_back: bool

    @property
    def parameters(self) -> LearnedParameters:
        """θ_s with its uncertainty."""
        return self.result.learned


def learn_by_default(
    observations: Sequence[Observation],
    *,
    seconds: float | None = None,
    threads: int = THREADS,
) -> Learned:
    """Learn from the library's defaults by the default method.

    Parameters
    ----------
    observations : at least one
    seconds : limit of wall time, with the uncertainties; None: the limits of the library
    threads : of the simulator
    """
    criteria = ConvergenceCriteria()
    if seconds is not None:
        criteria = ConvergenceCriteria(max_iterations=None, time_limit=seconds)
    states: list[Mapping[str, Any]] = []
    began = time.perf_counter()
    result = learn(
        observations,
        make_simulator("auto", threads=threads),
        LearningOptions(criteria=criteria),
        on_checkpoint=lambda state: states.__setitem__(slice(None), [state]),
    )
    took = time.perf_counter() - began
    return Learned(result, took, _fell_back(states[-1]))


def _fell_back(checkpoint: Mapping[str, Any]) -> bool:
    """Whether the last state of a search says that J itself was lowered."""
    return checkpoint["search"].get("descent") is not None


LEAST_GOOD = 0.5
"""Probability of being good below which an observation counts as flagged."""


def flagged_observations(learned: Learned) -> frozenset[str] | None:
    """Ids of the observations that learning holds for disturbed; None where it assesses none."""
    assessments = getattr(learned.result, "assessments", None)
    if assessments is None:
        return None
    return frozenset(each.id for each in assessments if each.weight < LEAST_GOOD)
