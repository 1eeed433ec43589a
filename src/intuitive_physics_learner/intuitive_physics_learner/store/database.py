"""An SQLite file that survives any crash, and says clearly what is wrong with it.

The file is in write-ahead-log mode with full synchronisation: a transaction that `writing` has
ended is on the disk, whatever happens to the process or the machine afterwards. A file of an older
version is brought up to date when it is opened. Its tables are

observations        id, received_at (Unix time), json (`Observation.to_json`)
learned_parameters  version, learned_at (Unix time), json (`LearnedParameters.to_dict`)
searches            key, saved_at (Unix time), version, json (`SearchCheckpoint`)
online_state        id (always 1), saved_at (Unix time), json (`OnlineState`)
"""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from intuitive_physics_learner.errors import StorageError

APPLICATION_ID = 0x49505331
"""Distinguishes our files from other SQLite files: "IPS1"."""

MIGRATIONS: tuple[tuple[str, ...], ...] = (
    (
        "CREATE TABLE observations ("
        "id TEXT PRIMARY KEY NOT NULL, received_at REAL NOT NULL, json TEXT NOT NULL)",
        "CREATE TABLE learned_parameters ("
        "version INTEGER PRIMARY KEY NOT NULL, learned_at REAL NOT NULL, json TEXT NOT NULL)",
        f"PRAGMA application_id = {APPLICATION_ID}",
    ),
    (
        "CREATE TABLE searches (key TEXT PRIMARY KEY NOT NULL, saved_at REAL NOT NULL, "
        "version INTEGER NOT NULL, json TEXT NOT NULL)",
    ),
    (
        "CREATE TABLE online_state (id INTEGER PRIMARY KEY CHECK (id = 1), "
        "saved_at REAL NOT NULL, json TEXT NOT NULL)",
    ),
)
"""Statements that lead from schema version k to k + 1; a new version is one more entry."""

BUSY_TIMEOUT = 5.0
"""s to wait for another process that writes."""


def default_database_path() -> Path:
    """$XDG_DATA_HOME/intuitive_physics/learner.sqlite3, else under ~/.local/share."""
    # The XDG specification says to ignore a path that is not absolute.
    home = Path(os.environ.get("XDG_DATA_HOME", ""))
    if not home.is_absolute():
        home = Path.home() / ".local" / "share"
    return home / "intuitive_physics" / "learner.sqlite3"


class Database:
    """An open file; may be used from several threads, and the file by several processes.

    Parameters
    ----------
    path : of the file; it and its folder are made where they do not exist

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

    def close(self) -> None:
        """Close the file; what was written is on the disk already."""
        with self._lock, self._explained("close"):
            self._connection.close()

    @contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """Hand out the connection; what SQLite raises becomes a `StorageError`."""
        with self._lock, self._explained("read"):
            yield self._connection

    @contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
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

    def _prepare(self) -> None:
        with self.reading() as connection:
            # Reads the whole file once: damage is found now and not in the middle of learning.
            found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
            if found != "ok":
                raise StorageError(f"{self._damaged()} ({found})")
            version = schema_version(connection, self.path)
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
        if version < latest_version():
            with self.writing() as connection:
                migrate(connection, self.path)

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


def latest_version() -> int:
    """Return the schema version that this program writes."""
    return len(MIGRATIONS)


def schema_version(connection: sqlite3.Connection, path: Path) -> int:
    """Return the version of a file's tables; 0: it has none yet.

    Raises
    ------
    StorageError
        When the file is another program's, or of a version that is not known yet.
    """
    version = int(connection.execute("PRAGMA user_version").fetchone()[0])
    application = int(connection.execute("PRAGMA application_id").fetchone()[0])
    tables = int(connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()[0])
    if application != APPLICATION_ID and (tables or version):
        raise StorageError(
            f"{path} is an SQLite database of another program; "
            "expected one of this suite or a new file"
        )
    if version > latest_version():
        raise StorageError(
            f"{path} has the schema version {version}; this program knows versions up to "
            f"{latest_version()}: use the program that wrote it or a newer one"
        )
    return version


def migrate(connection: sqlite3.Connection, path: Path) -> None:
    """Bring a file up to date, within the caller's transaction: wholly or not at all."""
    # Read within the transaction: another process may have migrated the file meanwhile.
    for step in MIGRATIONS[schema_version(connection, path) :]:
        for statement in step:
            connection.execute(statement)
    connection.execute(f"PRAGMA user_version = {latest_version()}")
