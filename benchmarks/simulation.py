"""`make bench-simulation`: our simulators beside ODE, PyBullet and MuJoCo, in one interleaved run.

README.md beside this file says what is measured and how.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.accuracy import Accuracy, accuracy
from benchmarks.agreement import Agreement, agreement, complaints, convergence, spread
from benchmarks.peers.bullet_world import Bullet
from benchmarks.peers.engine import Engine, MissingPeerError
from benchmarks.peers.mujoco_rollout import Mujoco
from benchmarks.peers.ode import Ode
from benchmarks.peers.ours import NAMES, Ours
from benchmarks.report import (
    accuracy_text,
    agreement_text,
    batches_text,
    json_line,
    objects_text,
    own_engine,
    speed_text,
    start_up_text,
)
from benchmarks.scaling import scale_batches, scale_objects
from benchmarks.scenes import SCENES, Instance, thrown
from benchmarks.start_up import start_up
from benchmarks.timing import Measured, measure

RESULTS = Path(__file__).resolve().parent / "results/simulation.md"
SEED = 3


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
QUICK = Effort(
    instances=2,
    repetitions=1,
    scaling_instances=1,
    scaling_repetitions=1,
    witnesses=2,
    drops=20,
    loads=1,
)

Scenes = dict[str, list[tuple[Instance, Measured]]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="measure little, for a first look")
    parser.add_argument("--write", action="store_true", help=f"write the tables to {RESULTS} too")
    options = parser.parse_args(arguments)
    try:
        text, line, doubts = run(QUICK if options.quick else FULL)
    except MissingPeerError as error:
        print(f"bench-simulation: {error}", file=sys.stderr)
        return 1
    print(text)
    if options.write:
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text(text)
    for doubt in doubts:
        print(f"bench-simulation: not the same physics: {doubt}", file=sys.stderr)
    print(line)
    return 1 if doubts else 0


def run(effort: Effort) -> tuple[str, str, list[str]]:
    """Return the tables, the line of JSON, and what speaks against comparing the engines."""
    start = time.perf_counter()
    rng = np.random.default_rng(SEED)
    engines = all_engines()
    scenes = compare(engines, effort, rng)
    measured = {name: [m for _, m in pairs] for name, pairs in scenes.items()}
    _tell("agreement and accuracy")
    distances = convergence(effort.witnesses, rng)
    found = compare_accuracy(effort, rng)
    _tell("batches and threads")
    batches = list(scale_batches(effort.scaling_repetitions, rng))
    _tell("numbers of objects")
    objects = list(
        scale_objects([Ode()], effort.scaling_instances, effort.scaling_repetitions, rng)
    )
    _tell("compiling and loading")
    kernels = start_up(effort.loads)
    agreed = agreements(scenes)
    texts = [
        "# Simulation benchmark",
        speed_text(measured, {engine.name: engine.how for engine in engines}),
        agreement_text(agreed, distances),
        accuracy_text(found, effort.drops),
        batches_text(batches),
        objects_text(objects),
        start_up_text(kernels),
        f"Measured in {time.perf_counter() - start:.0f} s.",
    ]
    doubts = complaints(agreed, distances)
    return "\n\n".join(texts) + "\n", json_line(measured, found, kernels), doubts


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
            _tell(f"{name}, instance {i + 1} of {effort.instances}")
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


def _tell(what: str) -> None:
    print(f"── {what}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
