"""Statements that keep `observations` and `observation_entries` together, within a transaction."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from typing import Any

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.limits import limits
from intuitive_physics.observation import Observation
from intuitive_physics_learner.store.observation_entries import (
    COLUMNS,
    USED,
    entry_columns,
    parsed_observation,
    readable_observations,
)

TOO_MANY_MATERIALS = (
    "its {} materials are too many together with those of earlier observations; delete it, or "
    "raise the limit most_materials"
)
"""Reason why an observation is set aside when a database is opened."""

CANDIDATES = 64
"""Stored observations that a new one is compared with at most, the nearest in time first; a camera
sees far fewer motions at once."""

NEAR = (
    "SELECT json FROM observations JOIN (SELECT id, start_time FROM observation_entries "
    "WHERE has_detections IN (NOT ?1, 1) AND first_time <= ?3 AND first_time >= ?2 - "
    "(SELECT MAX(last_time - first_time) FROM observation_entries) AND last_time >= ?2 "
    f"ORDER BY ABS(start_time - ?4) LIMIT {CANDIDATES}) USING (id)"
)
"""Query for the texts of observations of which more than the ids can say that they are of the same
motion, the nearest first: whether it has detections, its first and last time, and its start in s.
"""


def has_same_motion(connection: sqlite3.Connection, observation: Observation) -> bool:
    """Return whether an observation with this id, or another one of its motion, is stored."""
    same_id = connection.execute("SELECT 1 FROM observations WHERE id = ?", (observation.id,))
    if same_id.fetchone() is not None:
        return True
    has_detections = any(track.detections is not None for track in observation.objects)
    values = (has_detections, *observation.time_span, observation.start_time)
    near = readable_observations(text for (text,) in connection.execute(NEAR, values))
    return any(other.same_motion(observation) for other in near)


def insert_observation(
    connection: sqlite3.Connection, observation: Observation, text: str, received_at: float
) -> None:
    """Insert an observation with a new id, received at a Unix time in s."""
    connection.execute(
        "INSERT INTO observations (id, received_at, json) VALUES (?, ?, ?)",
        (observation.id, received_at, text),
    )
    insert_entry(connection, observation.id, received_at, entry_columns(observation))


def readable_text(observation: Observation) -> str:
    """Return the JSON text of an observation, which the next start can read."""
    text = observation.to_json()
    read = parsed_observation(text)
    if not isinstance(read, Observation):
        raise InvalidInputError(f"observation could not be read from the database again: {read}")
    return text


def database_bytes(connection: sqlite3.Connection) -> int:
    """Return the size of a database's file."""
    pages, size = (
        int(connection.execute(f"PRAGMA {name}").fetchone()[0])
        for name in ("page_count", "page_size")
    )
    return pages * size


def excess_observations(connection: sqlite3.Connection) -> list[tuple[str, str]]:
    """Return ids of observations by which there are too many materials, the latest, and why.

    They may have been stored where the limit was a higher one.
    """
    count = connection.execute("SELECT COUNT(*) FROM observed_materials").fetchone()[0]
    most = limits().most_materials
    if count <= most:
        return []
    taken: set[str] = set()
    texts = []
    for name, materials in connection.execute(
        "SELECT id, materials FROM observation_entries ORDER BY number"
    ):
        names = set(json.loads(materials))
        if len(taken | names) > most:
            texts.append((name, TOO_MANY_MATERIALS.format(len(names))))
        else:
            taken |= names
    return texts


def check_ids(connection: sqlite3.Connection, ids: Sequence[str]) -> None:
    """Raise `UnknownNameError` if no observation has one of the ids."""
    missing = connection.execute(
        "SELECT value FROM json_each(?) WHERE value NOT IN (SELECT id FROM observations) LIMIT 1",
        (json.dumps(list(ids)),),
    ).fetchone()
    if missing is not None:
        count = connection.execute("SELECT COUNT(*) FROM observation_entries").fetchone()[0]
        raise UnknownNameError(
            f"observation id is {missing[0]!r}; expected one of the {count} that are stored"
        )


def insert_entry(
    connection: sqlite3.Connection, name: str, received_at: float, columns: tuple[Any, ...]
) -> None:
    """Insert the entry of an observation, with its `entry_columns`, as of a new revision."""
    row = (name, received_at, *columns, USED, 1.0, "", next_revision(connection))
    names, places = COLUMNS.removeprefix("number, "), ", ".join("?" * len(row))
    connection.execute(f"INSERT INTO observation_entries ({names}) VALUES ({places})", row)


def renew_entry(connection: sqlite3.Connection, name: str, observation: Observation) -> None:
    """Make an observation whose text can be read used again, as of a new revision."""
    columns = COLUMNS.split(", ")[3:]
    row = (*entry_columns(observation), USED, 1.0, "", next_revision(connection))
    changes = ", ".join(f"{column} = ?" for column in columns) + ", learned_in = NULL"
    connection.execute(f"UPDATE observation_entries SET {changes} WHERE id = ?", (*row, name))


def next_revision(connection: sqlite3.Connection) -> int:
    """Count the set of observations as changed, and return its new revision."""
    connection.execute("UPDATE observation_set SET revision = revision + 1")
    return int(connection.execute("SELECT revision FROM observation_set").fetchone()[0])


def set_status(
    connection: sqlite3.Connection, name: str, status: str, weight: float, reason: str
) -> bool:
    """Give an observation a status as of a new revision; return whether that changes it.

    It is then one that no search has learned from.
    """
    changed = connection.execute(
        "UPDATE observation_entries SET status = ?1, weight = ?2, reason = ?3, learned_in = NULL, "
        "revision = (SELECT revision + 1 FROM observation_set) "
        "WHERE id = ?4 AND (status, weight, reason) != (?1, ?2, ?3)",
        (status, weight, reason, name),
    ).rowcount
    if changed:
        next_revision(connection)
    return bool(changed)
