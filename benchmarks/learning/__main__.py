"""`make bench-learning`: learners beside the true θ_s and the untouched defaults.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from benchmarks.command import Outcome, measure_parts, run_benchmark
from benchmarks.learning import (
    attainable,
    camera,
    disturbed,
    mass_ratio,
    online,
    posterior_ranks,
    posterior_sampler,
    sets,
    stream,
    suggested,
)
from benchmarks.learning.methods import comparison
from benchmarks.results.beside_stored import beside_stored
from benchmarks.results.result import FOLDER, Cell, Column, Table

PARTS = {
    "sets": sets.measure,
    "camera": camera.measure,
    "online": online.measure,
    "mass_ratio": mass_ratio.measure,
    "disturbed": disturbed.measure,
    "stream": stream.measure,
    "suggested": suggested.measure,
    "ranks": posterior_ranks.measure,
    "sampler": posterior_sampler.measure,
    "methods": comparison.measure,
}
"""In the order in which they are measured and reported."""

# Measured only where `--only` names it: minutes for what changes only with the sets
ON_REQUEST = {"attainable": attainable.measure}
LINE = (
    "true_state_excess",
    "defaults_pass",
    "within_2_sigma",
    "identified",
    "attainable",
    "camera",
    "online_over_batch",
    "batch_over_batch",
    "online_within_2_sigma",
    "mass_ratio_90",
    "disturbed",
    "drift_observations",
    "drift_by_forgetting",
    "stream",
    "suggested_over_random",
    "rank_chi2",
)
"""Keys of the last line; null where the part that gives one was not measured."""

FIRST_SEED = 100  # of the random sets by default; tuning used lower ones


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, draw the figure, and print the line of JSON last."""
    parts = [*PARTS, *ON_REQUEST]
    return run_benchmark(
        "learning",
        __doc__,
        run,
        arguments,
        parts=parts,
        first_seed=FIRST_SEED,
    )


def run(options: argparse.Namespace) -> Outcome:
    """Measure all parts, or those that were chosen, and what each took."""
    costs: list[list[Cell]] = []

    def measured(name: str) -> Outcome:
        wall, processor = time.perf_counter(), cpu_seconds()
        try:
            return {**PARTS, **ON_REQUEST}[name](options.quick, options.first_seed)
        finally:
            costs.append([name, time.perf_counter() - wall, cpu_seconds() - processor])

    outcome = measure_parts({name: partial(measured, name) for name in options.only or PARTS})
    table = Table(
        title="What the parts took",
        columns=[
            Column("part"),
            Column("wall time", "s", ".0f"),
            Column("CPU time with that of its processes", "s", ".0f"),
        ],
        rows=costs,
    )
    seed, tables, part = options.first_seed, [*outcome.tables, table], list(options.only or ())
    if seed != FIRST_SEED:
        headings = f"seeds from {FIRST_SEED}", f"seeds from {seed}"
        of_same_parts = FOLDER / f"{'_'.join(['learning', *part])}.json"
        stored = of_same_parts if of_same_parts.exists() else FOLDER / "learning.json"
        tables = [beside_stored(outcome.key_figures, stored, headings), *tables]
        part.append(f"seed_{seed}")
    return replace(
        outcome,
        tables=tables,
        key_figures={**dict.fromkeys(LINE), **outcome.key_figures},
        note=f"Seeds of random sets from {seed} on.",
        part="_".join(part),
    )


def cpu_seconds() -> float:
    """Return CPU time of this process and of those that it started and that have ended."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    used = [resource.getrusage(kind) for kind in kinds]
    return sum(each.ru_utime + each.ru_stime for each in used)


if __name__ == "__main__":
    sys.exit(main())
