"""The result of a benchmark as data, and the JSON file that keeps it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

FOLDER = Path(__file__).resolve().parent
"""Where the benchmarks write their results."""

FORMAT_VERSION = 1
"""Of the JSON files; it grows when older files can no longer be read."""

Cell = str | int | float | None
"""A number, a text, or None where nothing was measured."""


class ResultFileError(ValueError):
    """A file is no result of a benchmark; the message names file, place and what was expected."""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Parameters
    ----------
    heading : what readers see above it
    unit : of its numbers; empty for texts and for numbers without a unit
    number_format : format specification that readers see numbers in, such as `.2f`
    """

    heading: str
    unit: str = ""
    number_format: str = ""


@dataclass(frozen=True)
class Table:
    """A table with what belongs to it.

    Parameters
    ----------
    title : heading of its section
    columns : as many as each row has cells
    rows : cells; a number that JSON cannot hold (infinity, NaN) becomes a text
    note : sentences above it
    remarks : sentences below it
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    note: str = ""
    remarks: Sequence[str] = ()


@dataclass(frozen=True)
class Machine:
    """What a benchmark ran on.

    Parameters
    ----------
    processor, system, python : names and versions
    cores : that the process could use
    libraries : versions of those that took part, by name
    """

    processor: str
    cores: int
    system: str
    python: str
    libraries: Mapping[str, str]


@dataclass(frozen=True)
class Run:
    """How, when and where a result was measured.

    Parameters
    ----------
    command : that measured it
    commit : hash that was checked out; where `dirty` is None, the commit that stored the result;
        empty without git
    dirty : whether files under version control were changed; None where the run did not record it
    date : of its start, ISO 8601 in UTC; where `dirty` is None, of that commit
    seconds : that it took; None where not recorded
    machine : None where not recorded
    """

    command: str
    commit: str
    dirty: bool | None
    date: str
    seconds: float | None = None
    machine: Machine | None = None


@dataclass(frozen=True)
class Result:
    """All that a benchmark measured.

    Parameters
    ----------
    title : of the page
    run : how it was measured
    tables : in the order of the page
    note : what was measured, above all tables
    key_figures : what the last line of the benchmark prints; empty where not recorded
    """

    title: str
    run: Run
    tables: Sequence[Table]
    note: str = ""
    key_figures: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


def write_result(path: Path, result: Result) -> None:
    """Write a result as JSON."""
    data = {
        "format_version": FORMAT_VERSION,
        "title": result.title,
        "note": result.note,
        "run": asdict(result.run),
        "key_figures": dict(result.key_figures),
        "tables": [
            {
                "title": table.title,
                "note": table.note,
                "columns": [asdict(column) for column in table.columns],
                "rows": [[_storable(cell) for cell in row] for row in table.rows],
                "remarks": list(table.remarks),
            }
            for table in result.tables
        ],
    }
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text + "\n", encoding="utf-8")


def read_result(path: Path) -> Result:
    """Read the JSON file of a result.

    Raises
    ------
    ResultFileError
        where the file is no JSON, or its content is no result of this format
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return _result(data)
    except UnicodeDecodeError as error:
        raise ResultFileError(f"{path}: is no text in UTF-8: {error}") from None
    except json.JSONDecodeError as error:
        raise ResultFileError(f"{path}: is no JSON: {error}") from None
    except ResultFileError as error:
        raise ResultFileError(f"{path}: {error}") from None


def _result(data: object) -> Result:
    version = _entry(data, "format_version", (int,), "the file")
    if version != FORMAT_VERSION:
        raise ResultFileError(f"format_version is {version}; expected {FORMAT_VERSION}")
    tables = _entry(data, "tables", (list,), "the file")
    return Result(
        title=_entry(data, "title", (str,), "the file"),
        run=_run(_entry(data, "run", (dict,), "the file")),
        tables=[_table(table, f"tables[{i}]") for i, table in enumerate(tables)],
        note=_entry(data, "note", (str,), "the file"),
        key_figures=_entry(data, "key_figures", (dict,), "the file"),
    )


def _run(data: object) -> Run:
    missing = type(None)
    machine = _entry(data, "machine", (dict, missing), "run")
    return Run(
        command=_entry(data, "command", (str,), "run"),
        commit=_entry(data, "commit", (str,), "run"),
        dirty=_entry(data, "dirty", (bool, missing), "run"),
        date=_entry(data, "date", (str,), "run"),
        seconds=_entry(data, "seconds", (int, float, missing), "run"),
        machine=None if machine is None else _machine(machine, "run.machine"),
    )


def _machine(data: object, where: str) -> Machine:
    return Machine(
        processor=_entry(data, "processor", (str,), where),
        cores=_entry(data, "cores", (int,), where),
        system=_entry(data, "system", (str,), where),
        python=_entry(data, "python", (str,), where),
        libraries=_entry(data, "libraries", (dict,), where),
    )


def _table(data: object, where: str) -> Table:
    columns = [
        _column(column, f"{where}.columns[{i}]")
        for i, column in enumerate(_entry(data, "columns", (list,), where))
    ]
    rows = _entry(data, "rows", (list,), where)
    for i, row in enumerate(rows):
        if not isinstance(row, list):
            raise ResultFileError(f"{where}.rows[{i}] is {row!r}; expected a list of cells")
        if len(row) != len(columns):
            raise ResultFileError(
                f"{where}.rows[{i}] has {len(row)} cells; expected {len(columns)}, "
                "one for each column"
            )
        for cell in row:
            if isinstance(cell, bool) or not isinstance(cell, str | int | float | None):
                raise ResultFileError(
                    f"{where}.rows[{i}] has the cell {cell!r}; expected a number, a text or null"
                )
    remarks = _entry(data, "remarks", (list,), where)
    if not all(isinstance(remark, str) for remark in remarks):
        raise ResultFileError(f"{where}.remarks is {remarks!r}; expected a list of texts")
    title = _entry(data, "title", (str,), where)
    return Table(title, columns, rows, _entry(data, "note", (str,), where), remarks)


def _column(data: object, where: str) -> Column:
    number_format = _entry(data, "number_format", (str,), where)
    try:
        format(1.0, number_format)
    except ValueError:
        raise ResultFileError(
            f"{where} has the number_format {number_format!r}; "
            "expected a format of numbers such as '.2f'"
        ) from None
    return Column(
        heading=_entry(data, "heading", (str,), where),
        unit=_entry(data, "unit", (str,), where),
        number_format=number_format,
    )


def _entry(data: object, key: str, kinds: tuple[type, ...], where: str) -> Any:
    """Return an entry of a JSON object that is one of these kinds."""
    if not isinstance(data, dict):
        raise ResultFileError(f"{where} is {data!r}; expected a JSON object")
    expected = " or ".join("null" if kind is type(None) else kind.__name__ for kind in kinds)
    if key not in data:
        raise ResultFileError(f"{where} has no {key!r}; expected {expected}")
    value = data[key]
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        raise ResultFileError(f"{key!r} of {where} is {value!r}; expected {expected}")
    return value


def _storable(cell: Cell) -> Cell:
    """Return a cell as JSON can hold it; numbers of NumPy become Python's."""
    if cell is None or isinstance(cell, str):
        return cell
    number = cell.item() if hasattr(cell, "item") else cell
    return number if math.isfinite(number) else str(number)
