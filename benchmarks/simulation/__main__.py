"""`make bench-simulation`: our simulators beside ODE, PyBullet and MuJoCo, in one interleaved run.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

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
from benchmarks.simulation.accuracy import Accuracy, accuracy
from benchmarks.simulation.agreement import Agreement, agreement, complaints, convergence, spread
from benchmarks.simulation.report import (
    accuracy_table,
    agreement_table,
    batches_table,
    convergence_table,
    key_figures,
    objects_table,
    own_engine,
    speed_table,
    start_up_table,
)
from benchmarks.simulation.scaling import scale_batches, scale_objects
from benchmarks.simulation.start_up import start_up
from benchmarks.timing import Measured, measure

SEED = 3
"""Of all that is random."""


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Parameters
    ----------
    instances : random instances of each scene
    repetitions : turns of each engine at each instance
    scaling_instances : random instances of each number of objects
    scaling_repetitions : turns of each engine at each size
    witnesses : spheres with which ODE is held against `event_driven` at small steps
    drops : random drops
    loads : processes that load the kernels
    """

    instances: int
    repetitions: int
    scaling_instances: int
    scaling_repetitions: int
    witnesses: int
    drops: int
    loads: int


FULL = Effort(
    instances=8,
    repetitions=5,
    scaling_instances=3,
    scaling_repetitions=3,
    witnesses=8,
    drops=100,
    loads=5,
)
"""Of the results that are kept."""

QUICK = Effort(
    instances=2,
    repetitions=1,
    scaling_instances=1,
    scaling_repetitions=1,
    witnesses=2,
    drops=20,
    loads=1,
)
"""Of a first look."""

Scenes = dict[str, list[tuple[Instance, Measured]]]
"""Instances and what was measured of each, by scene."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    return run_benchmark(
        "simulation", __doc__, lambda options: run(QUICK if options.quick else FULL), arguments
    )


def run(effort: Effort) -> Outcome:
    """Measure all; the result is not valid where the engines do not simulate the same physics."""
    rng = np.random.default_rng(SEED)
    engines = all_engines()
    scenes = compare(engines, effort, rng)
    measured = {name: [m for _, m in pairs] for name, pairs in scenes.items()}
    report_progress("agreement and accuracy")
    distances = convergence(effort.witnesses, rng)
    found = compare_accuracy(effort, rng)
    report_progress("batches and threads")
    batches = list(scale_batches(effort.scaling_repetitions, rng))
    report_progress("numbers of objects")
    objects = list(
        scale_objects([Ode()], effort.scaling_instances, effort.scaling_repetitions, rng)
    )
    report_progress("compiling and loading")
    kernels = start_up(effort.loads)
    agreed = agreements(scenes)
    doubts = complaints(agreed, distances)
    return Outcome(
        tables=[
            speed_table(measured, {engine.name: engine.how for engine in engines}),
            agreement_table(agreed),
            convergence_table(distances),
            accuracy_table(found, effort.drops),
            batches_table(batches),
            objects_table(objects),
            start_up_table(kernels),
        ],
        key_figures=key_figures(measured, found, kernels),
        complaints=[f"not the same physics: {doubt}" for doubt in doubts],
        valid=not doubts,
    )


def all_engines() -> list[Engine]:
    """Return all that take part in the comparison of the four scenes."""
    return [
        *(Ours(name) for name in NAMES),
        *(Ours(name, orientations=True) for name in NAMES),
        Ode(),
        Ode(auto_disable=True),
        Ode(boxes_roll=False),
        Bullet(),
        Mujoco(),
    ]


def compare(engines: Sequence[Engine], effort: Effort, rng: np.random.Generator) -> Scenes:
    """Let all engines predict instances of each scene in turns."""
    scenes: Scenes = {}
    for name, kinds in SCENES.items():
        scenes[name] = []
        for i in range(effort.instances):
            report_progress(f"{name}, instance {i + 1} of {effort.instances}")
            instance = thrown(kinds, rng)
            scenes[name].append((instance, measure(engines, instance, effort.repetitions)))
    return scenes


def compare_accuracy(effort: Effort, rng: np.random.Generator) -> dict[str, Accuracy]:
    """Hold all engines against the same known laws."""
    seed = int(rng.integers(2**32))
    engines: list[Engine] = [*(Ours(name) for name in NAMES), Ode(), Bullet(), Mujoco()]
    return {
        engine.name: accuracy(engine, effort.drops, np.random.default_rng(seed))
        for engine in engines
    }


def agreements(scenes: Scenes) -> list[tuple[str, str, Agreement, float]]:
    """Compare each engine's trajectories with those of ours that `auto` picks."""
    rows = []
    for scene, pairs in scenes.items():
        for engine in pairs[0][1].positions:
            if engine.endswith("orientations"):
                continue
            found = [
                agreement(instance, m.positions[engine], m.positions[own_engine(m)])
                for instance, m in pairs
            ]
            mean_spread = float(np.mean([spread(m.positions[engine]) for _, m in pairs]))
            rows.append((scene, engine, _merged(found), mean_spread))
    return rows


def _merged(found: Sequence[Agreement]) -> Agreement:
    return Agreement(
        early=float(np.mean([a.early for a in found])),
        late=float(np.mean([a.late for a in found])),
        most_energy=max(a.most_energy for a in found),
        deepest=max(a.deepest for a in found),
    )


if __name__ == "__main__":
    sys.exit(main())
