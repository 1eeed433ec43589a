"""J against iterations and time: joint estimation and the paper's update rules, other engines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.command import report_progress
from benchmarks.learning.methods.cluster import compare_paces
from benchmarks.learning.methods.figure import draw_figure
from benchmarks.learning.methods.histories import joint_run, rule_history
from benchmarks.learning.methods.loop_beside import compare_lateness
from benchmarks.learning.methods.peers import compare_engines
from benchmarks.learning.methods.report import Histories, Joint, Measured, tables
from benchmarks.learning.paper_sets import make_task
from benchmarks.learning.part import Findings, Part, Plan
from intuitive_physics_learner import FURTHER_RULES, UPDATE_RULES

SETS = {"1x50": 1, "10x50": 10, "20x50": 20}
"""Numbers of objects by the name of the set: objects by samples."""


@dataclass(frozen=True)
class Effort:
    """How much is measured, for each set in the order of `SETS`.

    Parameters
    ----------
    seconds : that joint estimation may take on one set
    rule_seeds : runs of each update rule, on the same set
    iterations : of each of these
    further_iterations : of CMA-ES and its further kinds
    peer_seconds : that each other engine may take
    loop_seconds : that a loop beside the learner is watched for
    """

    seconds: tuple[float, ...]
    rule_seeds: tuple[int, ...]
    iterations: tuple[int, ...]
    further_iterations: tuple[int, ...]
    peer_seconds: float
    loop_seconds: float


FULL = Effort(
    seconds=(4.0, 20.0, 60.0),
    rule_seeds=(2, 1, 1),
    iterations=(500, 150, 60),
    further_iterations=(0, 200, 100),
    peer_seconds=10.0,
    loop_seconds=5.0,
)
"""Of the results that are kept."""

QUICK = Effort(
    seconds=(3.0, 10.0, 20.0),
    rule_seeds=(2, 1, 1),
    iterations=(150, 50, 25),
    further_iterations=(0, 50, 0),
    peer_seconds=5.0,
    loop_seconds=2.0,
)
"""Of a first look."""

KINDS_OF_CMA_ES = ("cma_es", *FURTHER_RULES)
"""Rules that are compared over many more iterations."""


def measure(plan: Plan) -> Findings:
    """Measure all."""
    effort = QUICK if plan.quick else FULL
    joint = run_joint(effort, plan.first_seed)
    histories = run_rules(effort, joint)
    further = run_further(effort, joint)
    report_progress("other engines")
    peers = compare_engines(effort.peer_seconds, plan.first_seed)
    report_progress("beside a loop, and on a cluster")
    beside = compare_lateness(joint["10x50"][0], effort.loop_seconds)
    paces = compare_paces(joint["10x50"][0])
    return Findings(
        tables=tables(Measured(joint, histories, further, peers, beside, paces)),
        draw=lambda path: draw_figure(histories, joint, path),
    )


def run_joint(effort: Effort, seed: int) -> Joint:
    """Run joint estimation on every set, after a step that loads and compiles all kernels."""
    report_progress("kernels")
    joint_run(make_task(10, 0), 0.0)
    joint: Joint = {}
    for (name, objects), seconds in zip(SETS.items(), effort.seconds, strict=True):
        report_progress(name)
        task = make_task(objects, seed)
        joint[name] = (task, joint_run(task, seconds))
    return joint


def run_rules(effort: Effort, joint: Joint) -> Histories:
    """Mean J over seeds after each iteration, by set and rule."""
    histories: Histories = {}
    for name, seeds, iterations in zip(SETS, effort.rule_seeds, effort.iterations, strict=True):
        task, _ = joint[name]
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
            task, _ = joint[name]
            histories[name] = {
                rule: rule_history(task, rule, 0, iterations) for rule in KINDS_OF_CMA_ES
            }
    return histories


METHODS = Part("methods", (), measure)
"""The part that compares methods, engines and ways to evaluate J."""
