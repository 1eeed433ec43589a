"""Where the learner keeps its database unless told otherwise."""

from __future__ import annotations

import os
from pathlib import Path


def default_database_path() -> Path:
    """$XDG_DATA_HOME/intuitive_physics/learner.sqlite3, else under ~/.local/share."""
    # The XDG specification says to ignore a path that is not absolute.
    home = Path(os.environ.get("XDG_DATA_HOME", ""))
    if not home.is_absolute():
        home = Path.home() / ".local" / "share"
    return home / "intuitive_physics" / "learner.sqlite3"
