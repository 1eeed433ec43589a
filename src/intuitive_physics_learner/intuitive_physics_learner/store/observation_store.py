"""Observations, versions of θ_s and unfinished searches on disk, in a file any SQLite tool opens.

`database` documents the tables and what the file survives.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sqlite3
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import check_limit, limits
from intuitive_physics.observation import Observation, save_observation
from intuitive_physics_learner.errors import (
    DatabaseBusyError,
    DatabaseFullError,
    StorageError,
    UnreadableVersionError,
)
from intuitive_physics_learner.store.database import BUSY_TIMEOUT, Database
from intuitive_physics_learner.store.observation_entries import (
    COLUMNS,
    DOUBTFUL,
    EXCLUDED,
    INCLUDED_BY_USER,
    STATUSES,
    UNREADABLE,
    USED,
    Assessment,
    ObservationEntry,
    parsed_observation,
)
from intuitive_physics_learner.store.observation_rows import (
    check_ids,
    database_bytes,
    excess_observations,
    has_same_motion,
    insert_observation,
    readable_text,
    renew_entry,
    set_status,
)
from intuitive_physics_learner.store.room import WAYS_OUT, Room

LARGEST_SEARCH_COUNT = 8
"""Unfinished searches that are stored at most; those saved longest ago are deleted first."""

CHUNK = 256
"""Observations read together: some MB of text, and few enough reads."""

LONGEST_FILE_NAME = 100
"""Characters of an id in the name of an exported file; file systems have 255 bytes in all."""

EXCLUDED_BY_USER = "excluded by the user"
"""Reason of an exclusion for which none is given."""


class ObservationStore:
    """An open database; may be used from several threads, and its file by several processes.

    Parameters
    ----------
    path : of the database; it and its folder are made where they do not exist
    busy_timeout : s to wait for another process that writes, before a `DatabaseBusyError`

    Attributes
    ----------
    database : the open file
    path : of it

    Raises
    ------
    StorageError
        When the file cannot be opened, read or written, here and in every method; when it is
        damaged, is not a database of this suite, or was written by a newer version of it. The file
        is left as it is.
    UnknownNameError
        By methods that take ids or statuses, when there is none of that name; then nothing changes.
    """

    def __init__(self, path: str | os.PathLike[str], busy_timeout: float = BUSY_TIMEOUT) -> None:
        self.database = Database(path, busy_timeout)
        self.path = self.database.path
        self._unreadable_versions: dict[int, str] = {}
        try:
            self._set_excess_aside()
        except BaseException:
            self.database.close()
            raise

    def __enter__(self) -> ObservationStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; what was added is on the disk already."""
        self.database.close()

    def add(self, observation: Observation) -> bool:
        """Store an observation; once this returns it survives any crash.

        Returns
        -------
        bool
            False when one with this id, or another measurement of the same frames
            (`Observation.same_motion`), was stored before; then nothing changes.

        Raises
        ------
        InvalidInputError
            When it could not be read again, or there would be too many materials (`limits`).
        DatabaseFullError
            When the file would grow beyond `largest_database`.
        """
        return self.add_all([observation]) == 1

    def add_all(self, observations: Sequence[Observation]) -> int:
        """Store observations, all or none of them, and return how many were not stored before."""
        texts = [readable_text(observation) for observation in observations]
        with self.database.writing() as connection:
            before, count = database_bytes(connection), 0
            for observation, text in zip(observations, texts, strict=True):
                if not has_same_motion(connection, observation):
                    self._check_materials(connection, observation.materials)
                    insert_observation(connection, observation, text, time.time())
                    count += 1
            # SQLite's max_page_count would refuse versions of θ_s too, as if the disk were full.
            self._check_size(before, database_bytes(connection))
            return count

    def room(self) -> Room:
        """Return how much room there is for more."""
        with self.database.reading() as connection:
            size = database_bytes(connection)
        free = shutil.disk_usage(self.path.parent).free
        return Room(self.path, size, free, limits().largest_database)

    def count(self, status: str | None = None) -> int:
        """Return the number of observations, of one status or of all."""
        counts = self.counts()
        return sum(counts.values()) if status is None else counts[status]

    def counts(self) -> dict[str, int]:
        """Return how many observations have each status of `STATUSES`."""
        by_status = dict(self.database.rows("SELECT status, count FROM observation_counts"))
        return {status: by_status.get(status, 0) for status in STATUSES}

    def materials(self) -> tuple[str, ...]:
        """Return the materials of all observations in order of appearance."""
        rows = self.database.rows("SELECT name FROM observed_materials ORDER BY number")
        return tuple(name for (name,) in rows)

    def entries(
        self,
        *,
        ids: Sequence[str] = (),
        statuses: Sequence[str] = (),
        after: int = 0,
        limit: int = -1,
        newest: bool = False,
    ) -> list[ObservationEntry]:
        """List observations without reading their texts.

        Parameters
        ----------
        ids : of the observations; empty: all
        statuses : of the observations; empty: all
        after : only observations with a higher number
        limit : entries at most; negative: no limit. Give the last number as `after` to continue
        newest : the newest first instead of in the order in which they came
        """
        for status in statuses:
            if status not in STATUSES:
                raise UnknownNameError(f"status is {status!r}; expected {', '.join(STATUSES)}")
        chosen = "number > ?"
        values: list[object] = [after]
        for column, names in (("id", ids), ("status", statuses)):
            if names:
                chosen += f" AND {column} IN (SELECT value FROM json_each(?))"
                values.append(json.dumps(list(names)))
        with self.database.reading() as connection:
            check_ids(connection, ids)
            rows = connection.execute(
                f"SELECT {COLUMNS} FROM observation_entries WHERE {chosen} "
                f"ORDER BY number {'DESC' if newest else 'ASC'} LIMIT ?",
                (*values, limit),
            ).fetchall()
        return [ObservationEntry.from_row(row) for row in rows]

    def observations(self, ids: Sequence[str] = ()) -> list[Observation]:
        """Return observations in the order in which they came: those used, or those with the ids.

        One that is used and whose text cannot be read is marked as unreadable and left out. Raises
        `StorageError` when one of those asked for by its id cannot be read.
        """
        if not ids:
            return [observation for _, observation in self.each_observation()]
        observations = []
        for entry, observation in self._parsed(ids=ids):
            if isinstance(observation, InvalidInputError):
                if entry.status != UNREADABLE:
                    self._mark_if_possible([(entry.id, str(observation))])
                raise StorageError(
                    f"{self.path}: observation {entry.id} cannot be read ({observation}); delete "
                    "it or learn from others"
                )
            observations.append(observation)
        return observations

    def each_observation(
        self, statuses: Sequence[str] = (USED,), ids: Sequence[str] = ()
    ) -> Iterator[tuple[ObservationEntry, Observation]]:
        """Read observations one after the other, with no more than a chunk of them in memory.

        Parameters
        ----------
        statuses : of the observations; a text that cannot be read is marked and passed over
        ids : of the observations; empty: all
        """
        unreadable = []
        for entry, observation in self._parsed(statuses, ids):
            if isinstance(observation, Observation):
                yield entry, observation
            elif entry.status != UNREADABLE:
                unreadable.append((entry.id, str(observation)))
        self._mark_if_possible(unreadable)

    def exclude(self, ids: Sequence[str], reason: str = EXCLUDED_BY_USER) -> int:
        """Leave observations out of learning, until they are included; return how many changed."""
        return self._set_status(ids, EXCLUDED, 0.0, reason)

    def include(self, ids: Sequence[str]) -> int:
        """Learn from observations again that were excluded or set aside; return how many changed.

        No learner sets them aside again. Raises `StorageError` when one of them cannot be read;
        then none changes.
        """
        self.observations(ids)
        return self._set_status(ids, USED, 1.0, INCLUDED_BY_USER)

    def delete(self, ids: Sequence[str]) -> int:
        """Delete observations for good; return how many there were."""
        with self.database.writing() as connection:
            check_ids(connection, ids)
            return connection.execute(
                "DELETE FROM observations WHERE id IN (SELECT value FROM json_each(?))",
                (json.dumps(list(ids)),),
            ).rowcount

    def export(
        self,
        folder: str | os.PathLike[str],
        ids: Sequence[str] = (),
        check: Callable[[], None] = lambda: None,
    ) -> int:
        """Write observations as JSON, one file each: those used, or those with the ids.

        Parameters
        ----------
        folder : made where it does not exist
        ids : of the observations; empty: all that are used
        check : called before each file; what it raises ends the export

        Returns
        -------
        int
            How many were written.

        Raises
        ------
        InvalidInputError
            When the folder or a file cannot be written.
        """
        target = Path(folder).expanduser()
        try:
            target.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InvalidInputError(f"cannot make the folder {target}: {error.strerror}") from None
        statuses = () if ids else (USED,)
        count = 0
        for entry, observation in self.each_observation(statuses, ids=ids):
            check()
            # An id may have any characters, and others than its owner may have chosen it.
            name = re.sub(r"[^A-Za-z0-9._-]", "_", entry.id)[:LONGEST_FILE_NAME]
            save_observation(observation, target / f"{entry.number:06d}_{name}.json")
            count += 1
        return count

    def check(self) -> list[ObservationEntry]:
        """Read the whole file and every observation, and return those that cannot be read.

        They are marked so; those that were marked and can be read are used again.
        """
        self.database.check()
        deque(self.each_observation((USED, DOUBTFUL, EXCLUDED)), maxlen=0)
        readable = [
            (entry.id, observation)
            for entry, observation in self._parsed([UNREADABLE])
            if isinstance(observation, Observation)
        ]
        if readable:
            with self.database.writing() as connection:
                for name, observation in readable:
                    renew_entry(connection, name, observation)
            self._set_excess_aside()
        return self.entries(statuses=[UNREADABLE])

    def add_parameters(self, learned: LearnedParameters) -> LearnedParameters:
        """Store θ_s as the next version and return it with its version.

        Raises `InvalidInputError` when there would be too many materials (`limits`).
        """
        while True:
            stored = self.add_improvement(learned, on=self.newest_version())
            if stored is not None:
                return stored

    def add_improvement(
        self,
        learned: LearnedParameters,
        on: int,
        learned_from: Sequence[str] = (),
        assessments: Sequence[Assessment] = (),
    ) -> LearnedParameters | None:
        """Store θ_s as the next version if `on` is still the newest; None if it is not.

        `learned_from` are the ids of the observations that a search has learned it from, and
        `assessments` what it thinks of them, as `save_online` takes it.
        """
        numbered = replace(learned, version=on + 1)
        text = json.dumps(numbered.to_dict(), allow_nan=False)
        with self.database.writing() as connection:
            if _newest_version(connection) != on:
                return None
            self._check_materials(connection, learned.materials)
            _insert_version(connection, numbered.version, text)
            connection.execute(
                "UPDATE observation_entries SET learned_in = ? "
                "WHERE id IN (SELECT value FROM json_each(?))",
                (numbered.version, json.dumps(list(learned_from))),
            )
            _assess(connection, assessments)
        return numbered

    def save_online(
        self,
        state: str,
        on: int,
        learned: LearnedParameters | None = None,
        assessments: Sequence[Assessment] = (),
    ) -> bool:
        """Save the state of learning in the background with what follows from it, all or nothing.

        Parameters
        ----------
        state : JSON text
        on : version of θ_s that the state knows; nothing is saved if there is a newer one
        learned : the next version of θ_s; None if there is none
        assessments : of observations. Those that the user excluded or included, that cannot be
            read or were deleted stay as they are; what is doubtful comes back with the status
            `USED`. The revision stays.

        Returns
        -------
        Whether they were saved.
        """
        versions = [] if learned is None else [replace(learned, version=on + 1).to_dict()]
        texts = [json.dumps(version, allow_nan=False) for version in versions]
        with self.database.writing() as connection:
            if _newest_version(connection) != on:
                return False
            for text in texts:
                _insert_version(connection, on + 1, text)
            _assess(connection, assessments)
            connection.execute(
                "INSERT OR REPLACE INTO online_state (id, saved_at, json) VALUES (1, ?, ?)",
                (time.time(), state),
            )
        return True

    def newest_version(self) -> int:
        """Return the highest version of θ_s; 0 when nothing was learned yet."""
        with self.database.reading() as connection:
            return _newest_version(connection)

    def newest_parameters(self) -> LearnedParameters | None:
        """Return θ_s of the highest version; None when nothing was learned yet.

        Where that cannot be read it is left as it is (`unreadable_versions`), and the newest that
        can be read takes its place and its number; where there is none, the defaults do.
        """
        rows = self.database.rows("SELECT version FROM learned_parameters ORDER BY version DESC")
        versions = [int(version) for (version,) in rows]
        for version in versions:
            if version in self._unreadable_versions:
                continue
            try:
                return replace(self.parameters(version), version=versions[0])
            except UnreadableVersionError as error:
                self._unreadable_versions[version] = str(error)
        materials = self.materials()
        if not versions or not materials:
            return None
        return replace(LearnedParameters.defaults(materials), version=versions[0])

    @property
    def unreadable_versions(self) -> dict[int, str]:
        """Versions of θ_s that were found to be unreadable so far, and why."""
        return dict(self._unreadable_versions)

    def parameters(self, version: int) -> LearnedParameters:
        """Return θ_s of one version; raises `UnknownNameError` when there is no such version."""
        rows = self.database.rows(
            "SELECT json FROM learned_parameters WHERE version = ?", (version,)
        )
        if not rows:
            newest = self.newest_version()
            expected = f"1 to {newest}" if newest else "some to be learned first"
            raise UnknownNameError(f"version is {version}; expected {expected}")
        text = rows[0][0]
        try:
            check_limit("longest_text", len(text), "characters of the text")
            return LearnedParameters.from_dict(json.loads(text))
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise UnreadableVersionError(
                f"{self.path}: version {version} of the learned parameters cannot be read "
                f"({error}); delete its row"
            ) from None

    def save_search(self, key: str, version: int, state: Mapping[str, Any]) -> None:
        """Store the state of a search, plain data, in place of its last one.

        Parameters
        ----------
        key : digest of all that determines the search, apart from the θ_s it began from
        version : of that θ_s
        state : from which the search continues
        """
        row = (key, time.time(), version, json.dumps(state, allow_nan=False))
        with self.database.writing() as connection:
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

    def saved_search(self, key: str, version: int) -> dict[str, Any]:
        """Return the state of a search from a version; empty where none is that can be read."""
        rows = self.database.rows(
            "SELECT json FROM searches WHERE key = ? AND version = ?", (key, version)
        )
        # A search that starts from its beginning only loses time.
        with suppress(json.JSONDecodeError):
            for (text,) in rows:
                return dict(json.loads(text))
        return {}

    def delete_search(self, key: str) -> None:
        """Delete the state of a search; one that is not stored is no error."""
        with self.database.writing() as connection:
            connection.execute("DELETE FROM searches WHERE key = ?", (key,))

    def _check_materials(self, connection: sqlite3.Connection, materials: Sequence[str]) -> None:
        """Refuse new materials when there would be too many, observed and learned together."""
        names = {row[0] for row in connection.execute("SELECT name FROM observed_materials")}
        new = set(materials) - names
        if not new:
            return
        newest = self.newest_parameters()
        names |= set() if newest is None else set(newest.materials)
        if new - names:
            check_limit(
                "most_materials", len(names | new), f"materials of {self.path} together with these"
            )

    def _check_size(self, before: int, after: int) -> None:
        """Refuse to let the file grow beyond its largest size; pages that are free may be used."""
        largest = limits().largest_database
        if largest and after > max(before, largest):
            raise DatabaseFullError(
                f"{self.path} has {before} bytes and may have {largest}, so nothing was added; "
                f"what it holds is unharmed: {WAYS_OUT}"
            )

    def _set_status(self, ids: Sequence[str], status: str, weight: float, reason: str) -> int:
        with self.database.writing() as connection:
            check_ids(connection, ids)
            return sum(set_status(connection, name, status, weight, reason) for name in ids)

    def _parsed(
        self, statuses: Sequence[str] = (), ids: Sequence[str] = ()
    ) -> Iterator[tuple[ObservationEntry, Observation | InvalidInputError]]:
        """Read observations, or what is wrong with them, except for those deleted meanwhile."""
        after = 0
        while entries := self.entries(ids=ids, statuses=statuses, after=after, limit=CHUNK):
            texts = dict(
                self.database.rows(
                    "SELECT id, json FROM observations "
                    "WHERE id IN (SELECT value FROM json_each(?))",
                    (json.dumps([entry.id for entry in entries]),),
                )
            )
            for entry in entries:
                if entry.id in texts:
                    yield entry, parsed_observation(texts[entry.id])
            after = entries[-1].number

    def _set_excess_aside(self) -> None:
        with self.database.reading() as connection:
            excess = excess_observations(connection)
        self._mark_unreadable(excess)

    def _mark_if_possible(self, problems: Sequence[tuple[str, str]]) -> None:
        # They are marked the next time they are read if another process writes now.
        with suppress(DatabaseBusyError):
            self._mark_unreadable(problems)

    def _mark_unreadable(self, problems: Sequence[tuple[str, str]]) -> None:
        """Give observations, each with the reason, the status of what cannot be read."""
        if not problems:
            return
        with self.database.writing() as connection:
            connection.executemany(
                "UPDATE observation_entries SET status = ?, weight = 0.0, reason = ?, "
                "materials = '[]' WHERE id = ?",
                [(UNREADABLE, reason, name) for name, reason in problems],
            )


def _insert_version(connection: sqlite3.Connection, version: int, text: str) -> None:
    connection.execute(
        "INSERT INTO learned_parameters (version, learned_at, json) VALUES (?, ?, ?)",
        (version, time.time(), text),
    )


def _assess(connection: sqlite3.Connection, assessments: Sequence[Assessment]) -> None:
    constants = {"used": USED, "doubtful": DOUBTFUL, "included": INCLUDED_BY_USER}
    connection.executemany(
        "UPDATE observation_entries SET status = :status, weight = :weight, reason = :reason "
        "WHERE id = :id AND status IN (:used, :doubtful) "
        "AND NOT (status = :used AND reason = :included)",
        [{**vars(assessment), **constants} for assessment in assessments],
    )


def _newest_version(connection: sqlite3.Connection) -> int:
    return connection.execute("SELECT MAX(version) FROM learned_parameters").fetchone()[0] or 0
