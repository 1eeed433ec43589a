"""The common frame of all experiments: parts that survive an interruption, and a folder of results.

An experiment has its settings, its parts and its measure; this module has the folder, the
processes, the CSV tables, the figures and the page.
"""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.report.report_page import png

# File that says what a folder's cells were made with, and folder of the finished cells.
SETTINGS_NAME, CELLS_NAME = "settings.json", "cells"

Row = dict[str, Any]  # A row of a table, by column
Cell = Callable[[], dict[str, Any]]  # Computes one part: plain data that JSON holds

# Called with the cells done, the cells in all, and the name of the next or last one.
Progress = Callable[[int, int, str], None]


def no_progress(done: int, total: int, name: str) -> None:
    """Progress that nobody follows."""


@dataclass(frozen=True, eq=False)
class Figure:
    """A figure of `size` inches, and what draws it."""

    size: tuple[float, float]
    draw: Callable[[Any], None]


@dataclass(frozen=True, eq=False)
class Results:
    """Results of an experiment; tables and figures by the name of their file."""

    title: str
    body: str  # of the page, in Markdown
    tables: Mapping[str, Sequence[Row]]
    figures: Mapping[str, Figure] = field(default_factory=dict)


class CellStore:
    """A folder of finished cells, all made with the same settings, computed on several cores.

    Whatever changes the cells' content must be in the settings. A folder with cells of other
    settings is an error.
    """

    def __init__(
        self,
        folder: Path,
        settings: Mapping[str, Any],
        cores: int = 1,
        on_progress: Progress = no_progress,
    ) -> None:
        self.folder, self.cores, self.on_progress = folder, cores, on_progress
        wanted = json.loads(json.dumps(settings))
        make_folder(folder / CELLS_NAME)
        path = folder / SETTINGS_NAME
        if path.exists():
            self._check_same(path, wanted)
        else:
            write_whole(path, json.dumps(wanted, indent=1) + "\n")

    def run(self, cells: Mapping[str, Cell], cores: int | None = None) -> dict[str, dict[str, Any]]:
        """Compute the cells that are missing, and return all by name, which is a file name too.

        `cores` is given for cells that use several cores themselves.
        """
        missing = {name: cell for name, cell in cells.items() if not self._path(name).exists()}
        done = len(cells) - len(missing)
        if (cores or self.cores) == 1:
            for more, name in enumerate(missing):
                self.on_progress(done + more, len(cells), name)
                self._compute(name, missing[name])
        elif missing:
            self.on_progress(done, len(cells), "")
            for more, name in enumerate(self._computed_side_by_side(missing)):
                self.on_progress(done + more + 1, len(cells), name)
        self.on_progress(len(cells), len(cells), "")
        return {name: self._read(self._path(name)) for name in cells}

    def _computed_side_by_side(self, cells: Mapping[str, Cell]) -> Iterator[str]:
        """Yield the names of cells as they are finished."""
        # Forked children inherit the cells, which hold what cannot be pickled.
        with ProcessPoolExecutor(
            self.cores, get_context("fork"), initializer=_inherit, initargs=(self, cells)
        ) as pool:
            futures = {pool.submit(_compute_inherited, name): name for name in cells}
            try:
                for future in as_completed(futures):
                    future.result()
                    yield futures[future]
            finally:
                pool.shutdown(cancel_futures=True)

    def _compute(self, name: str, cell: Cell) -> None:
        write_whole(self._path(name), json.dumps(cell(), allow_nan=False))

    def _path(self, name: str) -> Path:
        return self.folder / CELLS_NAME / f"{name}.json"

    def _check_same(self, path: Path, wanted: dict[str, Any]) -> None:
        there = self._read(path)
        other = sorted(
            key for key in {*there, *wanted} if there.get(key, ...) != wanted.get(key, ...)
        )
        if other:
            raise InvalidInputError(
                f"{self.folder} was begun with other settings ({', '.join(other)}); "
                "expected the same as before, or another folder"
            )

    @staticmethod
    def _read(path: Path) -> dict[str, Any]:
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InvalidInputError(
                f"cannot read {path}: {error}; remove it to have it made again"
            ) from None
        if not isinstance(data, dict):
            raise InvalidInputError(f"{path} is no cell of an experiment; expected a JSON object")
        return data


_inherited: dict[str, Any] = {}  # In a child process: the store and its cells


def _inherit(store: CellStore, cells: Mapping[str, Cell]) -> None:
    _inherited.update(store=store, cells=cells)


def _compute_inherited(name: str) -> None:
    _inherited["store"]._compute(name, _inherited["cells"][name])


# Computes its cells in a store, as its settings say
Experiment = Callable[[Any, CellStore], Results]


def run_experiment(
    experiment: Experiment,
    name: str,
    settings: Any,
    folder: Path,
    cores: int = 1,
    on_progress: Progress = no_progress,
) -> Results:
    """Run an experiment, from where it was interrupted, and write its results into its folder."""
    store = CellStore(folder, {"experiment": name, **asdict(settings)}, cores, on_progress)
    results = experiment(settings, store)
    write_results(folder, results)
    return results


def write_results(folder: Path, results: Results) -> None:
    """Write tables, figures, and `README.md` with the command and the commit they were made by."""
    make_folder(folder)
    for name, rows in results.tables.items():
        write_csv(folder / name, rows)
    for name, figure in results.figures.items():
        (folder / name).write_bytes(png(figure.size, figure.draw))
    made = (
        f"Made by `{shlex.join(['intuitive-physics', *sys.argv[1:]])}` at commit "
        f"{source_commit()}, Python {platform.python_version()}, {platform.machine()}."
    )
    write_whole(folder / "README.md", f"# {results.title}\n\n{made}\n\n{results.body}\n")


def make_folder(folder: Path) -> None:
    """Make a folder where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(f"cannot make the folder {folder}: {error.strerror}") from None


def write_whole(path: Path, text: str) -> None:
    """Write a file that appears whole or not at all."""
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=path.parent, prefix=f".{path.name}", delete=False
        ) as file:
            file.write(text)
        os.chmod(file.name, 0o644)
        os.replace(file.name, path)
    except OSError as error:
        raise InvalidInputError(f"cannot write {path}: {error.strerror}") from None


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write rows with the first one's keys as header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow(
            {name: f"{v:.6g}" if isinstance(v, float) else v for name, v in row.items()}
        )
    write_whole(path, text.getvalue())


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown, its first column aligned left, the others right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def source_commit() -> str:
    """Return the commit of the source this runs from, "unknown" where it is no checkout."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        described = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return described.stdout.strip()
