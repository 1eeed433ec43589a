"""How our engines' time grows with worker threads, simulations in a batch, and objects."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.peers.ode import Ode
from benchmarks.peers.ours import NAMES, Ours
from benchmarks.scenes import MIXED, SCENES, SIMULATIONS, STEPS, thrown
from benchmarks.timing import measure, typical_seconds

BATCHES = (20, 200, 2000)  # numbers of simulations
THREADS = (1, 2)  # numbers of threads, with which the largest batch is simulated
# Kinds of objects that take turns and their numbers, by the name of the series
OBJECTS = {"spheres": (("sphere",), (1, 2, 5, 10, 20, 50)), "mixed": (MIXED, (1, 2, 5, 10, 20))}


@dataclass(frozen=True)
class Scaled:
    """One engine's time of a prediction of STEPS outputs, on one scene of one size."""

    scene: str
    engine: str
    simulations: int
    objects: int
    threads: int
    seconds: float

    @property
    def nanoseconds(self) -> float:
        """Wall time in ns for a body and an output."""
        return 1e9 * self.seconds / (self.simulations * self.objects * STEPS)


def scale_batches(repetitions: int, rng: np.random.Generator) -> Iterator[Scaled]:
    """Yield times of BATCHES simulations on one thread, and of the largest on THREADS."""
    for (scene, kinds), simulator in itertools.product(SCENES.items(), NAMES):
        first = thrown(kinds, rng)
        for size in BATCHES:
            instance = first.repeated(size, rng)
            counts = THREADS if size == BATCHES[-1] else THREADS[:1]
            engines = [Ours(simulator, threads=threads) for threads in counts]
            measured = measure(engines, instance, repetitions)
            for threads, engine in zip(counts, engines, strict=True):
                seconds = measured.seconds[engine.name]
                yield Scaled(scene, simulator, size, len(kinds), threads, seconds)


def scale_objects(instances: int, repetitions: int, rng: np.random.Generator) -> Iterator[Scaled]:
    """Yield times of OBJECTS objects in the room, ours and ODE's in turns."""
    engines = [*(Ours(name) for name in NAMES), Ode()]
    series = [
        (scene, kinds, count) for scene, (kinds, counts) in OBJECTS.items() for count in counts
    ]
    for scene, kinds, count in series:
        thrown_kinds = [kinds[i % len(kinds)] for i in range(count)]
        measured = [
            measure(engines, thrown(thrown_kinds, rng), repetitions) for _ in range(instances)
        ]
        for name in measured[0].seconds:
            seconds = typical_seconds(measured, name)
            yield Scaled(scene, name, SIMULATIONS, count, 1, seconds)
