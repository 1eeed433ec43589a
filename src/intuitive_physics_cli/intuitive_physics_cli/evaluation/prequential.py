"""Predictions that know only what came before: of states, and of what was learned.

The initial state of an observation, and its smoothed trajectory, know what came after them. Here
perception's own fit and the predictor's estimate follow the detections frame by frame up to a
moment, and what is to be predicted is the detections after it. The shape of an object and the
environment are those of the observation; how a box or capsule lies and turns at its start, too, as
detections do not say.

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
from intuitive_physics.shapes import Box, Capsule, Sphere
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
from intuitive_physics_predictor.estimation.object_estimate import SceneEstimate, Surroundings
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

FIRST_PART = 0.3
"""s after the start of an observation: how long each object is seen before it is predicted."""

AFTER_BOUNCE = 6
"""Detections from a bounce to the second moment at which it is predicted."""

LONGEST_WAIT = 0.7
"""s after such a moment within which perception has to know the states of all objects."""

ROUNDING = 1e-3
"""s. A frame that is earlier than such a moment by less counts as at it."""

APPROACH, DEPARTURE, NEAR = 0.3, 0.1, 0.1
"""m/s towards a plane, m/s away from it after that, and m from it: together they are a bounce."""

GROWTH = 2
"""Factor by which the observations have to grow in number until θ_s is learned again."""


@dataclass(frozen=True, eq=False)
class Frame:
    """Perception's states and detections of the objects at one time.

    Parameters
    ----------
    time : s
    states : of each, from its detections up to then
    detections : of each, those since the frame before; None where there are none
    """

    time: float
    states: tuple[ObjectState, ...]
    detections: tuple[Detections | None, ...]


@dataclass(frozen=True, eq=False)
class SeenPart:
    """An observation as it was known at a moment in it.

    Parameters
    ----------
    left : begins at that moment, with the states that were known then, and has the detections after
        it. An observation without detections is as it was.
    frames : up to that moment, in which the states of all objects were known; none without
        detections
    """

    left: Observation
    frames: tuple[Frame, ...] = ()

    def estimates(
        self, uncertain: UncertainParameters, simulator: Simulator, rng: np.random.Generator
    ) -> tuple[WeightedStates | None, ...]:
        """Return the predictor's estimates of the objects by the frames; nothing without any."""
        surroundings = Surroundings(self.left.environment, uncertain, simulator)
        things = [item.object for item in self.left.objects]
        estimate = SceneEstimate(rng)
        states: tuple[WeightedStates | None, ...] = ()
        for frame in self.frames:
            updates = estimate.updates(
                surroundings, things, frame.states, frame.time, frame.detections
            )
            states = tuple(updates)
        return states


def after_first_part(observation: Observation, settings: PerceptionSettings) -> SeenPart | None:
    """Cut an observation after `FIRST_PART`; None: too little is known, or nothing comes later."""
    if any(item.detections is None for item in observation.objects):
        return SeenPart(observation)
    return _seen_until(observation, observation.start_time + FIRST_PART, settings)


def after_first_bounce(observation: Observation, settings: PerceptionSettings) -> SeenPart | None:
    """Cut an observation when each ball was detected `AFTER_BOUNCE` times after its first bounce.

    None where that is too little, nothing comes later, or not all objects are detected balls that
    bounced.
    """
    moments = [_moment_after_bounce(item, observation.environment) for item in observation.objects]
    known = [moment for moment in moments if moment is not None]
    return _seen_until(observation, max(known), settings) if len(known) == len(moments) else None


def _moment_after_bounce(item: ObservedObject, environment: Environment) -> float | None:
    """Time in s of the last of `AFTER_BOUNCE` detections of a ball since it bounced off a plane."""
    detections, shape = item.detections, item.object.shape
    if detections is None or not isinstance(shape, Sphere):
        return None
    moments = []
    for plane in environment.planes:
        gaps = detections.positions @ plane.normal - plane.offset - shape.radius
        speeds = np.diff(gaps) / np.diff(detections.times)
        # The bounce itself may make one of these speeds anything.
        towards = np.minimum(speeds[1:-1], speeds[:-2]) < -APPROACH
        turns = 2 + np.flatnonzero(towards & (speeds[2:] > DEPARTURE) & (gaps[2:-1] < NEAR))
        if turns.size and turns[0] + AFTER_BOUNCE < len(detections):
            moments.append(float(detections.times[turns[0] + AFTER_BOUNCE]))
    return min(moments, default=None)


def _seen_until(
    observation: Observation, earliest: float, settings: PerceptionSettings
) -> SeenPart | None:
    """An observation at the first frame from `earliest` (s) on at which all states are known.

    The part before it knows no later detection.
    """
    detected = [item.detections for item in observation.objects if item.detections is not None]
    times = np.unique(np.concatenate([found.times for found in detected]))
    frames: list[Frame] = []
    since = -np.inf
    for time in times[times <= earliest + LONGEST_WAIT + ROUNDING]:
        states = _states(observation, detected, float(time), settings)
        if states is None:
            continue
        new = tuple(_between(found, since, time) for found in detected)
        frames.append(Frame(float(time), states, new))
        since = time
        if time >= earliest - ROUNDING:
            left = _left(observation, detected, frames[-1])
            return None if left is None else SeenPart(left, tuple(frames))
    return None


def _states(
    observation: Observation,
    detected: Sequence[Detections],
    time: float,
    settings: PerceptionSettings,
) -> tuple[ObjectState, ...] | None:
    """The states of all objects by perception's fit to what was detected up to a time in s."""
    states = []
    for item, detections in zip(observation.objects, detected, strict=True):
        if detections.times[0] > time:
            return None
        record = _record(item, detections, detections.times <= time, observation.start_time)
        free = FreeMotion(record, observation.environment)
        state = free.state_at(time, settings)
        if state is None:
            return None
        states.append(state)
    return tuple(states)


def _left(
    observation: Observation, detected: Sequence[Detections], now: Frame
) -> Observation | None:
    """The observation from a frame on; None where an object is not seen after it."""
    later = [_between(detections, now.time, np.inf) for detections in detected]
    objects = [
        ObservedObject(item.object, Trajectory(left.times, left.positions), state, left)
        for item, state, left in zip(observation.objects, now.states, later, strict=True)
        if left is not None
    ]
    if len(objects) < len(later):
        return None
    return Observation(observation.environment, tuple(objects), now.time, observation.id)


def _between(detections: Detections, since: float, until: float) -> Detections | None:
    """Detections with since < time ≤ until, without a spin, which is that of the last one."""
    which = (detections.times > since) & (detections.times <= until)
    if not which.any():
        return None
    return Detections(
        detections.times[which],
        detections.positions[which],
        detections.covariances[which],
        detections.bias,
    )


def _record(
    item: ObservedObject,
    detections: Detections,
    which: NDArray[np.bool_],
    start: float,
) -> Record:
    times, positions = detections.times[which], detections.positions[which]
    return Record(
        item.object,
        times,
        positions,
        detections.covariances[which],
        detections.bias,
        _attitudes(item, times - start),
        times,
        positions,
    )


def _attitudes(item: ObservedObject, since: NDArray[np.float64]) -> tuple[Attitude, ...] | None:
    """Attitudes of a box or capsule at times (n,) s after its initial state; None: a ball."""
    shape, state = item.object.shape, item.initial_state
    if not isinstance(shape, Box | Capsule):
        return None
    first = Attitude(
        rotation_matrix(state.orientation), state.angular_velocity, _turning(state), shape
    )
    return tuple(first.after(float(time)) for time in since)


def _turning(state: ObjectState) -> NDArray[np.float64]:
    """Covariance (6, 6) of rotation and angular velocity, as an `Attitude` has it."""
    covariance = np.empty((6, 6))
    parts = ((ROTATION_PART, ROTATION), (VELOCITY_PART, ANGULAR_VELOCITY))
    for rows, own_rows in parts:
        for columns, own_columns in parts:
            covariance[rows, columns] = state.covariance[own_rows, own_columns]
    return covariance


@dataclass(frozen=True, eq=False)
class Predicted:
    """Predictions of observations from two moments in each.

    Parameters
    ----------
    observations : as they were known after their first part, those that could be predicted
    cases : of all their objects
    bounced : of all objects, from after their first bounce on, of observations with one
    left_out : observations that could not be predicted after their first part
    """

    observations: tuple[Observation, ...] = ()
    cases: tuple[PredictionCase, ...] = ()
    bounced: tuple[PredictionCase, ...] = ()
    left_out: int = 0

    def __add__(self, other: Predicted) -> Predicted:
        return Predicted(
            self.observations + other.observations,
            self.cases + other.cases,
            self.bounced + other.bounced,
            self.left_out + other.left_out,
        )


def predict_seen_parts(
    observations: Sequence[Observation],
    learned: LearnedParameters,
    simulator: Simulator,
    rng: np.random.Generator,
    sample_count: int,
) -> Predicted:
    """Predict observations after their first part and after their first bounce.

    Each prediction begins as the predictor does, with its estimate from all frames until then, and
    draws from the posterior of θ_s, which has all materials of the observations.
    """
    settings, uncertain = PerceptionSettings(), UncertainParameters(learned)

    def predict(parts: Sequence[SeenPart]) -> tuple[PredictionCase, ...]:
        left = [part.left for part in parts]
        estimates = [part.estimates(uncertain, simulator, rng) for part in parts]
        return tuple(
            predict_cases(left, uncertain, simulator, rng, sample_count, estimates=estimates)
        )

    begun = [
        part for observation in observations if (part := after_first_part(observation, settings))
    ]
    bounced = [
        part for observation in observations if (part := after_first_bounce(observation, settings))
    ]
    return Predicted(
        tuple(part.left for part in begun),
        predict(begun),
        predict(bounced),
        len(observations) - len(begun),
    )


def predict_before_learning(
    observations: Sequence[Observation],
    options: LearningOptions,
    simulator: Simulator,
    rng: np.random.Generator,
    sample_count: int = 100,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Predicted:
    """Predict each observation with what was learned from those before it.

    θ_s is learned from the first observation, the first two, four, eight and so on, and predicts
    all up to the next time; before the first, nothing is known of it. The result is in the order of
    time. `on_progress` is called with the observations done and the observations in all.
    """
    ordered = sorted(observations, key=lambda observation: observation.start_time)
    materials = observation_materials(ordered)
    learned = LearnedParameters.defaults(materials)
    predicted, first = Predicted(), 0
    while first < len(ordered):
        if first > 0:
            known = learn(ordered[:first], simulator, options, previous=learned).learned
            learned = known.extended(materials)
        following = ordered[first : max(GROWTH * first, 1)]
        predicted += predict_seen_parts(following, learned, simulator, rng, sample_count)
        first = max(GROWTH * first, 1)
        on_progress(min(first, len(ordered)), len(ordered))
    return predicted
