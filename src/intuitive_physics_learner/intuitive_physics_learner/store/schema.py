"""Tables of the database, and how a file of an older version is brought up to date.

observations        id, received_at (Unix time), json (`Observation.to_json`)
learned_parameters  version, learned_at (Unix time), json (`LearnedParameters.to_dict`)
searches            key, saved_at (Unix time), version, json (`SearchCheckpoint`)
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

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
    (
        "CREATE TABLE searches (key TEXT PRIMARY KEY NOT NULL, saved_at REAL NOT NULL, "
        "version INTEGER NOT NULL, json TEXT NOT NULL)",
    ),
)
"""Statements that lead from schema version k to k + 1; a new version is one more entry."""


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
    # Looked up here: another process may have been quicker.
    for step in MIGRATIONS[schema_version(connection, path) :]:
        for statement in step:
            connection.execute(statement)
    connection.execute(f"PRAGMA user_version = {latest_version()}")
