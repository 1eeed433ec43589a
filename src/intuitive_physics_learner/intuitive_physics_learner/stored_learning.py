"""Learning from a store: what is learned becomes its next version; killed searches continue."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from intuitive_physics.errors import UnknownNameError, UnsupportedSceneError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import Simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_learner.cost.cost_function import MakeCost, TrajectoryCost
from intuitive_physics_learner.errors import (
    IncompatibleEnvironmentError,
    NoObservationsError,
    SupersededError,
    UnreadableVersionError,
)
from intuitive_physics_learner.learning_session import LearningOptions, LearningResult, learn
from intuitive_physics_learner.methods import JOINT_METHOD, check_method
from intuitive_physics_learner.search.convergence import SearchProgress
from intuitive_physics_learner.store import ObservationStore
from intuitive_physics_learner.store.observation_entries import DOUBTFUL, INCLUDED_BY_USER, USED

PROBE_HEIGHT = 1e3
"""m along the direction against gravity, where a probe touches nothing."""


def check_environments(observations: Sequence[Observation], simulator: Simulator) -> None:
    """Simulate a lone ball of one of its materials in each environment.

    Every engine knows balls, so one that refuses this scene refuses the environment:
    an `IncompatibleEnvironmentError`.
    """
    for observation in observations:
        material = observation.objects[0].object.material
        gravity = np.asarray(observation.environment.gravity)
        up = -gravity / max(float(np.linalg.norm(gravity)), 1e-12)
        probe = Scene(
            observation.environment,
            (SceneObject("probe", material, Sphere(0.01)),),
            (ObjectState(PROBE_HEIGHT * up),),
        )
        neutral = StaticParameters.uniform(probe.materials, static_friction=0.4)
        try:
            simulator.rollout([probe], neutral, np.array([0.0, 1e-3]))
        except UnsupportedSceneError as error:
            raise IncompatibleEnvironmentError(
                f"environment of observation {observation.id} cannot be simulated: {error}"
            ) from None


STATE_FORM = 5
"""Form of the states of searches: one that a program with another form left begins again."""


def learn_from_store(
    store: ObservationStore,
    simulator: Simulator,
    options: LearningOptions,
    *,
    on_progress: Callable[[SearchProgress], None] | None = None,
    make_cost: MakeCost = TrajectoryCost,
) -> LearningResult:
    """Learn from stored observations, starting from the newest θ_s, and store the next version.

    About once a second the state of the search is stored. The same search, started again after it
    was killed or cancelled, continues from there and ends as if it had not stopped; a version of
    θ_s that was stored meanwhile makes it another search.

    Parameters
    ----------
    store : of observations and θ_s
    simulator : the engine that simulates candidates, by whose flag learning is cancelled
    options : how to learn
    on_progress : called after each step of the search
    make_cost : what evaluates J; by default this process

    Raises
    ------
    NoObservationsError
        When nothing is stored.
    UnknownMethodError, UnknownNameError
        When no method or no observation has the name given.
    IncompatibleEnvironmentError, UnsupportedSceneError
        When the simulator cannot express the environment of an observation, or its objects.
    SimulationStoppedError
        When the simulator's flag was set; no version is stored then.
    SupersededError
        When a user gave values meanwhile, which this search knows nothing of.
    StorageError
        When the store cannot be read or written.
    """
    check_method(options.method, options.distance)
    observations, options = _observations(store, options)
    if not observations:
        raise NoObservationsError(
            "no observation is stored yet; add some before learning from them"
        )
    begun, previous = store.newest_version(), store.newest_parameters()
    key = _key(observations, simulator, options)
    saved = store.saved_search(key, begun)
    # A time limit counts from the first start.
    seconds, began = saved.get("seconds", 0.0), time.monotonic()

    def save(state: Mapping[str, Any]) -> None:
        spent = seconds + time.monotonic() - began
        store.save_search(key, begun, {"state": state, "seconds": spent})

    try:
        result = learn(
            observations,
            simulator,
            replace(options, criteria=options.criteria.after(seconds)),
            previous=previous,
            on_progress=on_progress,
            resume=saved.get("state"),
            on_checkpoint=save,
            make_cost=make_cost,
        )
    except UnsupportedSceneError:
        check_environments(observations, simulator)
        raise
    simulator.stop_flag.check()
    stored = _stored(store, result, begun, [each.id for each in observations])
    store.delete_search(key)
    return replace(result, learned=stored)


def _stored(
    store: ObservationStore, result: LearningResult, begun: int, learned_from: Sequence[str]
) -> LearnedParameters:
    """Store what a search found that began from version `begun`, unless values were given since."""
    while True:
        newest = store.newest_version()
        for version in range(begun + 1, newest + 1):
            with suppress(UnknownNameError, UnreadableVersionError):
                if not store.parameters(version).method:
                    raise SupersededError(
                        f"version {version} of the static parameters was given while this search "
                        f"ran, which began from version {begun}; what it found was not stored: "
                        "learn again, which takes account of what was given"
                    )
        stored = store.add_improvement(result.learned, newest, learned_from, result.assessments)
        if stored is not None:
            return stored


def _observations(
    store: ObservationStore, options: LearningOptions
) -> tuple[list[Observation], LearningOptions]:
    """Return those to learn from, with the doubtful ones where these are assessed again.

    Those that the user included, or asked for by their ids, are trusted.
    """
    if options.observation_ids:
        observations = store.observations(options.observation_ids)
        ids = [observation.id for observation in observations]
        return observations, replace(options, trusted_ids=ids)
    if options.method != JOINT_METHOD:
        return store.observations(), options
    pairs = list(store.each_observation((USED, DOUBTFUL)))
    trusted = [entry.id for entry, _ in pairs if entry.reason == INCLUDED_BY_USER]
    return [observation for _, observation in pairs], replace(options, trusted_ids=trusted)


def _key(
    observations: Sequence[Observation], simulator: Simulator, options: LearningOptions
) -> str:
    """Digest of all that determines a search, apart from the θ_s it starts from."""
    parts = {
        "state": STATE_FORM,
        "observations": [observation.id for observation in observations],
        "trusted": list(options.trusted_ids),
        "simulator": simulator.name,
        **options.course,
        "criteria": asdict(options.criteria),
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
