"""Tables of the learning benchmark, and its line of JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning_cluster import Pace
from benchmarks.learning_peers import PeerResult
from benchmarks.learning_runs import JointRun, Task, seconds_to_tolerance
from benchmarks.report import table
from benchmarks.steady_loop import Lateness
from intuitive_physics_learner import UPDATE_RULES

BARS = {"1x50": 2.0, "10x50": 30.0, "20x50": 120.0}
"""s within which the test split's J is to be within 5 % of the oracle's, on two quiet cores."""

Joint = dict[str, list[tuple[Task, JointRun]]]
Histories = dict[str, dict[str, NDArray[np.float64]]]
"""J in m after each evaluation, by set and rule."""


@dataclass(frozen=True)
class Measured:
    """All that was measured.

    Parameters
    ----------
    joint : runs of joint estimation by set
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


def report(measured: Measured) -> str:
    """Return all tables."""
    parts = [
        "# Learning benchmark",
        "## Joint estimation: J over the test split against that of the true θ_s",
        _reached(measured.joint),
        "## Recovered parameters (errors on the unit interval of the bounds)",
        _recovered(measured.joint),
        "## The paper's nine rules: J over the training split in m, mean over seeds",
        _rules(measured.joint, measured.rules, tuple(UPDATE_RULES)),
        "## CMA-ES for hundreds of parameters: likewise, one seed",
        _rules(measured.joint, measured.further, tuple(next(iter(measured.further.values())))),
        "## One object, 50 samples: the same time with other engines as the learner's",
        _engines(measured.peers),
        "## A 100 Hz loop on the one core of the background learner: ms from tick to work done",
        _beside(measured.beside),
        "## An evaluation of J over the training split, 10x50",
        table(
            ["where", "ms"], [[pace.where, f"{pace.milliseconds:.1f}"] for pace in measured.paces]
        ),
    ]
    return "\n\n".join(parts) + "\n"


def json_line(joint: Joint, histories: Histories) -> str:
    """Return medians over the sets; null where a median run did not come within 5 %."""
    seconds, excess = {}, {}
    for name, runs in joint.items():
        times = [seconds_to_tolerance(run, task.oracle[1]) for task, run in runs]
        median = float(np.median(times))
        seconds[name] = round(median, 3) if np.isfinite(median) else None
        ratios = [run.test[-1] / task.oracle[1] - 1.0 for task, run in runs]
        excess[name] = round(float(np.median(ratios)), 4)
    rules = min(len(some) for some in histories.values())
    return json.dumps(
        {"seconds_to_5_percent": seconds, "excess_over_oracle": excess, "rules_in_figure": rules}
    )


def _reached(joint: Joint) -> str:
    header = [
        "set",
        "s to 5 %",
        "bar",
        "test J / oracle's",
        "defaults' J / oracle's",
        "J from true initial states: learned",
        "oracle",
        "defaults",
        "s in all",
        "s to judge",
    ]
    rows = []
    for name, runs in joint.items():
        for task, run in runs:
            default = task.test_cost().costs([task.start])[0] / task.oracle[1]
            rows.append(
                [
                    name,
                    f"{seconds_to_tolerance(run, task.oracle[1]):.2f}",
                    f"{BARS[name]:g}",
                    f"{run.test[-1] / task.oracle[1]:.3f}",
                    f"{default:.3f}",
                    f"{run.exact:.3f}",
                    f"{task.oracle[2]:.3f}",
                    f"{task.exact_cost().costs([task.start])[0]:.3f}",
                    f"{run.seconds[-1]:.1f}",
                    f"{run.judging_seconds:.1f}",
                ]
            )
    return table(header, rows)


def _recovered(joint: Joint) -> str:
    rows = []
    for name, runs in joint.items():
        scores = np.abs(np.concatenate([run.scores for _, run in runs]))
        if scores.size:
            rows.append(
                [
                    name,
                    str(sum(run.active for _, run in runs)),
                    str(scores.size),
                    f"{np.mean(np.concatenate([run.errors for _, run in runs])):.4f}",
                    f"{np.mean(scores < 1.0):.0%}",
                    f"{np.mean(scores < 2.0):.0%}",
                ]
            )
    return table(["set", "active", "identified", "mean error", "within 1 σ", "within 2 σ"], rows)


def _rules(joint: Joint, histories: Histories, rules: tuple[str, ...]) -> str:
    header = ["rule"]
    header += [f"{name}, {some[rules[0]].size} iterations" for name, some in histories.items()]
    rows = [[rule, *(f"{some[rule][-1]:.3f}" for some in histories.values())] for rule in rules]
    rows.append(["(true θ_s)", *(f"{joint[name][0][0].oracle[0]:.3f}" for name in histories)])
    return table(header, rows)


def _engines(peers: list[PeerResult]) -> str:
    rows = [[p.name, str(p.steps), f"{p.test:.3f}", f"{p.oracle:.3f}", p.how] for p in peers]
    return table(["engine", "steps", "test J, m", "oracle's J, m", "how pairs are mapped"], rows)


def _beside(rows: list[Lateness]) -> str:
    alone = rows[0]
    return table(
        ["beside it", "median", "99 %", "worst", "99 % over that alone"],
        [
            [
                row.beside,
                f"{row.median:.2f}",
                f"{row.most:.2f}",
                f"{row.worst:.2f}",
                f"{row.most / alone.most:.2f}",
            ]
            for row in rows
        ],
    )
