"""`make bench-simulation`: our simulators beside other engines, in one interleaved run.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.command import Outcome, report_progress, run_benchmark
from benchmarks.peers.bullet_world import Bullet
from benchmarks.peers.engine import Engine, present
from benchmarks.peers.jolt import Jolt
from benchmarks.peers.mujoco_rollout import Mujoco
from benchmarks.peers.ode import Ode
from benchmarks.peers.ours import NAMES, Ours
from benchmarks.peers.rapier import Rapier
from benchmarks.scenes import CROWDS, SCENES, Instance, thrown
from benchmarks.simulation.accuracy import Accuracy, accuracy
from benchmarks.simulation.agreement import agreements, complaints, convergence
from benchmarks.simulation.billiards import measure_breaks
from benchmarks.simulation.random_scenes import run_random_scenes
from benchmarks.simulation.report import (
    accuracy_table,
    agreement_table,
    batches_table,
    breaks_table,
    convergence_table,
    kept_table,
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
    crowds: int  # instances of each scene of many objects
    repetitions: int  # turns of each engine at each instance, and at each break
    scaling_instances: int  # of each number of objects
    scaling_repetitions: int  # turns of each engine at each size
    witnesses: int  # spheres with which ODE at small steps is compared with `event_driven`
    drops: int
    loads: int  # processes that load the kernels
    breaks: int
    random_scenes: int
    dense_scenes: int  # of these, in which overlaps are searched


# For results that are kept, and for a first look
FULL = Effort(8, 4, 5, 3, 3, 8, 100, 5, breaks=8, random_scenes=100_000, dense_scenes=2_000)
QUICK = Effort(2, 1, 1, 1, 1, 2, 20, 1, breaks=2, random_scenes=1_000, dense_scenes=100)

Scenes = dict[str, list[tuple[Instance, Measured]]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    return run_benchmark("simulation", __doc__, run, arguments)


def run(options: argparse.Namespace) -> Outcome:
    """Measure all; the result is not valid where the engines do not simulate the same physics."""
    effort = QUICK if options.quick else FULL
    rng = np.random.default_rng(SEED)
    engines, left_out = present(all_engines())
    scenes = _scenes(SCENES, effort.instances, engines, effort, rng)
    report_progress("agreement and accuracy")
    distances = convergence(effort.witnesses, rng)
    accuracies = _accuracies(engines, effort.drops, rng)
    report_progress("batches and threads")
    batches = list(scale_batches(effort.scaling_repetitions, rng))
    report_progress("numbers of objects")
    objects = list(scale_objects(effort.scaling_instances, effort.scaling_repetitions, rng))
    scenes.update(_scenes(CROWDS, effort.crowds, engines, effort, rng))
    report_progress("billiard breaks")
    breaks = measure_breaks(effort.breaks, effort.repetitions, rng)
    report_progress("random scenes")
    kept = run_random_scenes(effort.random_scenes, effort.dense_scenes)
    report_progress("compiling and loading")
    kernels = start_up(effort.loads)
    measured = {name: [m for _, m in pairs] for name, pairs in scenes.items()}
    agreed = agreements(scenes)
    doubts = complaints(agreed, distances)
    return Outcome(
        tables=[
            speed_table(measured, {engine.name: engine.how for engine in engines}, left_out),
            agreement_table(agreed),
            convergence_table(distances),
            accuracy_table(accuracies, effort.drops),
            kept_table(kept),
            batches_table(batches),
            objects_table(objects),
            breaks_table(breaks),
            start_up_table(kernels),
        ],
        key_figures=key_figures(measured, accuracies, kernels, breaks, kept),
        complaints=[f"not the same physics: {doubt}" for doubt in doubts],
        valid=not doubts,
    )


def all_engines() -> list[Engine]:
    """Return all that are compared, in the order of the table."""
    return [
        *(Ours(name) for name in NAMES),
        *(Ours(name, orientations=True) for name in NAMES),
        Ode(),
        Ode(auto_disable=True),
        Ode(boxes_roll=False),
        Bullet(),
        Mujoco(),
        Jolt(),
        Jolt(sleeping=False),
        Jolt(world_each=True),
        Rapier(),
    ]


def _scenes(
    kinds_of: Mapping[str, Sequence[str]],
    instances: int,
    engines: Sequence[Engine],
    effort: Effort,
    rng: np.random.Generator,
) -> Scenes:
    """Measure random instances of scenes, by what is thrown in them."""
    scenes: Scenes = {}
    for name, kinds in kinds_of.items():
        scenes[name] = []
        for i in range(instances):
            report_progress(f"{name}, instance {i + 1} of {instances}")
            instance = thrown(kinds, rng)
            scenes[name].append((instance, measure(engines, instance, effort.repetitions)))
    return scenes


def _accuracies(
    engines: Sequence[Engine], drops: int, rng: np.random.Generator
) -> dict[str, Accuracy]:
    """Measure one mode of each engine, all on the same drops."""
    seed = int(rng.integers(2**32))
    chosen = {*NAMES, *(engine.name for engine in (Ode(), Bullet(), Mujoco(), Jolt(), Rapier()))}
    return {
        engine.name: accuracy(engine, drops, np.random.default_rng(seed))
        for engine in engines
        if engine.name in chosen
    }


if __name__ == "__main__":
    sys.exit(main())
