"""Learn from a part of recorded observations, predict the rest, compare with knowing nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment
from intuitive_physics.simulation import pack_worlds
from intuitive_physics.simulation.spheres.roots import first_fall_quadratic
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import finite_array
from intuitive_physics_cli.plugins import make_engine
from intuitive_physics_learner.learning_session import LearningOptions, LearningResult, learn
from intuitive_physics_learner.search.convergence import SearchProgress


def free_flight(
    environment: Environment, radius: float, state: ObjectState, times: ArrayLike
) -> NDArray[np.float64]:
    """Positions (n, 3) m of a ball that stops at the first plane, at `times` (n,) s."""
    flown = np.minimum(
        finite_array(times, "times", (None,)), _contact_time(environment, radius, state)
    )
    since = flown[:, None]
    return state.position + since * state.linear_velocity + 0.5 * since**2 * environment.gravity


def _contact_time(environment: Environment, radius: float, state: ObjectState) -> float:
    contacts = [
        first_fall_quadratic(
            float(plane.signed_distances(state.position)) - radius,
            float(plane.normal @ state.linear_velocity),
            float(plane.normal @ environment.gravity),
        )
        for plane in environment.planes
    ]
    return min(contacts, default=np.inf)


Item = TypeVar("Item")

Paths: TypeAlias = list[list[NDArray[np.float64]]]
"""Positions (n, 3) m of each object of each observation."""


@dataclass(frozen=True)
class Errors:
    """Distances of predictions from observed positions, over some observations.

    Parameters
    ----------
    mean : m, mean over objects of D̄ (Eq. 6): J of Eq. 8
    last : m, mean over objects of the distance at the last observed point
    """

    mean: float
    last: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The result of an evaluation.

    Parameters
    ----------
    training, test : observations learned from and not learned from
    result : what was learned and how the search went
    errors : for each way to predict, its errors in training and in the test
    """

    training: tuple[Observation, ...]
    test: tuple[Observation, ...]
    result: LearningResult
    errors: dict[str, tuple[Errors, Errors]]


def evaluate(
    observations: Sequence[Observation],
    options: LearningOptions,
    train_fraction: float = 0.8,
    engine: str = "auto",
    on_progress: Callable[[SearchProgress], None] | None = None,
    start: StaticParameters | None = None,
) -> Evaluation:
    """Split at random (by the options' seed), learn from one part, predict both.

    Learning starts from θ_s `start` and is compared with it; None: the defaults.
    """
    training, test = split(observations, train_fraction, options.seed)
    starting = None if start is None else _not_learned(start)
    result = learn(
        training, make_engine(engine), options, previous=starting, on_progress=on_progress
    )
    learned = result.learned.parameters
    default = StaticParameters.uniform(learned.materials) if start is None else start
    predictors: dict[str, Callable[[Sequence[Observation]], Paths]] = {
        "learned parameters": lambda part: _simulate(part, learned, engine),
        "default parameters": lambda part: _simulate(part, default, engine),
        "free flight": lambda part: [_fly(observation) for observation in part],
    }
    errors = {
        name: (_errors(training, predict(training)), _errors(test, predict(test)))
        for name, predict in predictors.items()
    }
    return Evaluation(tuple(training), tuple(test), result, errors)


def split(
    observations: Sequence[Item], train_fraction: float, seed: int
) -> tuple[list[Item], list[Item]]:
    """Return two parts, each with at least one observation, in their first order."""
    if not 0.0 < train_fraction < 1.0:
        raise InvalidInputError(
            f"train fraction is {train_fraction:g}; expected a number above 0 and below 1"
        )
    count = len(observations)
    if count < 2:
        raise InvalidInputError(
            f"there is {count} observation; expected at least 2, to learn from one and to test "
            "with another"
        )
    learned_from = min(max(round(train_fraction * count), 1), count - 1)
    chosen = set(np.random.default_rng(seed).permutation(count)[:learned_from].tolist())
    training = [item for i, item in enumerate(observations) if i in chosen]
    test = [item for i, item in enumerate(observations) if i not in chosen]
    return training, test


def _not_learned(parameters: StaticParameters) -> LearnedParameters:
    return replace(LearnedParameters.defaults(parameters.materials), parameters=parameters)


def _simulate(
    observations: Sequence[Observation], parameters: StaticParameters, engine: str
) -> Paths:
    """Simulated positions (n, 3) m at the times each object was observed."""
    simulator = make_engine(engine)
    simulated = []
    for observation in observations:
        instants = np.unique(
            np.concatenate([_times(observation, j) for j in range(len(observation.objects))])
        )
        worlds = pack_worlds([observation.scene()], parameters)
        positions = simulator.rollout_batch(worlds, instants, orientations=False).positions[0]
        simulated.append(
            [
                positions[j, np.searchsorted(instants, _times(observation, j))]
                for j in range(len(observation.objects))
            ]
        )
    return simulated


def _fly(observation: Observation) -> list[NDArray[np.float64]]:
    return [
        free_flight(
            observation.environment,
            observed_object.object.shape.bounding_radius,
            observed_object.initial_state,
            _times(observation, j),
        )
        for j, observed_object in enumerate(observation.objects)
    ]


def _errors(observations: Sequence[Observation], predicted: Paths) -> Errors:
    means, lasts = [], []
    for observation, positions in zip(observations, predicted, strict=True):
        for observed_object, path in zip(observation.objects, positions, strict=True):
            observed = observed_object.trajectory.positions[-len(path) :]
            distances = np.linalg.norm(path - observed, axis=1)
            means.append(distances.mean())
            lasts.append(distances[-1])
    return Errors(float(np.mean(means)), float(np.mean(lasts)))


def _times(observation: Observation, index: int) -> NDArray[np.float64]:
    """Times in s after the observation's start of the points of one object that come after it."""
    since = observation.objects[index].trajectory.times - observation.start_time
    # Stamps and clocks are rounded: a hair before the start is at the start.
    return np.maximum(since[since >= -1e-6], 0.0)
