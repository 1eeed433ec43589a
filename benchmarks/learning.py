"""`make bench-learning`: J against iterations and time on the paper's synthetic sets (Sec. IV-B).

README.md beside this file says what is measured and how.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning_figure import draw_figure
from benchmarks.learning_peers import PeerResult, compare_engines
from benchmarks.learning_runs import (
    JointRun,
    Task,
    joint_run,
    make_task,
    rule_history,
    seconds_to_tolerance,
)
from benchmarks.report import table
from intuitive_physics_learner import UPDATE_RULES

RESULTS = Path(__file__).resolve().parent / "results"
SETS = {"1x50": 1, "10x50": 10, "20x50": 20}
BARS = {"1x50": 2.0, "10x50": 30.0, "20x50": 120.0}
"""s within which the test split's J is to be within 5 % of the oracle's, on two quiet cores."""


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
    peer_seconds : that each other engine may take
    """

    sets: tuple[int, ...]
    seconds: tuple[float, ...]
    rule_seeds: tuple[int, ...]
    iterations: tuple[int, ...]
    judged: tuple[bool, ...]
    peer_seconds: float


FULL = Effort((10, 3, 2), (4.0, 45.0, 120.0), (10, 3, 2), (1000, 500, 300), (True,) * 3, 30.0)
QUICK = Effort((3, 1, 1), (3.0, 10.0, 20.0), (2, 1, 1), (150, 50, 25), (True, False, False), 5.0)

Joint = dict[str, list[tuple[Task, JointRun]]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, draw the figure, and print the line of JSON last."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="measure little, for a first look")
    parser.add_argument("--write", action="store_true", help=f"write tables to {RESULTS} too")
    options = parser.parse_args(arguments)
    effort = QUICK if options.quick else FULL
    joint = run_joint(effort)
    histories = run_rules(effort, joint)
    peers = compare_engines(effort.peer_seconds)
    text = report(joint, histories, peers)
    print(text)
    figure = RESULTS / "learning.svg" if options.write else Path("build/learning.svg")
    figure.parent.mkdir(parents=True, exist_ok=True)
    draw_figure(histories, joint, figure)
    print(f"figure: {figure}")
    if options.write:
        (RESULTS / "learning.md").write_text(text)
    print(json_line(joint, histories))
    return 0


def run_joint(effort: Effort) -> Joint:
    """Run joint estimation on every set, after a step that loads and compiles all kernels."""
    _tell("kernels")
    joint_run(make_task(10, 0), 0.0, judged=False)
    joint: Joint = {}
    for (name, objects), count, seconds, judged in zip(
        SETS.items(), effort.sets, effort.seconds, effort.judged, strict=True
    ):
        joint[name] = []
        for seed in range(count):
            _tell(f"{name}, set {seed + 1} of {count}")
            task = make_task(objects, seed)
            joint[name].append((task, joint_run(task, seconds, judged=judged)))
    return joint


def run_rules(effort: Effort, joint: Joint) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Mean J over seeds after each iteration, by set and rule."""
    histories: dict[str, dict[str, NDArray[np.float64]]] = {}
    for name, seeds, iterations in zip(SETS, effort.rule_seeds, effort.iterations, strict=True):
        task = joint[name][0][0]
        histories[name] = {}
        for rule in UPDATE_RULES:
            _tell(f"{name}, {rule}")
            runs = [rule_history(task, rule, seed, iterations) for seed in range(seeds)]
            # A rule that has converged has its last J from then on.
            padded = [np.pad(run, (0, iterations - run.size), mode="edge") for run in runs]
            histories[name][rule] = np.mean(padded, axis=0)
    return histories


def report(
    joint: Joint,
    histories: dict[str, dict[str, NDArray[np.float64]]],
    peers: list[PeerResult],
) -> str:
    """Return all tables."""
    reached = [
        ["set", "s to 5 %", "bar", "test J / oracle's", "defaults' J / oracle's", "s in all"]
    ]
    for name, runs in joint.items():
        for task, run in runs:
            default = task.test_cost().costs([task.start])[0] / task.oracle[1]
            reached.append(
                [
                    name,
                    f"{seconds_to_tolerance(run, task.oracle[1]):.2f}",
                    f"{BARS[name]:g}",
                    f"{run.test[-1] / task.oracle[1]:.3f}",
                    f"{default:.3f}",
                    f"{run.seconds[-1]:.1f}",
                ]
            )
    recovered = [["set", "active", "identified", "mean error", "within 1 σ", "within 2 σ"]]
    for name, runs in joint.items():
        scores = np.abs(np.concatenate([run.scores for _, run in runs]))
        if scores.size:
            recovered.append(
                [
                    name,
                    str(sum(run.active for _, run in runs)),
                    str(scores.size),
                    f"{np.mean(np.concatenate([run.errors for _, run in runs])):.4f}",
                    f"{np.mean(scores < 1.0):.0%}",
                    f"{np.mean(scores < 2.0):.0%}",
                ]
            )
    rules = [["rule", *(f"{name}, {_length(some)} iterations" for name, some in histories.items())]]
    for rule in UPDATE_RULES:
        rules.append([rule, *(f"{some[rule][-1]:.3f}" for some in histories.values())])
    rules.append(["(true θ_s)", *(f"{joint[name][0][0].oracle[0]:.3f}" for name in histories)])
    engines = [["engine", "steps", "test J, m", "oracle's J, m", "how pairs are mapped"]]
    engines += [[p.name, str(p.steps), f"{p.test:.3f}", f"{p.oracle:.3f}", p.how] for p in peers]
    return (
        "\n\n".join(
            [
                "# Learning benchmark",
                "## Joint estimation: J over the test split against that of the true θ_s",
                table(reached[0], reached[1:]),
                "## Recovered parameters (errors on the unit interval of the bounds)",
                table(recovered[0], recovered[1:]),
                "## The paper's nine rules: J over the training split in m, mean over seeds",
                table(rules[0], rules[1:]),
                "## One object, 50 samples: the same time with other engines as the learner's",
                table(engines[0], engines[1:]),
            ]
        )
        + "\n"
    )


def json_line(joint: Joint, histories: dict[str, dict[str, NDArray[np.float64]]]) -> str:
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


def _length(some: dict[str, NDArray[np.float64]]) -> int:
    return next(iter(some.values())).size


def _tell(what: str) -> None:
    print(f"── {what}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
