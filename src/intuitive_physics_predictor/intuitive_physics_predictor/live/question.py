"""A question about the newest prediction, and its answer."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.regions import BoxRegion, Region
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.live.live_prediction import LivePrediction
from intuitive_physics_predictor.live.settings import output_times
from intuitive_physics_predictor.queries.events import (
    EventForecast,
    comes_to_rest,
    enters_region,
    falls_below,
    touches,
)
from intuitive_physics_predictor.queries.interception import best_interception

LARGEST_TIME_STEP = 0.01
"""s between the points that are looked at, however far apart those published are."""


class Event(Enum):
    """What is asked for."""

    ENTERS_REGION = "enters_region"
    TOUCHES = "touches"
    FALLS_BELOW = "falls_below"
    COMES_TO_REST = "comes_to_rest"
    INTERCEPTS = "intercepts"


@dataclass(frozen=True, eq=False)
class Question:
    """How likely is an event, and when?

    Parameters
    ----------
    event : each takes those of the fields below that its function in `queries` or
        `interception` has
    object_id : that it is about
    sample_count, horizon : 0: as the prediction that is asked
    """

    event: Event
    object_id: str
    region: Region | None = None
    other_id: str = ""
    height: float = 0.0
    reach: float = 0.0
    earliest: float = 0.0
    sample_count: int = 0
    horizon: float = 0.0


@dataclass(frozen=True, eq=False)
class Answer:
    """Chance and times of the event; where it is an interception, also its place and time."""

    forecast: EventForecast
    position: NDArray[np.float64] | None = None
    time: float = 0.0


def answer(question: Question, made: LivePrediction) -> Answer:
    """Answer from the samples of a prediction, simulated again with orientations.

    Raises
    ------
    UnknownNameError
        When no object, plane or box has a name that is asked about.
    InvalidInputError
        When a number or the region is not what it must be.
    PredictionFailedError
        When no sample could be simulated to the end.
    """
    settings = made.settings
    horizon = question.horizon or settings.horizon
    made.distribution.index(question.object_id)
    distribution = made.again(
        output_times(horizon, min(settings.time_step, LARGEST_TIME_STEP, horizon)),
        question.sample_count or settings.sample_count,
    )
    if question.event is Event.INTERCEPTS:
        return _interception(question, distribution)
    return Answer(_forecast(question, distribution, made))


def _forecast(
    question: Question, distribution: TrajectoryDistribution, made: LivePrediction
) -> EventForecast:
    name = question.object_id
    match question.event:
        case Event.TOUCHES:
            return touches(distribution, made.scene, name, question.other_id)
        case Event.FALLS_BELOW:
            gravity = made.scene.environment.gravity
            return falls_below(distribution, name, question.height, gravity)
        case Event.COMES_TO_REST:
            return comes_to_rest(distribution, made.scene, name)
    if question.region is None:
        raise InvalidInputError("question has no region; expected one that is entered")
    return enters_region(distribution, name, question.region)


def _interception(question: Question, distribution: TrajectoryDistribution) -> Answer:
    if not isinstance(question.region, BoxRegion):
        raise InvalidInputError(
            f"region is {type(question.region).__name__}; expected a box that can be reached"
        )
    found = best_interception(
        distribution,
        question.object_id,
        question.region,
        question.reach,
        earliest=question.earliest,
    )
    happens = found.probability > 0.0
    when, weights = (np.array([value][:happens]) for value in (found.time, found.probability))
    return Answer(EventForecast(found.probability, when, weights), found.position, found.time)
