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
    best_interception,
    comes_to_rest,
    enters_region,
    falls_below,
    joined_forecasts,
    touches,
)

LARGEST_TIME_STEP = 0.01
"""Largest step, in s, between the times at which events are searched. Our choice."""


SHARE = 500_000
"""Numbers of a prediction that are searched for an event at once at most: 80 MB and half a second.
Our choice."""


class Event(Enum):
    """Event that a question asks for."""

    ENTERS_REGION = "enters_region"
    TOUCHES = "touches"
    FALLS_BELOW = "falls_below"
    COMES_TO_REST = "comes_to_rest"
    INTERCEPTS = "intercepts"


@dataclass(frozen=True, eq=False)
class Question:
    """Question for the probability and the time of an event.

    Parameters
    ----------
    event : each takes those of the fields below that its function in `queries` or
        `interception` has
    object_id : object of the event
    region : region of `ENTERS_REGION` and `INTERCEPTS`
    other_id : object, plane or box of `TOUCHES`
    height : m, of `FALLS_BELOW`
    reach, earliest : m and s, of `INTERCEPTS`, as in `best_interception`
    sample_count, horizon : number and s; 0: as in the prediction
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
    """Probability and times of an event.

    Parameters
    ----------
    position : (3,) m, of an interception; None for other events
    time : s, of an interception
    """

    forecast: EventForecast
    position: NDArray[np.float64] | None = None
    time: float = 0.0


def answer(question: Question, made: LivePrediction) -> Answer:
    """Answer from the samples of a prediction, repeated with orientations.

    Raises
    ------
    UnknownNameError
        When no object, plane or box has a name in the question.
    InvalidInputError
        When a number or the region is invalid.
    PredictionFailedError
        When no sample could be simulated to the end.
    """
    options = made.settings.options
    horizon = question.horizon or options.horizon
    made.distribution.index(question.object_id)
    made.settings.check_horizon(horizon)
    distribution = made.repeat(
        output_times(horizon, min(options.time_step, LARGEST_TIME_STEP, horizon)),
        question.sample_count or options.sample_count,
    )
    if question.event is Event.INTERCEPTS:
        return _interception(question, distribution)
    forecasts = []
    for part in distribution.parts(SHARE):
        made.settings.simulator.stop_flag.check()
        forecasts.append(_forecast(question, part, made))
    return Answer(joined_forecasts(forecasts))


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
    best = best_interception(
        distribution,
        question.object_id,
        question.region,
        question.reach,
        earliest=question.earliest,
    )
    happens = best.probability > 0.0
    when, weights = (np.array([value][:happens]) for value in (best.time, best.probability))
    return Answer(EventForecast(best.probability, when, weights), best.position, best.time)
