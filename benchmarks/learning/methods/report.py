"""Tables of joint estimation over time, update rules, other engines and ways to evaluate J."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.methods.cluster import Pace
from benchmarks.learning.methods.histories import JointRun, seconds_to_tolerance
from benchmarks.learning.methods.peers import PeerResult
from benchmarks.learning.paper_sets import TOLERANCE, Task
from benchmarks.results.result import Cell, Column, Table
from benchmarks.steady_loop import Lateness
from intuitive_physics_learner import UPDATE_RULES

BARS = {"1x50": 2.0, "10x50": 30.0, "20x50": 120.0}
"""s within which the test split's J is to be within 5 % of the oracle's, on two quiet cores."""

Joint = dict[str, tuple[Task, JointRun]]
"""A task and its run of joint estimation, by set."""

Histories = dict[str, dict[str, NDArray[np.float64]]]
"""J in m after each evaluation, by set and rule."""


@dataclass(frozen=True)
class Measured:
    """All that was measured.

    Parameters
    ----------
    joint : a run of joint estimation by set
    rules : mean J over seeds of the paper's nine rules
    further : J of CMA-ES and its further kinds
    peers : what other engines reach
    beside : lateness of a loop beside the learner, that of the loop alone first
    paces : of evaluating J
    """

    joint: Joint
    rules: Histories
    further: Histories
    peers: list[PeerResult]
    beside: list[Lateness]
    paces: list[Pace]


def tables(measured: Measured) -> list[Table]:
    """Return all tables."""
    return [
        _reached(measured.joint),
        _rules(
            "The paper's nine rules: J over the training split in m, mean over seeds",
            measured.joint,
            measured.rules,
            tuple(UPDATE_RULES),
        ),
        _rules(
            "CMA-ES for hundreds of parameters: likewise, one seed",
            measured.joint,
            measured.further,
            tuple(next(iter(measured.further.values()))),
        ),
        _engines(measured.peers),
        _beside(measured.beside),
        Table(
            title="An evaluation of J over the training split, 10x50",
            columns=[Column("where"), Column("ms", "ms", ".1f")],
            rows=[[pace.where, pace.milliseconds] for pace in measured.paces],
        ),
    ]


def _reached(joint: Joint) -> Table:
    rows: list[list[Cell]] = []
    for name, (task, run) in joint.items():
        default = task.test_cost().costs([task.start])[0]
        rows.append(
            [
                name,
                seconds_to_tolerance(run, task.oracle[1]),
                BARS[name],
                run.test[-1] / task.oracle[1],
                default / task.oracle[1],
                "yes" if default <= (1.0 + TOLERANCE) * task.oracle[1] else "no",
                run.exact,
                task.oracle[2],
                task.exact_cost().costs([task.start])[0],
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


def _rules(title: str, joint: Joint, histories: Histories, rules: tuple[str, ...]) -> Table:
    rows: list[list[Cell]] = [
        [rule, *(float(some[rule][-1]) for some in histories.values())] for rule in rules
    ]
    rows.append(["(true θ_s)", *(joint[name][0].oracle[0] for name in histories)])
    columns = [
        Column(f"{name}, {some[rules[0]].size} iterations", "m", ".3f")
        for name, some in histories.items()
    ]
    return Table(title, [Column("rule"), *columns], rows)


def _engines(peers: list[PeerResult]) -> Table:
    return Table(
        title="One object, 50 samples: the same time with other engines as the learner's",
        columns=[
            Column("engine"),
            Column("steps"),
            Column("test J, m", "m", ".3f"),
            Column("oracle's J, m", "m", ".3f"),
            Column("how pairs are mapped"),
        ],
        rows=[[p.name, p.steps, p.test, p.oracle, p.how] for p in peers],
    )


def _beside(rows: list[Lateness]) -> Table:
    alone = rows[0]
    return Table(
        title="A 100 Hz loop on the one core of the background learner: ms from tick to work done",
        columns=[
            Column("beside it"),
            Column("median", "ms", ".2f"),
            Column("99 %", "ms", ".2f"),
            Column("worst", "ms", ".2f"),
            Column("99 % over that alone", "", ".2f"),
        ],
        rows=[[row.beside, row.median, row.most, row.worst, row.most / alone.most] for row in rows],
    )
