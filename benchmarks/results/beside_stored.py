"""Key figures of a run beside the stored ones of another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks.results.result import Cell, Column, Table, read_result


def beside_stored(figures: Mapping[str, Any], path: Path, headings: tuple[str, str]) -> Table:
    """Return a table of key figures beside those that a file stores.

    The headings are of the stored ones and of those given. What was not measured is left out.
    """
    stored = dict(_single_figures(read_result(path).key_figures))
    return Table(
        "Beside the stored result",
        [Column("figure"), *map(Column, headings)],
        [[name, stored.get(name), value] for name, value in _single_figures(figures)],
    )


def _single_figures(figures: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Cell]]:
    """Yield the name and value of each figure; those of a mapping are named after it, too."""
    for name, value in figures.items():
        if isinstance(value, Mapping):
            yield from _single_figures(value, f"{above}{name}, ")
        elif value is not None:
            yield above + name, value if isinstance(value, (int, float)) else str(value)
