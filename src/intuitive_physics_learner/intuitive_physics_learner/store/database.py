"""An SQLite file that survives any crash, and says clearly what is wrong with it.

The file is in write-ahead-log mode with full synchronisation: a transaction that `writing` has
ended is on the disk, whatever happens to the process or the machine afterwards. A file of an older
version is brought up to date when it is opened. Its tables are

observations         id, received_at (Unix time), json (`Observation.to_json`)
observation_entries  one narrow row for each observation: `ObservationEntry`, learned_in (version)
observation_counts   status, count
observed_materials   number (order of appearance), name, count of observations it occurs in
observation_set      revision: grows whenever an observation is added, deleted, excluded or included
learned_parameters   version, learned_at (Unix time), json (`LearnedParameters.to_dict`)
online_state         id (always 1), saved_at (Unix time), json (`OnlineState`)
searches             key, saved_at (Unix time), version (of θ_s that it began from), json (state)

Triggers keep the counts, the materials and the entries of deleted observations right, whichever
program writes. Opening reads the header and one row of each table, not the whole file: damage
elsewhere is found when what is damaged is read, or by `Database.check`.
"""

from __future__ import annotations

import os
import re
import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_learner.errors import DatabaseBusyError, StorageError

APPLICATION_ID = 0x49505331
"""Distinguishes our files from other SQLite files: "IPS1"."""

ENTRY_TABLES: tuple[str, ...] = (
    "CREATE TABLE observation_entries (number INTEGER PRIMARY KEY AUTOINCREMENT, "
    "id TEXT NOT NULL UNIQUE, received_at REAL NOT NULL, start_time REAL, first_time REAL, "
    "last_time REAL, materials TEXT NOT NULL, object_count INTEGER NOT NULL, "
    "point_count INTEGER NOT NULL, has_detections INTEGER NOT NULL, status TEXT NOT NULL, "
    "weight REAL NOT NULL, reason TEXT NOT NULL, revision INTEGER NOT NULL)",
    "CREATE INDEX entries_by_status ON observation_entries (status)",
    "CREATE INDEX entries_by_revision ON observation_entries (revision)",
    "CREATE INDEX entries_by_time ON observation_entries (has_detections, first_time, last_time)",
    "CREATE INDEX entries_by_duration ON observation_entries (last_time - first_time)",
    "CREATE TABLE observation_counts (status TEXT PRIMARY KEY NOT NULL, count INTEGER NOT NULL)",
    "CREATE TABLE observed_materials ("
    "number INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL UNIQUE, count INTEGER NOT NULL)",
    "CREATE TABLE observation_set (revision INTEGER NOT NULL)",
    "INSERT INTO observation_set VALUES (0)",
)
"""Tables of `ObservationEntry`, and of their counts."""


def _count(row: str, change: int) -> str:
    """Return the statements of a trigger that count a row of `observation_entries` in or out."""
    return (
        f"INSERT INTO observation_counts SELECT {row}.status, {change} WHERE true "
        f"ON CONFLICT (status) DO UPDATE SET count = count + {change};"
    )


def _count_materials(row: str, change: int) -> str:
    """Return the statements of a trigger that count a row's materials in or out."""
    return (
        f"INSERT INTO observed_materials (name, count) SELECT value, {change} "
        f"FROM json_each({row}.materials) WHERE true "
        f"ON CONFLICT (name) DO UPDATE SET count = count + {change};"
        "DELETE FROM observed_materials WHERE count <= 0;"
    )


ENTRY_TRIGGERS: tuple[str, ...] = (
    "CREATE TRIGGER entry_added AFTER INSERT ON observation_entries BEGIN "
    f"{_count('NEW', 1)} {_count_materials('NEW', 1)} END",
    "CREATE TRIGGER entry_deleted AFTER DELETE ON observation_entries BEGIN "
    f"{_count('OLD', -1)} {_count_materials('OLD', -1)} END",
    "CREATE TRIGGER entry_status AFTER UPDATE OF status ON observation_entries BEGIN "
    f"{_count('OLD', -1)} {_count('NEW', 1)} END",
    "CREATE TRIGGER entry_materials AFTER UPDATE OF materials ON observation_entries BEGIN "
    f"{_count_materials('NEW', 1)} {_count_materials('OLD', -1)} END",
    "CREATE TRIGGER observation_deleted AFTER DELETE ON observations BEGIN "
    "DELETE FROM observation_entries WHERE id = OLD.id; "
    "UPDATE observation_set SET revision = revision + 1; END",
)
"""Triggers that keep the counts right."""

MIGRATIONS: tuple[tuple[str, ...], ...] = (
    (
        f"PRAGMA application_id = {APPLICATION_ID}",
        "CREATE TABLE observations ("
        "id TEXT PRIMARY KEY NOT NULL, received_at REAL NOT NULL, json TEXT NOT NULL)",
        "CREATE TABLE learned_parameters ("
        "version INTEGER PRIMARY KEY NOT NULL, learned_at REAL NOT NULL, json TEXT NOT NULL)",
        "CREATE TABLE searches (key TEXT PRIMARY KEY NOT NULL, saved_at REAL NOT NULL, "
        "version INTEGER NOT NULL, json TEXT NOT NULL)",
        *ENTRY_TABLES,
        *ENTRY_TRIGGERS,
        "CREATE TABLE online_state (id INTEGER PRIMARY KEY CHECK (id = 1), "
        "saved_at REAL NOT NULL, json TEXT NOT NULL)",
    ),
    ("ALTER TABLE observation_entries ADD COLUMN learned_in INTEGER",),
)
"""Statements that lead from each schema version to the next; a new version is one more entry."""

FIRST_VERSION = 4
"""Schema version that the first entry leads to."""

PRIVATE = 0o600
"""Permissions of a new database: what a robot saw and learned is for its own user."""

BUSY_TIMEOUT = 5.0
"""s to wait for another process that writes, unless a store is opened with another one."""


def default_database_path() -> Path:
    """$XDG_DATA_HOME/intuitive_physics/learner.sqlite3, else under ~/.local/share."""
    # The XDG specification says to ignore a path that is not absolute.
    home = Path(os.environ.get("XDG_DATA_HOME", ""))
    if not home.is_absolute():
        home = Path.home() / ".local" / "share"
    return home / "intuitive_physics" / "learner.sqlite3"


NAMESPACE, SESSION = "{namespace}", "{session}"
"""Placeholders of a path that `database_path` fills in."""

PLACEHOLDER_GUIDE = (
    "{namespace} stands for the node's namespace, nothing for the root, and {session} for the time "
    "of the node's start, such as 20260131T120000Z"
)
"""For those who give a path."""


def database_path(template: str, namespace: str) -> Path:
    """Return the path that a template with placeholders stands for."""
    unknown = set(re.findall(r"\{\w*\}", template)) - {NAMESPACE, SESSION}
    if unknown:
        raise InvalidInputError(
            f"database {template} has the placeholder {min(unknown)}; "
            f"expected {NAMESPACE} or {SESSION}"
        )
    session = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    path = template.replace(NAMESPACE, namespace.strip("/")).replace(SESSION, session)
    # Without a namespace, "{namespace}/file" would be in the root folder of the machine.
    return Path(path if template.startswith("/") else path.lstrip("/"))


def _check_place(folder: Path) -> None:
    """Refuse a folder of which nothing exists but the root: its path is a mistake."""
    if folder.is_absolute() and folder != Path(folder.anchor):
        top = Path(*folder.parts[:2])
        if not top.exists():
            raise StorageError(
                f"there is no folder {top}, so none is made for the database in {folder}; "
                "expected a folder, or one that can be made below another that exists"
            )


class Database:
    """An open file; may be used from several threads, and the file by several processes.

    `busy_timeout` in s to wait for another process that writes.
    """

    def __init__(self, path: str | os.PathLike[str], busy_timeout: float) -> None:
        self.path = Path(path).expanduser()
        self._lock = threading.RLock()
        self._damage: str | None = None
        _check_place(self.path.parent)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"cannot make the folder {self.path.parent}: {error.strerror}; "
                "expected a place that can be written"
            ) from None
        with self._explained("open"):
            self._make_private()
            self._connection = sqlite3.connect(
                self.path, timeout=busy_timeout, isolation_level=None, check_same_thread=False
            )
        # One text with a broken byte is one unreadable row and no more.
        self._connection.text_factory = lambda text: text.decode(errors="replace")
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

    def rows(self, query: str, values: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        """Return all rows that a query with some values finds."""
        with self.reading() as connection:
            return connection.execute(query, values).fetchall()

    @contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """One transaction: all of it is on the disk at the end, or none.

        Other processes wait meanwhile: prepare what is to be written before. A thread of idle
        priority has normal priority within, as far as the system allows it, because on a busy
        machine it could stand still for seconds while it keeps others from writing.
        """
        with self._lock, self._explained("write"), _out_of_idle_priority():
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                # A newer program may have migrated the file since it was opened.
                schema_version(self._connection, self.path)
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    def check(self) -> None:
        """Read the whole file; a `StorageError` says what is wrong with it.

        Takes about a second for each 500 MB, and longer from a slow disk.
        """
        with self.reading() as connection:
            problems = " ".join(_quick_check(connection, 5))
            if problems != "ok":
                self._damage = f" ({problems})"
                raise StorageError(self._damaged())

    def _make_private(self) -> None:
        """Make a file that does not exist yet so that only its owner can read it.

        SQLite gives the permissions of the file to its write-ahead log.
        """
        try:
            os.close(os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, PRIVATE))
        except FileExistsError:
            return
        except OSError as error:
            # As SQLite says it of a file that exists.
            raise sqlite3.OperationalError(
                f"unable to open database file ({error.strerror})"
            ) from None

    def _prepare(self) -> None:
        with self.reading() as connection:
            version = schema_version(connection, self.path)
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
        if version < latest_version():
            with self.writing() as connection:
                # Another process may have migrated the file meanwhile.
                version = schema_version(connection, self.path)
                for statements in MIGRATIONS[max(version - FIRST_VERSION + 1, 0) :]:
                    for statement in statements:
                        connection.execute(statement)
                connection.execute(f"PRAGMA user_version = {latest_version()}")
        for (table,) in self.rows("SELECT name FROM sqlite_master WHERE type = 'table'"):
            self.rows(f"SELECT * FROM {table} LIMIT 1")

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
            kind = DatabaseBusyError if "locked" in text else StorageError
            raise kind(message) from None

    def _damaged(self) -> str:
        if self._damage is None:
            # The first error is the occasion to find out how much is damaged.
            try:
                self._damage = f" ({' '.join(_quick_check(self._connection, 1))})"
            except sqlite3.Error as error:
                self._damage = f" ({error})"
        return (
            f"{self.path} is damaged{self._damage}; it was left as it is: restore a copy of it, "
            f"save what can be saved with: sqlite3 {self.path} .recover, or give another path"
        )


def _quick_check(connection: sqlite3.Connection, count: int) -> list[str]:
    """Read the whole file; return "ok" or the words of up to `count` sentences about damage."""
    rows = connection.execute(f"PRAGMA quick_check({count})")
    return [word for row in rows for word in row[0].split()]


@contextmanager
def _out_of_idle_priority() -> Iterator[None]:
    """Give this thread normal priority where it has idle priority and the system allows it."""
    idle = os.sched_getscheduler(0) == os.SCHED_IDLE
    if idle:
        # Without the right to lower its niceness a process must stay idle.
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    try:
        yield
    finally:
        if idle:
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


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
    return FIRST_VERSION + len(MIGRATIONS) - 1


def schema_version(connection: sqlite3.Connection, path: Path) -> int:
    """Return the version of a file's tables; 0: it has none yet."""
    version = int(connection.execute("PRAGMA user_version").fetchone()[0])
    application = int(connection.execute("PRAGMA application_id").fetchone()[0])
    tables = int(connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()[0])
    if application != APPLICATION_ID and (tables or version):
        raise StorageError(
            f"{path} is an SQLite database of another program; "
            "expected one of this suite or a new file"
        )
    if 0 < version < FIRST_VERSION:
        raise StorageError(
            f"{path} has the schema version {version} of a program before the first release; "
            "move the file away, or give another path"
        )
    if version > latest_version():
        raise StorageError(
            f"{path} has the schema version {version}; this program knows versions up to "
            f"{latest_version()}: use the program that wrote it or a newer one"
        )
    return version
