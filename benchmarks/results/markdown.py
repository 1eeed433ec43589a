"""The page of a result: Markdown that says what the JSON says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.results.result import Cell, Column, Machine, Result, Run, Table, read_result


def write_page(path: Path) -> None:
    """Write the page of a JSON file beside it."""
    path.with_suffix(".md").write_text(page(read_result(path)), encoding="utf-8")


def page(result: Result) -> str:
    """Return the whole page, with how, when and where the result was measured."""
    parts = [f"# {result.title}", _provenance(result.run)]
    return "\n\n".join([*parts, *_body(result.note, result.tables)]) + "\n"


def tables_text(note: str, tables: Sequence[Table]) -> str:
    """Return what a page says below its head."""
    return "\n\n".join(_body(note, tables))


def _body(note: str, tables: Sequence[Table]) -> Iterator[str]:
    if note:
        yield note
    for table in tables:
        yield f"## {table.title}"
        if table.note:
            yield table.note
        yield _grid(table)
        if table.remarks:
            yield "\n".join(f"- {remark}" for remark in table.remarks)


def _provenance(run: Run) -> str:
    seconds = "" if run.seconds is None else f" in {run.seconds:.0f} s"
    machine = "" if run.machine is None else f" on {_machine(run.machine)}"
    return f"Made by `{run.command}`{seconds}{_state(run)}{machine}."


def _state(run: Run) -> str:
    day = run.date[:10]
    if not run.commit:
        return f" on {day}"
    commit = f"commit {run.commit[:7]}"
    if run.dirty is None:
        return f", stored by {commit} of {day}"
    return f" on {day} at {commit}" + (" with uncommitted changes" if run.dirty else "") + ","


def _machine(machine: Machine) -> str:
    libraries = ", ".join(f"{name} {version}" for name, version in machine.libraries.items())
    cores = f"{machine.cores} core{'' if machine.cores == 1 else 's'}"
    return f"{cores} of {machine.processor}, {machine.system}, Python {machine.python}; {libraries}"


def _grid(table: Table) -> str:
    """Return the table with columns aligned, so that it can be read as it is."""
    cells = [[column.heading for column in table.columns]]
    cells += [
        [_shown(cell, column) for cell, column in zip(row, table.columns, strict=True)]
        for row in table.rows
    ]
    widths = [max(len(row[c]) for row in cells) for c in range(len(table.columns))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    rule = "|" + "|".join("-" * (w + 2) for w in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def _shown(cell: Cell, column: Column) -> str:
    if cell is None:
        # Nothing was measured.
        return "–"
    return cell if isinstance(cell, str) else format(cell, column.number_format)
