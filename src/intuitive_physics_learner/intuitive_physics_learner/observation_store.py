"""Observations and learned parameters on disk: an SQLite file that survives any crash.

The file is in write-ahead-log mode with full synchronisation: what `add` has returned from is on
the disk, whatever happens to the process or the machine afterwards. Any SQLite tool can read it:

    observations        id, received_at (Unix time), json (`Observation.to_json`)
    learned_parameters  version, learned_at (Unix time), json (`LearnedParameters.to_dict`)
"""

from __future__ import annotations

import json
import os
import sqlite3
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation
from intuitive_physics_learner.errors import StorageError

APPLICATION_ID = 0x49505331
"""Tells our files from other SQLite files: "IPS1"."""

MIGRATIONS: tuple[tuple[str, ...], ...] = (
    (
        "CREATE TABLE observations ("
        "id TEXT PRIMARY KEY NOT NULL, received_at REAL NOT NULL, json TEXT NOT NULL)",
        "CREATE TABLE learned_parameters ("
        "version INTEGER PRIMARY KEY NOT NULL, learned_at REAL NOT NULL, json TEXT NOT NULL)",
        f"PRAGMA application_id = {APPLICATION_ID}",
    ),
)
"""Statements that lead from schema version k to k + 1; a new version is one more entry."""

SCHEMA_VERSION = len(MIGRATIONS)

BUSY_TIMEOUT = 5.0
"""s to wait for another process that writes."""


class ObservationStore:
    """An open database; may be used from several threads.

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
        self.path = Path(path).expanduser()
        self._lock = threading.RLock()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"cannot make the folder {self.path.parent}: {error.strerror}; "
                "expected a place that can be written"
            ) from None
        with self._explained("open"):
            self._connection = sqlite3.connect(
                self.path, timeout=BUSY_TIMEOUT, isolation_level=None, check_same_thread=False
            )
        try:
            self._prepare()
        except BaseException:
            self._connection.close()
            raise

    def __enter__(self) -> ObservationStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; what was added is on the disk already."""
        with self._lock, self._explained("close"):
            self._connection.close()

    def add(self, observation: Observation) -> bool:
        """Store an observation; once this returns it survives any crash.

        Returns
        -------
        bool
            False when one with this id was stored before; then nothing changes.
        """
        text = observation.to_json()
        with self._writing() as connection:
            cursor = connection.execute(
                "INSERT INTO observations (id, received_at, json) VALUES (?, ?, ?) "
                "ON CONFLICT (id) DO NOTHING",
                (observation.id, time.time(), text),
            )
            return cursor.rowcount == 1

    def count(self) -> int:
        """Return the number of observations."""
        with self._reading() as connection:
            return int(connection.execute("SELECT COUNT(*) FROM observations").fetchone()[0])

    def ids(self) -> list[str]:
        """Return the ids of all observations in the order in which they came."""
        with self._reading() as connection:
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
        with self._reading() as connection:
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
        with self._writing() as connection:
            last = connection.execute("SELECT MAX(version) FROM learned_parameters").fetchone()[0]
            numbered = replace(learned, version=(last or 0) + 1)
            connection.execute(
                "INSERT INTO learned_parameters (version, learned_at, json) VALUES (?, ?, ?)",
                (numbered.version, time.time(), json.dumps(numbered.to_dict(), allow_nan=False)),
            )
        return numbered

    def newest_parameters(self) -> LearnedParameters | None:
        """Return θ_s of the highest version; None when nothing was learned yet."""
        with self._reading() as connection:
            row = connection.execute(
                "SELECT version, json FROM learned_parameters ORDER BY version DESC LIMIT 1"
            ).fetchone()
        return None if row is None else self._parameters(*row)

    def parameters_history(self) -> list[LearnedParameters]:
        """Return θ_s of all versions, oldest first."""
        with self._reading() as connection:
            rows = connection.execute(
                "SELECT version, json FROM learned_parameters ORDER BY version"
            ).fetchall()
        return [self._parameters(*row) for row in rows]

    def _prepare(self) -> None:
        with self._reading() as connection:
            # Reads the whole file once: damage is found now and not in the middle of learning.
            found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
            if found != "ok":
                raise StorageError(f"{self._damaged()} ({found})")
            version = self._schema_version(connection)
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
        if version < SCHEMA_VERSION:
            with self._writing() as connection:
                # Another process may have been quicker.
                for step in MIGRATIONS[self._schema_version(connection) :]:
                    for statement in step:
                        connection.execute(statement)
                connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")

    def _schema_version(self, connection: sqlite3.Connection) -> int:
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        application = int(connection.execute("PRAGMA application_id").fetchone()[0])
        tables = int(connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()[0])
        if application != APPLICATION_ID and (tables or version):
            raise StorageError(
                f"{self.path} is an SQLite database of another program; "
                "expected one of this suite or a new file"
            )
        if version > SCHEMA_VERSION:
            raise StorageError(
                f"{self.path} has the schema version {version}; this program knows versions up to "
                f"{SCHEMA_VERSION}: use the program that wrote it or a newer one"
            )
        return version

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

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        with self._lock, self._explained("read"):
            yield self._connection

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """One transaction: all of it is on the disk at the end, or none."""
        with self._lock, self._explained("write"):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    @contextmanager
    def _explained(self, action: str) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            text = str(error)
            if "not a database" in text:
                message = (
                    f"{self.path} is not an SQLite database; "
                    "give another path or move the file away"
                )
            elif "malformed" in text or "corrupt" in text:
                message = self._damaged()
            else:
                message = f"cannot {action} {self.path}: {text}; {_advice(text)}"
            raise StorageError(message) from None

    def _damaged(self) -> str:
        return (
            f"{self.path} is damaged; it was left as it is: restore a copy of it, save what can be "
            f"saved with: sqlite3 {self.path} .recover, or give another path"
        )


def _advice(text: str) -> str:
    if "full" in text:
        return "make room on the disk; what was stored before is unharmed"
    if "locked" in text:
        return "another process has been writing for too long; try again"
    if "closed" in text:
        return "open it again"
    return "check that the disk has room and that the folder can be written"
