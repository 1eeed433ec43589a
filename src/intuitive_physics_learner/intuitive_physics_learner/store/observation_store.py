"""Observations, versions of θ_s and unfinished searches on disk, in a file any SQLite tool opens.

`database` documents the tables and what the file survives.
"""

from __future__ import annotations

import json
import os
import sqlite3
import time
from collections.abc import Sequence
from dataclasses import replace

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation
from intuitive_physics_learner.errors import StorageError
from intuitive_physics_learner.store.database import Database
from intuitive_physics_learner.store.search_checkpoint import SearchCheckpoint

LARGEST_SEARCH_COUNT = 8
"""Unfinished searches that are stored at most; those saved longest ago are deleted first."""


class ObservationStore:
    """An open database; may be used from several threads, and its file by several processes.

    Parameters
    ----------
    path : of the database; it and its folder are made where they do not exist

    Raises
    ------
    StorageError
        When the file cannot be opened or written, is damaged, is not a database of this suite, or
        was written by a newer version of it. The file is left as it is.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._database = Database(path)
        self.path = self._database.path

    def __enter__(self) -> ObservationStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; what was added is on the disk already."""
        self._database.close()

    @property
    def database(self) -> Database:
        """The open file."""
        return self._database

    def add(self, observation: Observation) -> bool:
        """Store an observation; once this returns it survives any crash.

        Returns
        -------
        bool
            False when one with this id was stored before; then nothing changes.
        """
        return self.add_all([observation]) == 1

    def add_all(self, observations: Sequence[Observation]) -> int:
        """Store observations, all or none of them, and return how many were not stored before."""
        rows = [(one.id, time.time(), one.to_json()) for one in observations]
        with self._database.writing() as connection:
            return connection.executemany(
                "INSERT INTO observations (id, received_at, json) VALUES (?, ?, ?) "
                "ON CONFLICT (id) DO NOTHING",
                rows,
            ).rowcount

    def count(self) -> int:
        """Return the number of observations."""
        with self._database.reading() as connection:
            return int(connection.execute("SELECT COUNT(*) FROM observations").fetchone()[0])

    def ids(self) -> list[str]:
        """Return the ids of all observations in the order in which they came."""
        with self._database.reading() as connection:
            return [
                row[0] for row in connection.execute("SELECT id FROM observations ORDER BY rowid")
            ]

    def observations(self, ids: Sequence[str] = ()) -> list[Observation]:
        """Return observations in the order in which they came: all, or those with the given ids.

        Raises
        ------
        UnknownNameError
            When no observation has one of the ids.
        StorageError
            When one cannot be read.
        """
        with self._database.reading() as connection:
            rows = dict(connection.execute("SELECT id, json FROM observations ORDER BY rowid"))
        missing = [name for name in ids if name not in rows]
        if missing:
            raise UnknownNameError(
                f"observation id is {missing[0]!r}; expected one of the {len(rows)} that are stored"
            )
        wanted = set(ids) or rows.keys()
        return [self._observation(name, text) for name, text in rows.items() if name in wanted]

    def add_parameters(self, learned: LearnedParameters) -> LearnedParameters:
        """Store θ_s as the next version and return it with its version."""
        with self._database.writing() as connection:
            return _insert(connection, learned, _newest_version(connection))

    def save_online(self, state: str, on: int, learned: LearnedParameters | None = None) -> bool:
        """Save the state of learning in the background and the θ_s that goes with it, or nothing.

        Parameters
        ----------
        state : JSON text
        on : version of θ_s that the state knows; nothing is saved if there is a newer one
        learned : the next version of θ_s; None if there is none

        Returns
        -------
        Whether they were saved.
        """
        with self._database.writing() as connection:
            if _newest_version(connection) != on:
                return False
            if learned is not None:
                _insert(connection, learned, on)
            connection.execute(
                "INSERT OR REPLACE INTO online_state (id, saved_at, json) VALUES (1, ?, ?)",
                (time.time(), state),
            )
        return True

    def newest_version(self) -> int:
        """Return the highest version of θ_s; 0 when nothing was learned yet."""
        with self._database.reading() as connection:
            return _newest_version(connection)

    def newest_parameters(self) -> LearnedParameters | None:
        """Return θ_s of the highest version; None when nothing was learned yet."""
        newest = self.newest_version()
        return None if newest == 0 else self.parameters(newest)

    def parameters(self, version: int) -> LearnedParameters:
        """Return θ_s of one version.

        Raises
        ------
        UnknownNameError
            When there is none of that version.
        """
        with self._database.reading() as connection:
            row = connection.execute(
                "SELECT json FROM learned_parameters WHERE version = ?", (version,)
            ).fetchone()
            newest = _newest_version(connection)
        if row is None:
            expected = f"1 to {newest}" if newest else "some to be learned first"
            raise UnknownNameError(f"version is {version}; expected {expected}")
        return self._parameters(version, row[0])

    def parameters_history(self) -> list[LearnedParameters]:
        """Return θ_s of all versions, oldest first."""
        with self._database.reading() as connection:
            rows = connection.execute(
                "SELECT version, json FROM learned_parameters ORDER BY version"
            ).fetchall()
        return [self._parameters(*row) for row in rows]

    def save_checkpoint(self, checkpoint: SearchCheckpoint) -> None:
        """Store the state of a search in place of its last one."""
        row = (checkpoint.key, time.time(), checkpoint.version, checkpoint.to_json())
        with self._database.writing() as connection:
            connection.execute(
                "INSERT OR REPLACE INTO searches (key, saved_at, version, json) "
                "VALUES (?, ?, ?, ?)",
                row,
            )
            connection.execute(
                "DELETE FROM searches WHERE key NOT IN "
                "(SELECT key FROM searches ORDER BY saved_at DESC LIMIT ?)",
                (LARGEST_SEARCH_COUNT,),
            )

    def checkpoint(self, key: str) -> SearchCheckpoint | None:
        """Return the state of a search; None when none is stored, or none that can be read."""
        with self._database.reading() as connection:
            row = connection.execute(
                "SELECT version, json FROM searches WHERE key = ?", (key,)
            ).fetchone()
        try:
            return None if row is None else SearchCheckpoint.from_json(key, *row)
        except InvalidInputError:
            # A search that starts from its beginning only loses time.
            return None

    def delete_checkpoint(self, key: str) -> None:
        """Delete the state of a search; one that is not stored is no error."""
        with self._database.writing() as connection:
            connection.execute("DELETE FROM searches WHERE key = ?", (key,))

    def _observation(self, name: str, text: str) -> Observation:
        try:
            return Observation.from_json(text)
        except InvalidInputError as error:
            raise StorageError(
                f"{self.path}: observation {name} cannot be read ({error}); delete its row or "
                "learn from others by their ids"
            ) from None

    def _parameters(self, version: int, text: str) -> LearnedParameters:
        try:
            return LearnedParameters.from_dict(json.loads(text))
        except (InvalidInputError, json.JSONDecodeError) as error:
            raise StorageError(
                f"{self.path}: version {version} of the learned parameters cannot be read "
                f"({error}); delete its row"
            ) from None


def _newest_version(connection: sqlite3.Connection) -> int:
    return connection.execute("SELECT MAX(version) FROM learned_parameters").fetchone()[0] or 0


def _insert(
    connection: sqlite3.Connection, learned: LearnedParameters, newest: int
) -> LearnedParameters:
    numbered = replace(learned, version=newest + 1)
    connection.execute(
        "INSERT INTO learned_parameters (version, learned_at, json) VALUES (?, ?, ?)",
        (numbered.version, time.time(), json.dumps(numbered.to_dict(), allow_nan=False)),
    )
    return numbered
