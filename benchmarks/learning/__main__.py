"""`make bench-learning`: learners beside the true θ_s and the untouched defaults.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections.abc import Sequence
from typing import Any

from benchmarks.command import Outcome, report_progress, run_benchmark
from benchmarks.learning.camera import CAMERA
from benchmarks.learning.disturbed import DISTURBED
from benchmarks.learning.information import INFORMATION
from benchmarks.learning.mass_ratio import MASS_RATIO
from benchmarks.learning.methods.comparison import METHODS
from benchmarks.learning.online import ONLINE
from benchmarks.learning.part import Findings, Part, Plan
from benchmarks.learning.sets import SETS
from benchmarks.learning.stream import STREAM
from benchmarks.learning.suggested import SUGGESTED
from benchmarks.peers.engine import MissingPeerError
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics.errors import IntuitivePhysicsError

PARTS = (SETS, CAMERA, ONLINE, MASS_RATIO, DISTURBED, STREAM, SUGGESTED, METHODS)
"""In the order in which they are measured and reported."""

PARTS_ON_REQUEST = (INFORMATION,)
"""Measured only where `--only` names them: they bound what learning can reach, and change only with
the sets."""

LINE = (
    "true_state_excess",
    "defaults_pass",
    "within_2_sigma",
    "identified",
    "camera",
    "online_over_batch",
    "mass_ratio_90",
    "disturbed",
    "drift_observations",
    "stream",
    "suggested_over_random",
)
"""Keys of the last line; null where the part that gives one was not measured."""

FIRST_SEED = 100
"""Of the random sets by default; tuning used lower ones."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, draw the figure, and print the line of JSON last."""
    names = [part.name for part in (*PARTS, *PARTS_ON_REQUEST)]
    return run_benchmark("learning", __doc__, run, arguments, parts=names, first_seed=FIRST_SEED)


def run(options: argparse.Namespace) -> Outcome:
    """Measure all parts, or those that were chosen."""
    parts: tuple[Part, ...] = PARTS
    if options.only is not None:
        parts = tuple(part for part in (*PARTS, *PARTS_ON_REQUEST) if part.name in options.only)
    return combined(parts, Plan(options.quick, options.first_seed))


def combined(parts: Sequence[Part], plan: Plan) -> Outcome:
    """Measure these parts one after the other.

    A part that fails is reported and makes the result invalid; the others are measured all the
    same.
    """
    findings: list[Findings] = []
    complaints: list[str] = []
    costs: list[list[Cell]] = []
    valid = True
    for part in parts:
        report_progress(f"part {part.name}")
        wall, processor = time.perf_counter(), cpu_seconds()
        try:
            findings.append(part.measure(plan))
        except (MissingPeerError, IntuitivePhysicsError) as error:
            complaints.append(f"{part.name}: {error}")
            valid = False
        costs.append([part.name, time.perf_counter() - wall, cpu_seconds() - processor])
    figures: dict[str, Any] = dict.fromkeys(LINE)
    for found in findings:
        figures.update(found.figures)
        complaints.extend(found.complaints)
    draws = [found.draw for found in findings if found.draw is not None]
    tables = [table for found in findings for table in found.tables]
    return Outcome(
        tables=[*tables, _cost_table(costs)],
        key_figures=figures,
        note=f"Seeds of random sets from {plan.first_seed} on.",
        complaints=complaints,
        valid=valid,
        draw=draws[0] if draws else None,
    )


def cpu_seconds() -> float:
    """Return CPU time of this process and of those that it started and that have ended."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    used = [resource.getrusage(kind) for kind in kinds]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _cost_table(costs: Sequence[Sequence[Cell]]) -> Table:
    return Table(
        title="What the parts took",
        columns=[
            Column("part"),
            Column("wall time", "s", ".0f"),
            Column("CPU time with that of its processes", "s", ".0f"),
        ],
        rows=costs,
    )


if __name__ == "__main__":
    sys.exit(main())
