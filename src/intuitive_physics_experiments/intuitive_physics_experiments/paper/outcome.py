"""What every experiment leaves in its folder: tables, figures, and a page of how they were made."""

from __future__ import annotations

import csv
import io
import platform
import shlex
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from intuitive_physics_cli.report.figure_style import STYLE
from intuitive_physics_experiments.paper.cells import write_whole

RESOLUTION = 130
"""Dots per inch of a figure."""


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows with the first one's keys as header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: _shortened(value) for name, value in row.items()})
    write_whole(path, text.getvalue())


def write_figure(path: Path, size: tuple[float, float], draw: Callable[[Any], None]) -> None:
    """Draw a figure of `size` inches into a PNG file."""
    # The figure alone, without pyplot: no display, no global state.
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        figure.savefig(path, format="png", dpi=RESOLUTION, facecolor="white")


def write_page(folder: Path, title: str, command: str, body: str) -> None:
    """Write `README.md` with what was found and how it was made."""
    made = (
        f"Made by `{command}` at commit {source_commit()}, Python {platform.python_version()}, "
        f"{platform.machine()}."
    )
    write_whole(folder / "README.md", f"# {title}\n\n{made}\n\n{body}\n")


def given_command() -> str:
    """Return the command of this process as it was given to the shell."""
    return shlex.join(["intuitive-physics", *sys.argv[1:]])


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown, its first column aligned left, the others right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def source_commit() -> str:
    """Return the commit of the source this runs from, "unknown" where it is no checkout."""
    where = Path(__file__).parent
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
            cwd=where,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()


def _shortened(value: Any) -> Any:
    return f"{value:.6g}" if isinstance(value, float) else value
