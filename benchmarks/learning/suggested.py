"""Throws needed to a given precision: those that `suggest` names, over random ones."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from benchmarks.command import report_progress
from benchmarks.learning.part import Findings, Part, Plan
from benchmarks.learning.suggestion import (
    MOST_THROWS,
    PRECISION,
    SuggestionResult,
    compare_throws,
)
from benchmarks.results.result import Cell, Column, Table

WORLDS, QUICK_WORLDS = 8, 1
"""Random worlds."""

WORKERS = 2
"""Processes that compare side by side, each with one thread."""

BAR = 0.6
"""Throws needed when they are suggested, over random ones, at most, issue 17."""


def measure(plan: Plan) -> Findings:
    """Compare in all worlds, several at a time."""
    worlds = QUICK_WORLDS if plan.quick else WORLDS
    report_progress(f"suggested and random throws in {worlds} worlds")
    seeds = range(plan.first_seed, plan.first_seed + worlds)
    with ProcessPoolExecutor(WORKERS, get_context("spawn")) as pool:
        found = list(pool.map(compare_throws, seeds, [1] * worlds))
    ratio = ratio_of_means(found)
    complaints = []
    if ratio > BAR:
        complaints.append(f"suggested_over_random: {ratio:.2f}, bar {BAR:g}")
    return Findings(
        tables=[_table(found)],
        figures={"suggested_over_random": round(ratio, 3)},
        complaints=complaints,
    )


def ratio_of_means(found: Sequence[SuggestionResult]) -> float:
    """Mean number of suggested throws over all worlds, over that of random ones."""
    suggested, random = (
        np.concatenate([getattr(each, way) for each in found]) for way in ("suggested", "random")
    )
    return float(suggested.mean() / random.mean())


def _table(found: Sequence[SuggestionResult]) -> Table:
    rows: list[list[Cell]] = []
    for each in found:
        (seed,), (suggested,), (random,) = each.seeds, each.suggested, each.random
        rows.append(
            [
                seed,
                _count(suggested, each.exhausted[0]),
                _count(random, each.exhausted[1]),
                each.suggested_over_random,
                BAR,
            ]
        )
    return Table(
        title=f"Throws until parameters are known to {PRECISION:.0%} of their bounds",
        columns=[
            Column("seed"),
            Column("suggested throws"),
            Column("random throws"),
            Column("ratio", "", ".2f"),
            Column("bar of the means' ratio", "", "g"),
        ],
        rows=rows,
        note=(
            f"A run is given up after {MOST_THROWS} throws and counts as that number. The defaults "
            "know nothing to that precision however many throws there are."
        ),
        remarks=[
            f"ratio of the means over {len(found)} worlds {ratio_of_means(found):.2f}, median of "
            f"the ratios {np.median([each.suggested_over_random for each in found]):.2f}"
        ],
    )


def _count(throws: int, exhausted: int) -> str:
    return f"{throws}, not enough" if exhausted else str(throws)


SUGGESTED = Part("suggested", ("suggested_over_random",), measure)
"""The part of suggested throws."""
