"""Learning on-line as the node's worker does, in this process: an observation at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.stored_online_learning import StoredOnlineLearning


def published_after_each(
    observations: Iterable[Observation], database: Path, seconds: float
) -> Iterator[LearnedParameters]:
    """Yield what is published once each observation was learned from.

    Parameters
    ----------
    observations : of one stream, in their order
    database : of the learner; made where it does not exist
    seconds : of CPU time that may be spent on each
    """
    simulator = make_simulator("auto", threads=1)
    with ObservationStore(database) as store:
        for observation in observations:
            store.add(observation)
            learn_what_is_stored(store, simulator, OnlineOptions(seconds=seconds))
            yield store.newest_parameters() or LearnedParameters.defaults(
                observation_materials([observation])
            )


def learn_what_is_stored(
    store: ObservationStore, simulator: Simulator, options: OnlineOptions
) -> None:
    """Do what the worker does when observations were added."""
    learning = StoredOnlineLearning(store, simulator, options)
    while learning.advance():
        pass
