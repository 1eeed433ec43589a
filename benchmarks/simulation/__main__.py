"""`make bench-simulation`: our simulators beside ODE, PyBullet and MuJoCo, in one interleaved run.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.command import Outcome, report_progress, run_benchmark
from benchmarks.peers.bullet_world import Bullet
from benchmarks.peers.engine import Engine
from benchmarks.peers.mujoco_rollout import Mujoco
from benchmarks.peers.ode import Ode
from benchmarks.peers.ours import NAMES, Ours
from benchmarks.scenes import SCENES, Instance, thrown
from benchmarks.simulation.accuracy import accuracy
from benchmarks.simulation.agreement import agreements, complaints, convergence
from benchmarks.simulation.report import (
    accuracy_table,
    agreement_table,
    batches_table,
    convergence_table,
    key_figures,
    objects_table,
    speed_table,
    start_up_table,
)
from benchmarks.simulation.scaling import scale_batches, scale_objects
from benchmarks.simulation.start_up import start_up
from benchmarks.timing import Measured, measure

SEED = 3  # of all that is random


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    instances: int  # of each scene
    repetitions: int  # turns of each engine at each instance
    scaling_instances: int  # of each number of objects
    scaling_repetitions: int  # turns of each engine at each size
    witnesses: int  # spheres with which ODE at small steps is compared with `event_driven`
    drops: int
    loads: int  # processes that load the kernels


FULL = Effort(8, 5, 3, 3, 8, drops=100, loads=5)  # for results that are kept
QUICK = Effort(2, 1, 1, 1, 2, drops=20, loads=1)  # for a first look


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    return run_benchmark("simulation", __doc__, run, arguments)


def run(options: argparse.Namespace) -> Outcome:
    """Measure all; the result is not valid where the engines do not simulate the same physics."""
    effort = QUICK if options.quick else FULL
    rng = np.random.default_rng(SEED)
    engines: list[Engine] = [
        *(Ours(name) for name in NAMES),
        *(Ours(name, orientations=True) for name in NAMES),
        Ode(),
        Ode(auto_disable=True),
        Ode(boxes_roll=False),
        Bullet(),
        Mujoco(),
    ]
    scenes: dict[str, list[tuple[Instance, Measured]]] = {}
    for name, kinds in SCENES.items():
        scenes[name] = []
        for i in range(effort.instances):
            report_progress(f"{name}, instance {i + 1} of {effort.instances}")
            instance = thrown(kinds, rng)
            scenes[name].append((instance, measure(engines, instance, effort.repetitions)))
    measured = {name: [m for _, m in pairs] for name, pairs in scenes.items()}
    report_progress("agreement and accuracy")
    distances = convergence(effort.witnesses, rng)
    # All engines are measured on the same drops.
    seed = int(rng.integers(2**32))
    accuracies = {
        engine.name: accuracy(engine, effort.drops, np.random.default_rng(seed))
        for engine in (*(Ours(name) for name in NAMES), Ode(), Bullet(), Mujoco())
    }
    report_progress("batches and threads")
    batches = list(scale_batches(effort.scaling_repetitions, rng))
    report_progress("numbers of objects")
    objects = list(scale_objects(effort.scaling_instances, effort.scaling_repetitions, rng))
    report_progress("compiling and loading")
    kernels = start_up(effort.loads)
    agreed = agreements(scenes)
    doubts = complaints(agreed, distances)
    return Outcome(
        tables=[
            speed_table(measured, {engine.name: engine.how for engine in engines}),
            agreement_table(agreed),
            convergence_table(distances),
            accuracy_table(accuracies, effort.drops),
            batches_table(batches),
            objects_table(objects),
            start_up_table(kernels),
        ],
        key_figures=key_figures(measured, accuracies, kernels),
        complaints=[f"not the same physics: {doubt}" for doubt in doubts],
        valid=not doubts,
    )


if __name__ == "__main__":
    sys.exit(main())
