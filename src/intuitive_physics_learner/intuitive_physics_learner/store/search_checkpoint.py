"""The state of an unfinished search, from which one that was killed continues."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters


@dataclass(frozen=True, eq=False)
class SearchCheckpoint:
    """An unfinished search.

    Parameters
    ----------
    key : digest of all that determines the search
    version : of the newest θ_s when this was saved; the search does not know newer ones
    start : θ_s the search began with; None: the defaults
    state : plain data from which `learn` continues, empty before its first checkpoint
    seconds : of search so far
    """

    key: str
    version: int
    start: LearnedParameters | None
    state: Mapping[str, Any]
    seconds: float

    def to_json(self) -> str:
        """Return start and state as JSON text, every number to its last digit."""
        data = {
            "start": None if self.start is None else self.start.to_dict(),
            "state": self.state,
            "seconds": self.seconds,
        }
        return json.dumps(data, allow_nan=False)

    @staticmethod
    def from_json(key: str, version: int, text: str) -> SearchCheckpoint:
        """Read what `to_json` wrote."""
        try:
            data = json.loads(text)
            start = None if data["start"] is None else LearnedParameters.from_dict(data["start"])
            return SearchCheckpoint(key, version, start, data["state"], data["seconds"])
        except (json.JSONDecodeError, KeyError, TypeError) as error:
            raise InvalidInputError(f"checkpoint of a search cannot be read: {error}") from None
