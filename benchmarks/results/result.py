"""The result of a benchmark as data, and the JSON file that keeps it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

FOLDER = Path(__file__).resolve().parent  # where the benchmarks write their results
FORMAT_VERSION = 1  # version of the JSON files' format
Cell = str | int | float | None  # A number, a text, or None where nothing was measured
Item = TypeVar("Item")


class ResultFileError(ValueError):
    """A file is not the result of a benchmark; the message names the file and the reason."""


@dataclass(frozen=True)
class Column:
    """A column of a table: heading, unit of its numbers, and their format, such as `.2f`."""

    heading: str
    unit: str = ""
    number_format: str = ""


@dataclass(frozen=True)
class Table:
    """A table with the sentences above it (note) and below it (remarks)."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    note: str = ""
    remarks: Sequence[str] = ()

    @classmethod
    def of(
        cls,
        title: str,
        items: Iterable[Item],
        columns: Sequence[tuple[Column, Callable[[Item], Cell]]],
        note: str = "",
        remarks: Sequence[str] = (),
    ) -> Table:
        """Return a table with a row for each item; each column comes with its cell of an item."""
        rows = [[cell(item) for _, cell in columns] for item in items]
        return cls(title, [column for column, _ in columns], rows, note, remarks)


@dataclass(frozen=True)
class Machine:
    """Where a benchmark ran, with the versions of the libraries that took part, by name."""

    processor: str
    cores: int
    system: str
    python: str
    libraries: Mapping[str, str]


@dataclass(frozen=True)
class Run:
    """How, when and where a result was measured.

    The commit is the one that was checked out, and the date, ISO 8601 in UTC, that of the start;
    where `dirty` is None, the run recorded neither, and both are those of the commit that stored
    the result. The commit is empty without git.
    """

    command: str
    commit: str
    dirty: bool | None
    date: str
    seconds: float | None = None
    machine: Machine | None = None


@dataclass(frozen=True)
class Result:
    """All that a benchmark measured; the note stands above all tables of the page."""

    title: str
    run: Run
    tables: Sequence[Table]
    note: str = ""
    key_figures: Mapping[str, Any] = field(default_factory=dict)


def write_result(path: Path, result: Result) -> None:
    """Write a result as JSON."""
    data = {"format_version": FORMAT_VERSION, **asdict(result)}
    for table in data["tables"]:
        table["rows"] = [[_storable(cell) for cell in row] for row in table["rows"]]
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text + "\n", encoding="utf-8")


def read_result(path: Path) -> Result:
    """Read the JSON file of a result, or raise a `ResultFileError`."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        version = data.pop("format_version")
        if version != FORMAT_VERSION:
            raise ResultFileError(f"{path}: format_version is {version}; expected {FORMAT_VERSION}")
        machine = data["run"]["machine"]
        run = Run(**{**data["run"], "machine": machine and Machine(**machine)})
        tables = [
            Table(**{**table, "columns": [Column(**column) for column in table["columns"]]})
            for table in data["tables"]
        ]
        return Result(**{**data, "run": run, "tables": tables})
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ResultFileError(f"{path}: is not JSON: {error}") from None
    except (AttributeError, KeyError, TypeError) as error:
        raise ResultFileError(f"{path}: is not a benchmark's result: {error!r}") from None


def _storable(cell: Cell) -> Cell:
    """Return a cell as JSON can hold it: a NumPy number as Python's, infinity and NaN as a text."""
    if cell is None or isinstance(cell, str):
        return cell
    number = cell.item() if hasattr(cell, "item") else cell
    return number if math.isfinite(number) else str(number)
