"""Entries of observations: columns besides the JSON text, so that lists are cheap."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation

USED, EXCLUDED, DOUBTFUL, UNREADABLE = "used", "excluded", "doubtful", "unreadable"
"""Status of an observation: learned from; left out by the user; set aside by the learner, which may
take it back; its text cannot be read."""

STATUSES = (USED, EXCLUDED, DOUBTFUL, UNREADABLE)
"""Every status, in the order of lists."""

INCLUDED_BY_USER = "included by the user"
"""Reason of an observation of status `USED` that no learner sets aside."""


@dataclass(frozen=True)
class ObservationEntry:
    """One row of the list of observations.

    Parameters
    ----------
    number : place in the order in which observations came; never given twice
    id : of the observation
    received_at : Unix time in s at which it was stored
    start_time : s, on the clock of its trajectories; None where its text cannot be read
    first_time, last_time : s on that clock, at which any of its objects was seen; None likewise
    materials : of objects and environment, each once
    object_count : moving objects
    point_count : points of all trajectories together
    has_detections : whether one of its objects has detections
    status : one of `STATUSES`
    weight : probability of being a good measurement of an undisturbed motion, 0 to 1
    reason : why it has this status or weight; empty for an observation nothing is known against
    revision : of the store when it was added, excluded, included or given back for learning
    """

    number: int
    id: str
    received_at: float
    start_time: float | None
    first_time: float | None
    last_time: float | None
    materials: tuple[str, ...]
    object_count: int
    point_count: int
    has_detections: bool
    status: str
    weight: float
    reason: str
    revision: int

    @staticmethod
    def from_row(row: tuple[Any, ...]) -> ObservationEntry:
        """Read a row of `COLUMNS`."""
        values = dict(zip(COLUMNS.split(", "), row, strict=True))
        values["materials"] = tuple(json.loads(values["materials"]))
        values["has_detections"] = bool(values["has_detections"])
        return ObservationEntry(**values)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for people and other programs."""
        return {
            "number": self.number,
            "id": self.id,
            "received_at": self.received_at,
            "start_time": self.start_time,
            "materials": list(self.materials),
            "objects": self.object_count,
            "points": self.point_count,
            "status": self.status,
            "weight": self.weight,
            "reason": self.reason,
        }


COLUMNS = ", ".join(field.name for field in fields(ObservationEntry))
"""Columns of the table `observation_entries` that make an entry, in the order of its fields."""


@dataclass(frozen=True)
class Assessment:
    """A learner's assessment of an observation.

    Parameters
    ----------
    id : of the observation
    weight : probability of being a good measurement of an undisturbed motion, 0 to 1
    reason : for people; empty where nothing is wrong
    status : USED or DOUBTFUL
    """

    id: str
    weight: float
    reason: str = ""
    status: str = USED

    def __post_init__(self) -> None:
        if not 0.0 <= self.weight <= 1.0:
            raise InvalidInputError(
                f"weight of observation {self.id} is {self.weight}; expected 0 to 1"
            )
        if self.status not in (USED, DOUBTFUL):
            raise InvalidInputError(
                f"status of observation {self.id} is {self.status!r}; a learner may give "
                f"{USED!r} or {DOUBTFUL!r}"
            )


def entry_columns(observation: Observation) -> tuple[Any, ...]:
    """Return what the columns `start_time` to `has_detections` say of an observation."""
    return (
        observation.start_time,
        *observation.time_span,
        json.dumps(list(observation.materials)),
        len(observation.objects),
        sum(len(each.trajectory) for each in observation.objects),
        any(each.detections is not None for each in observation.objects),
    )


def readable_observations(texts: Iterable[str]) -> list[Observation]:
    """Return the observations of JSON texts that can be read."""
    parsed = map(parsed_observation, texts)
    return [observation for observation in parsed if isinstance(observation, Observation)]


def parsed_observation(text: str) -> Observation | InvalidInputError:
    """Return the observation of a JSON text, or what is wrong with the text."""
    try:
        return Observation.from_json(text)
    except InvalidInputError as error:
        return error
    # A text that is JSON, but was changed by hand, can fail in any of these ways.
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        return InvalidInputError(f"{type(error).__name__}: {error}")
