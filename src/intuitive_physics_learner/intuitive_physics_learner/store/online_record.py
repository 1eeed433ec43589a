"""Reads for learning in the background: new observations, those it keeps, and its own state."""

from __future__ import annotations

import json
from collections.abc import Sequence

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics_learner.store.database import Database
from intuitive_physics_learner.store.observation_entries import (
    COLUMNS,
    DOUBTFUL,
    USED,
    ObservationEntry,
    parsed_observation,
    readable_observations,
)


class OnlineRecord:
    """The part of an open database that learning in the background reads, in constant time."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def observations_since(
        self, revision: int, limit: int, but: int
    ) -> list[tuple[ObservationEntry, Observation | InvalidInputError]]:
        """Read the first observations that were added or given back since a revision, in order.

        Each comes with its entry; in place of one that cannot be read there is what is wrong. Those
        that the search has learned from that led to version `but` are left out; 0: none are.
        """
        rows = self._database.rows(
            f"SELECT * FROM (SELECT {COLUMNS} FROM observation_entries WHERE revision > ? "
            "AND status = ? AND learned_in IS NOT ? ORDER BY revision LIMIT ?) "
            "JOIN (SELECT id, json FROM observations) USING (id) ORDER BY revision",
            (revision, USED, but, limit),
        )
        return [(ObservationEntry.from_row(row[:-1]), parsed_observation(row[-1])) for row in rows]

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
