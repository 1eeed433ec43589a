"""Reads for learning in the background: new observations, those it keeps, and its own state."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

from intuitive_physics.observation import Observation
from intuitive_physics_learner.store.database import Database
from intuitive_physics_learner.store.observation_entries import (
    DOUBTFUL,
    INCLUDED_BY_USER,
    USED,
    parsed_observation,
    readable_observations,
)


@dataclass(frozen=True)
class NewObservations:
    """Observations that were added or given back since a revision of the store.

    Parameters
    ----------
    observations : in the order in which they were added or given back
    trusted : ids of those that the user has included
    problems : of each observation that cannot be read, by its id
    revision : from which to read on; the same as before where there are none
    """

    observations: list[Observation]
    trusted: frozenset[str]
    problems: dict[str, str]
    revision: int


class OnlineRecord:
    """The part of an open database that learning in the background reads, in constant time."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def observations_since(self, revision: int, limit: int, but: int) -> NewObservations:
        """Read the first observations that were added or given back since a revision.

        Those that the search has learned from that led to version `but` are left out; 0: none are.
        """
        rows = self._database.rows(
            "SELECT entry.revision, entry.id, reason, json FROM observation_entries AS entry "
            "JOIN observations USING (id) WHERE entry.revision > ? AND entry.status = ? "
            "AND entry.learned_in IS NOT ? ORDER BY entry.revision LIMIT ?",
            (revision, USED, but, limit),
        )
        observations, problems = [], {}
        for _, name, _, text in rows:
            observation = parsed_observation(text)
            if isinstance(observation, Observation):
                observations.append(observation)
            else:
                problems[name] = str(observation)
        trusted = frozenset(name for _, name, reason, _ in rows if reason == INCLUDED_BY_USER)
        return NewObservations(observations, trusted, problems, rows[-1][0] if rows else revision)

    def count_since(self, revision: int, but: int) -> int:
        """Return the number of observations that `observations_since` reads, without a limit."""
        ((count,),) = self._database.rows(
            "SELECT COUNT(*) FROM observation_entries WHERE revision > ? AND status = ? "
            "AND learned_in IS NOT ?",
            (revision, USED, but),
        )
        return int(count)

    def revision_before(self, version: int) -> int | None:
        """Return the last revision before all observations that a search did not learn from.

        `version` is that of θ_s which the search led to; None where no search here led to it. The
        time grows with the number of observations: it is for once after a search.
        """
        ((first, count, newest),) = self._database.rows(
            "SELECT MIN(CASE WHEN status = ?2 AND learned_in IS NOT ?1 THEN revision END), "
            "COUNT(CASE WHEN learned_in = ?1 THEN 1 END), "
            "(SELECT revision FROM observation_set) FROM observation_entries",
            (version, USED),
        )
        if not count:
            return None
        return int(newest) if first is None else int(first) - 1

    def kept(self, ids: Sequence[str]) -> list[Observation]:
        """Read those of some observations that nobody has excluded or deleted since."""
        rows = self._database.rows(
            "SELECT json FROM observations JOIN observation_entries USING (id) "
            "WHERE id IN (SELECT value FROM json_each(?)) AND status IN (?, ?)",
            (json.dumps(list(ids)), USED, DOUBTFUL),
        )
        return readable_observations(text for (text,) in rows)

    def still_used(self, ids: Sequence[str]) -> set[str]:
        """Return which of some observations nobody has excluded, deleted or set aside since."""
        rows = self._database.rows(
            "SELECT id FROM observation_entries WHERE status = ? "
            "AND id IN (SELECT value FROM json_each(?))",
            (USED, json.dumps(list(ids))),
        )
        return {name for (name,) in rows}

    def state(self) -> str | None:
        """Return the state that was saved last; None before the first."""
        rows = self._database.rows("SELECT json FROM online_state")
        return str(rows[0][0]) if rows else None
