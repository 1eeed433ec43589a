"""`make bench-learning`: J against iterations and time on the paper's synthetic sets (Sec. IV-B).

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.command import Outcome, report_progress, run_benchmark
from benchmarks.learning.cluster import compare_paces
from benchmarks.learning.figure import draw_figure
from benchmarks.learning.loop_beside import compare_lateness
from benchmarks.learning.peers import compare_engines
from benchmarks.learning.report import Histories, Joint, Measured, key_figures, tables
from benchmarks.learning.runs import joint_run, make_task, rule_history
from intuitive_physics_learner import FURTHER_RULES, UPDATE_RULES

SETS = {"1x50": 1, "10x50": 10, "20x50": 20}
"""Numbers of objects by the name of the set: objects by samples."""


@dataclass(frozen=True)
class Effort:
    """How much is measured, for each set in the order of `SETS`.

    Parameters
    ----------
    sets : random sets on which joint estimation runs
    seconds : that each of these runs may take
    rule_seeds : runs of each update rule, all on the first set
    iterations : of each of these
    judged : whether uncertainties are found and held against the truth
    further_iterations : of CMA-ES and its further kinds
    peer_seconds : that each other engine may take
    loop_seconds : that a loop beside the learner is watched for
    """

    sets: tuple[int, ...]
    seconds: tuple[float, ...]
    rule_seeds: tuple[int, ...]
    iterations: tuple[int, ...]
    judged: tuple[bool, ...]
    further_iterations: tuple[int, ...]
    peer_seconds: float
    loop_seconds: float


FULL = Effort(
    sets=(6, 2, 1),
    seconds=(4.0, 30.0, 90.0),
    rule_seeds=(5, 2, 2),
    iterations=(500, 150, 60),
    judged=(True, True, True),
    further_iterations=(0, 400, 200),
    peer_seconds=20.0,
    loop_seconds=5.0,
)
"""Of the results that are kept."""

QUICK = Effort(
    sets=(3, 1, 1),
    seconds=(3.0, 10.0, 20.0),
    rule_seeds=(2, 1, 1),
    iterations=(150, 50, 25),
    judged=(True, False, False),
    further_iterations=(0, 50, 0),
    peer_seconds=5.0,
    loop_seconds=2.0,
)
"""Of a first look."""

FIRST_SEED = 100
"""Of the sets; nothing was tuned on those from here on."""

KINDS_OF_CMA_ES = ("cma_es", *FURTHER_RULES)
"""Rules that are compared over many more iterations."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, draw the figure, and print the line of JSON last."""
    description = __doc__.splitlines()[0]
    return run_benchmark(
        "learning", description, lambda quick: run(QUICK if quick else FULL), arguments
    )


def run(effort: Effort) -> Outcome:
    """Measure all."""
    joint = run_joint(effort)
    histories = run_rules(effort, joint)
    further = run_further(effort, joint)
    report_progress("other engines")
    peers = compare_engines(effort.peer_seconds)
    report_progress("beside a loop, and on a cluster")
    beside = compare_lateness(joint["1x50"][0][0], effort.loop_seconds)
    paces = compare_paces(joint["10x50"][0][0])
    return Outcome(
        tables=tables(Measured(joint, histories, further, peers, beside, paces)),
        key_figures=key_figures(joint, histories),
        draw=lambda path: draw_figure(histories, joint, path),
    )


def run_joint(effort: Effort) -> Joint:
    """Run joint estimation on every set, after a step that loads and compiles all kernels."""
    report_progress("kernels")
    joint_run(make_task(10, 0), 0.0, judged=False)
    joint: Joint = {}
    for (name, objects), count, seconds, judged in zip(
        SETS.items(), effort.sets, effort.seconds, effort.judged, strict=True
    ):
        joint[name] = []
        for seed in range(count):
            report_progress(f"{name}, set {seed + 1} of {count}")
            task = make_task(objects, FIRST_SEED + seed)
            joint[name].append((task, joint_run(task, seconds, judged=judged)))
    return joint


def run_rules(effort: Effort, joint: Joint) -> Histories:
    """Mean J over seeds after each iteration, by set and rule."""
    histories: Histories = {}
    for name, seeds, iterations in zip(SETS, effort.rule_seeds, effort.iterations, strict=True):
        task = joint[name][0][0]
        histories[name] = {}
        for rule in UPDATE_RULES:
            report_progress(f"{name}, {rule}")
            runs = [rule_history(task, rule, seed, iterations) for seed in range(seeds)]
            histories[name][rule] = np.mean(runs, axis=0)
    return histories


def run_further(effort: Effort, joint: Joint) -> Histories:
    """J of CMA-ES and its further kinds after each of the same number of evaluations."""
    histories: Histories = {}
    for name, iterations in zip(SETS, effort.further_iterations, strict=True):
        if iterations:
            report_progress(f"{name}, {', '.join(KINDS_OF_CMA_ES)}")
            task = joint[name][0][0]
            histories[name] = {
                rule: rule_history(task, rule, 0, iterations) for rule in KINDS_OF_CMA_ES
            }
    return histories


if __name__ == "__main__":
    sys.exit(main())
