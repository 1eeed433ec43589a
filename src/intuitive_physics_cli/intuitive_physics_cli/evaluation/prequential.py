"""Predictions that know only what came before: of states, and of what was learned.

The initial state of an observation, and its smoothed trajectory, know what came after them. Here
the state is estimated by perception's own fit to the detections of the first part alone, and what
is to be predicted is the detections after it. The shape of an object and the environment are those
of the observation; how a box or capsule lies and turns at its start, too, as detections do not say.

Prequential: of each observation, in the order of time, only those before it were learned from
(Dawid: Statistical theory, the prequential approach, J. R. Statist. Soc. A 147, 1984).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import (
    Detections,
    Observation,
    ObservedObject,
    observation_materials,
)
from intuitive_physics.scene import Environment
from intuitive_physics.shapes import Box, Capsule
from intuitive_physics.simulation import Simulator
from intuitive_physics.state import ANGULAR_VELOCITY, ROTATION, ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase, predict_cases
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.attitude import (
    ROTATION_PART,
    VELOCITY_PART,
    Attitude,
)
from intuitive_physics_perception.tracking.free_motion import FreeMotion, Record
from intuitive_physics_perception.tracking.initial_state import state_at
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

FIRST_PART, LONGEST_FIRST_PART = 0.3, 1.0
"""s after the start of an observation: how long each object is seen before it is predicted, and for
how long at most where perception does not know its state by then."""

ROUNDING = 1e-3
"""s. A frame that is earlier than the end of the first part by less counts as at it."""

GROWTH = 2
"""Factor by which the observations have to grow in number until θ_s is learned again."""


@dataclass(frozen=True, eq=False)
class FirstParts:
    """Observations as they were known after their first part.

    Parameters
    ----------
    observations : each begins at the end of its first part, with the states that were known then,
        and has the detections after it. One without detections is as it was.
    left_out : number of those whose states were not known in time, or that ended before
    """

    observations: tuple[Observation, ...]
    left_out: int


def after_first_parts(
    observations: Sequence[Observation], settings: PerceptionSettings | None = None
) -> FirstParts:
    """Return what is left to predict of each observation, from what had been seen by then.

    Parameters
    ----------
    settings : of the perception that observed; default: its defaults
    """
    how = settings or PerceptionSettings()
    known = [after_first_part(seen, how) for seen in observations]
    kept = tuple(seen for seen in known if seen is not None)
    return FirstParts(kept, len(known) - len(kept))


def after_first_part(seen: Observation, settings: PerceptionSettings) -> Observation | None:
    """Return an observation from the first frame on at which its states are known; None: never.

    The first part lasts for `FIRST_PART` at least. Its end is the time of the states, of which
    neither they nor the observation returned know any later detection.
    """
    detected = [one.detections for one in seen.objects if one.detections is not None]
    if len(detected) < len(seen.objects):
        return seen
    times = np.unique(np.concatenate([found.times for found in detected]))
    since = times - seen.start_time + ROUNDING
    for end in times[(since >= FIRST_PART) & (since <= LONGEST_FIRST_PART)]:
        if not all((found.times > end).any() for found in detected):
            return None
        objects = [
            _from(one, found, seen.environment, seen.start_time, float(end), settings)
            for one, found in zip(seen.objects, detected, strict=True)
        ]
        known = tuple(one for one in objects if one is not None)
        if len(known) == len(objects):
            return Observation(seen.environment, known, float(end), seen.id)
    return None


def _from(
    seen: ObservedObject,
    detections: Detections,
    environment: Environment,
    start: float,
    end: float,
    settings: PerceptionSettings,
) -> ObservedObject | None:
    """The object from `end` (s) on, None where its state is not known then.

    Parameters
    ----------
    start : s, of the observation
    """
    record = _record(seen, detections, detections.times <= end, start, settings)
    free = FreeMotion(record, environment, settings.initial_state, settings.motion)
    state = state_at(record, end, free, settings)
    if state is None:
        return None
    later = detections.times > end
    left = Detections(
        detections.times[later],
        detections.positions[later],
        detections.covariances[later],
        detections.bias,
    )
    return ObservedObject(seen.object, Trajectory(left.times, left.positions), state, left)


def _record(
    seen: ObservedObject,
    detections: Detections,
    which: NDArray[np.bool_],
    start: float,
    settings: PerceptionSettings,
) -> Record:
    times, positions = detections.times[which], detections.positions[which]
    return Record(
        seen.object,
        times,
        positions,
        detections.covariances[which],
        detections.bias,
        _attitudes(seen, times - start, settings),
        times,
        positions,
    )


def _attitudes(
    seen: ObservedObject, since: NDArray[np.float64], settings: PerceptionSettings
) -> tuple[Attitude, ...] | None:
    """How a box or capsule lies and turns at times (n,) s after its initial state; None: a ball."""
    shape, state = seen.object.shape, seen.initial_state
    if not isinstance(shape, Box | Capsule):
        return None
    first = Attitude(
        rotation_matrix(state.orientation), state.angular_velocity, _turning(state), shape
    )
    noise = settings.motion.angular_acceleration_noise
    return tuple(first.after(float(time), noise) for time in since)


def _turning(state: ObjectState) -> NDArray[np.float64]:
    """Covariance (6, 6) of rotation and angular velocity, as an `Attitude` has it."""
    covariance = np.empty((6, 6))
    parts = ((ROTATION_PART, ROTATION), (VELOCITY_PART, ANGULAR_VELOCITY))
    for rows, own_rows in parts:
        for columns, own_columns in parts:
            covariance[rows, columns] = state.covariance[own_rows, own_columns]
    return covariance


def predict_before_learning(
    observations: Sequence[Observation],
    options: LearningOptions,
    simulator: Simulator,
    rng: np.random.Generator,
    sample_count: int = 100,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[PredictionCase], int]:
    """Predict each observation after its first part, with what was learned from those before it.

    θ_s is learned from the first observation, the first two, four, eight and so on, and predicts
    all up to the next time; before the first, nothing is known of it. The posterior of θ_s and the
    covariance of the states are drawn from, as the predictor does.

    Parameters
    ----------
    options : how to learn
    on_progress : called with the observations done and the observations in all

    Returns
    -------
    cases : of all objects of all observations, in the order of time
    left_out : observations that could not be predicted, as in `FirstParts`
    """
    ordered = sorted(observations, key=lambda seen: seen.start_time)
    materials = observation_materials(ordered)
    learned = LearnedParameters.defaults(materials)
    cases: list[PredictionCase] = []
    left_out, first = 0, 0
    while first < len(ordered):
        if first > 0:
            known = learn(ordered[:first], simulator, options, previous=learned).learned
            learned = known.extended(materials)
        parts = after_first_parts(ordered[first : max(GROWTH * first, 1)])
        cases += predict_cases(
            parts.observations, UncertainParameters(learned), simulator, rng, sample_count
        )
        left_out += parts.left_out
        first = max(GROWTH * first, 1)
        on_progress(min(first, len(ordered)), len(ordered))
    return cases, left_out
