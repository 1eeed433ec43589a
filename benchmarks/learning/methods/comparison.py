"""J against time: joint estimation, other engines, ways to evaluate J."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.command import Outcome, report_progress
from benchmarks.learning.methods.cluster import compare_paces
from benchmarks.learning.methods.figure import draw_figure
from benchmarks.learning.methods.joint_run import Joint, joint_run, seconds_to_tolerance
from benchmarks.learning.methods.loop_beside import compare_lateness
from benchmarks.learning.methods.peers import compare_engines
from benchmarks.learning.paper_sets import SIZES, TOLERANCE, make_task
from benchmarks.results.result import Cell, Column, Table

# s within which the test split's J is to be within 5 % of the oracle's, on two quiet cores
BARS = {"1x50": 2.0, "10x50": 30.0, "20x50": 120.0}


@dataclass(frozen=True)
class Effort:
    """How much is measured, for the set of each size in turn."""

    seconds: tuple[float, ...]  # that joint estimation may take
    peer_seconds: float  # that each other engine may take
    loop_seconds: float  # that a loop beside the learner is watched for
    candidates: int  # that threads and processes evaluate at once


# For results that are kept
FULL = Effort((4.0, 20.0, 60.0), 10.0, 5.0, 20)
QUICK = Effort((0.5, 1.0, 1.0), 0.5, 0.5, 2)  # for a first look


def measure(quick: bool, first_seed: int) -> Outcome:
    """Measure all."""
    effort = QUICK if quick else FULL
    joint = _run_joint(effort, first_seed)
    report_progress("other engines")
    engines = compare_engines(effort.peer_seconds, first_seed)
    report_progress("beside a loop, and on a cluster")
    task, _ = joint["10x50"]
    return Outcome(
        tables=[
            _joint_table(joint),
            engines,
            compare_lateness(task, effort.loop_seconds),
            compare_paces(task, effort.candidates),
        ],
        draw=lambda path: draw_figure(joint, path),
    )


def _run_joint(effort: Effort, seed: int) -> Joint:
    """Run joint estimation on every set, after a step that loads and compiles all kernels."""
    report_progress("kernels")
    joint_run(make_task(10, 0), 0.0)
    joint: Joint = {}
    for (name, size), seconds in zip(SIZES.items(), effort.seconds, strict=True):
        report_progress(name)
        task = make_task(size.objects, seed)
        joint[name] = (task, joint_run(task, seconds))
    return joint


def _joint_table(joint: Joint) -> Table:
    rows: list[list[Cell]] = []
    for name, (task, run) in joint.items():
        (default,) = task.compared(task.test_cost())
        (exact_default,) = task.compared(task.exact_cost())
        _, oracle, exact_oracle = task.oracle
        rows.append(
            [
                name,
                seconds_to_tolerance(run, oracle),
                BARS[name],
                run.test[-1] / oracle,
                default / oracle,
                "yes" if default <= (1.0 + TOLERANCE) * oracle else "no",
                run.exact,
                exact_oracle,
                exact_default,
                run.seconds[-1],
            ]
        )
    return Table(
        title="Time until test J is within 5 % of that of the true θ_s, one set each",
        columns=[
            Column("set"),
            Column("s to 5 %", "s", ".2f"),
            Column("bar", "s", "g"),
            Column("test J / oracle's", "", ".3f"),
            Column("defaults' J / oracle's", "", ".3f"),
            Column("defaults pass"),
            Column("J from true initial states: learned", "m", ".3f"),
            Column("oracle", "m", ".3f"),
            Column("defaults", "m", ".3f"),
            Column("s in all", "s", ".1f"),
        ],
        rows=rows,
    )
