"""Shared by the parts of `make torture`: tables of one row, bars of memory and of stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchmarks.results.result import Cell, Column, Table
from benchmarks.torture.bars import bars

SEED = 19  # of all random choices
MOST_MEGABYTES = 1500.0  # bar of the memory of a node

Stops = Mapping[str, tuple[float, int]]
"""Time that each node took to stop, s, and its exit code."""


def row_table(
    title: str, note: str, cells: Sequence[tuple[Column, Cell]], remarks: Sequence[str]
) -> Table:
    """Return a table of one row, of which each cell stands beside its column."""
    columns, row = zip(*cells, strict=True)
    return Table(title, list(columns), [list(row)], note, remarks)


def slowest_stop(stops: Stops) -> float:
    """Return the longest time, s; zero of none."""
    return max((seconds for seconds, _ in stops.values()), default=0.0)


def missed_stops(stops: Stops) -> list[str]:
    """Return the missed bars of the ends of nodes."""
    missed = [f"{name} ended with code {code}" for name, (_, code) in stops.items() if code]
    return missed + [
        f"{name} took {took:.1f} s to stop; expected at most {bars().stop:g}"
        for name, (took, _) in stops.items()
        if took > bars().stop
    ]
