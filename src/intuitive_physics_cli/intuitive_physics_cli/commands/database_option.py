"""The learner's database as an argument of commands."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError

DATABASE_SUFFIX = ".sqlite3"


def add_database(parser: argparse.ArgumentParser, *, new: bool = False) -> None:
    """Add the argument `database`; `new`: it may be made."""
    made = "; made where it does not exist" if new else ""
    parser.add_argument(
        "database",
        type=Path,
        help=f"of a learner, such as ~/.local/share/intuitive_physics/learner{DATABASE_SUFFIX}"
        f"{made}",
    )


def open_database(path: Path, *, new: bool = False) -> Any:
    """Open a learner's database.

    Raises
    ------
    InvalidInputError
        When there is none and it is not to be made.
    """
    from intuitive_physics_learner.store import ObservationStore

    if not new and not path.expanduser().is_file():
        raise InvalidInputError(f"there is no database {path}; expected a file of a learner")
    return ObservationStore(path)
