"""What learning in the background reads: observations since a place, and its own state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics_learner.store.database import Database


@dataclass(frozen=True, eq=False)
class StoredObservation:
    """A row of the observations.

    Parameters
    ----------
    position : of the row; it grows from row to row
    id : of the observation
    observation : None where the row cannot be read
    problem : why it cannot be read
    """

    position: int
    id: str
    observation: Observation | None
    problem: str = ""


class OnlineRecord:
    """The part of an open database that learning in the background reads.

    Reading takes no longer the more observations there are.

    Parameters
    ----------
    database : open
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def observations_after(self, position: int, limit: int) -> list[StoredObservation]:
        """Return the first observations after a position, in the order in which they came.

        Parameters
        ----------
        position : of the last one that is known; 0 for the beginning
        limit : number of observations at most
        """
        with self._database.reading() as connection:
            rows = connection.execute(
                "SELECT rowid, id, json FROM observations WHERE rowid > ? ORDER BY rowid LIMIT ?",
                (position, limit),
            ).fetchall()
        return [_stored(*row) for row in rows]

    def count_after(self, position: int) -> int:
        """Return the number of observations after a position."""
        with self._database.reading() as connection:
            (count,) = connection.execute(
                "SELECT COUNT(*) FROM observations WHERE rowid > ?", (position,)
            ).fetchone()
        return int(count)

    def position_of(self, count: int) -> int:
        """Return the position of the last of the first `count` observations; 0 for none."""
        with self._database.reading() as connection:
            row = connection.execute(
                "SELECT MAX(rowid) FROM (SELECT rowid FROM observations ORDER BY rowid LIMIT ?)",
                (count,),
            ).fetchone()
        return int(row[0] or 0)

    def last_position(self, ids: Sequence[str], position: int) -> int:
        """Return a position up to which all observations are known.

        A row that was deleted last may have given its position to another one. So where the row at
        `position` is not the last of the known ones any more, the last known row before it counts.

        Parameters
        ----------
        ids : of observations that are known
        position : of the last of them when it was read
        """
        holders = ", ".join("?" * len(ids))
        with self._database.reading() as connection:
            (found,) = connection.execute(
                f"SELECT MAX(rowid) FROM observations WHERE rowid <= ? AND id IN ({holders})",
                (position, *ids),
            ).fetchone()
        return int(found or 0)

    def observations(self, ids: Sequence[str]) -> list[Observation]:
        """Return those of some observations that are stored and can be read, in any order."""
        holders = ", ".join("?" * len(ids))
        with self._database.reading() as connection:
            rows = connection.execute(
                f"SELECT rowid, id, json FROM observations WHERE id IN ({holders})", tuple(ids)
            ).fetchall()
        found = [_stored(*row).observation for row in rows]
        return [one for one in found if one is not None]

    def state(self) -> str | None:
        """Return the state that was saved last; None before the first."""
        with self._database.reading() as connection:
            row = connection.execute("SELECT json FROM online_state").fetchone()
        return None if row is None else str(row[0])


def _stored(position: int, name: str, text: str) -> StoredObservation:
    try:
        return StoredObservation(position, name, Observation.from_json(text))
    except InvalidInputError as error:
        return StoredObservation(position, name, None, str(error))
