"""Where an unfinished search stands, so that one that was killed can go on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters


@dataclass(frozen=True, eq=False)
class SearchCheckpoint:
    """A search on its way.

    Parameters
    ----------
    key : tells searches apart: whatever decides how a search goes has a part in it
    version : of the newest θ_s when this was saved; what is newer was not known to the search
    start : θ_s the search began with; None: the defaults
    state : plain data from which `learn` continues, empty before its first checkpoint; None: the
        search has come to its end
    seconds : of search so far
    iterations : evaluations of J so far
    """

    key: str
    version: int
    start: LearnedParameters | None
    state: Mapping[str, Any] | None
    seconds: float
    iterations: int

    def to_json(self) -> str:
        """Return start and state as JSON text, every number to its last digit."""
        data = {
            "start": None if self.start is None else self.start.to_dict(),
            "state": self.state,
            "seconds": self.seconds,
            "iterations": self.iterations,
        }
        return json.dumps(data, allow_nan=False)

    @staticmethod
    def from_json(key: str, version: int, text: str) -> SearchCheckpoint:
        """Read what `to_json` wrote.

        Raises
        ------
        InvalidInputError
            When the text is cut short, not JSON, or lacks a part.
        """
        try:
            data = json.loads(text)
            start = None if data["start"] is None else LearnedParameters.from_dict(data["start"])
            return SearchCheckpoint(
                key, version, start, data["state"], data["seconds"], data["iterations"]
            )
        except (json.JSONDecodeError, KeyError, TypeError) as error:
            raise InvalidInputError(f"checkpoint of a search cannot be read: {error}") from None
