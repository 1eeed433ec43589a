"""Random scenes, by the thousand, in which energy must not grow and nothing may overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.ours import NAMES
from benchmarks.scenes import MIXED, thrown
from benchmarks.simulation.energy import TIMES, Masses, largest_gains
from benchmarks.simulation.overlaps import find_overlaps
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import Rollout, make_simulator

SEED = 36  # of all scenes
MOST_OBJECTS = 6
HALF_ROOM = 1.5  # m; objects meet more often than in the large room
BATCH = 200  # scenes of a rollout
SPHERES_EVERY = 4  # one scene in as many has spheres only
DENSE_BATCH = 40  # scenes of a rollout with dense outputs
DENSE_TIMES = np.linspace(0.002, 3.0, 1500)  # s
MATERIALS = (*(f"material_{i}" for i in range(MOST_OBJECTS)), "room")


@dataclass(frozen=True)
class Worst:
    """The largest value of all scenes, and the number of the scene that has it."""

    value: float = 0.0
    scene: int | None = None

    def or_of(self, values: NDArray[np.float64], numbers: Sequence[int]) -> Worst:
        """Return the worst of this and of values of scenes with these numbers."""
        k = int(values.argmax())
        return Worst(float(values[k]), numbers[k]) if values[k] > self.value else self


@dataclass(frozen=True)
class Kept:
    """How well an engine has kept to the laws in random scenes.

    The gain is as `largest_gains` has it, and overlaps are in m. Stopped are scenes whose status is
    not OK; they count until there.
    """

    engine: str
    scenes: int = 0
    stopped: int = 0
    gain: Worst = field(default_factory=Worst)
    dense_scenes: int = 0
    in_planes: Worst = field(default_factory=Worst)
    in_objects: Worst = field(default_factory=Worst)
    missed: int = 0

    @property
    def deepest(self) -> float:
        """m, in planes and objects."""
        return max(self.in_planes.value, self.in_objects.value)


def run_random_scenes(scenes: int, dense: int) -> list[Kept]:
    """Simulate random scenes; in the first `dense` of them overlaps are measured, too."""
    kept = {name: Kept(name) for name in NAMES}
    for name in kept:
        for first in range(0, scenes, BATCH):
            numbers = range(first, min(first + BATCH, scenes))
            for spheres in (True, False):
                alike = [number for number in numbers if spheres_only(number) == spheres]
                held = not spheres or name != "event_driven"
                kept[name] = _with_energies(kept[name], alike, held)
        for first in range(0, dense, DENSE_BATCH):
            numbers = range(first, min(first + DENSE_BATCH, dense))
            kept[name] = _with_overlaps(kept[name], numbers)
    return list(kept.values())


def random_scene(number: int) -> tuple[Scene, StaticParameters]:
    """Return one to six objects thrown through a small room, and their θ_s, always the same."""
    rng = np.random.default_rng([SEED, number])
    count = rng.integers(1, MOST_OBJECTS + 1)
    kinds = rng.choice(["sphere"] if spheres_only(number) else MIXED, count).tolist()
    scene = thrown(kinds, rng, simulations=1, half_room=HALF_ROOM).scene
    return scene, random_parameters(rng)


def spheres_only(number: int) -> bool:
    """Whether the scene of this number has spheres only by intention, not by chance."""
    return number % SPHERES_EVERY == 0


def random_parameters(rng: np.random.Generator) -> StaticParameters:
    """Return θ_s of which all pairs differ."""
    size = len(MATERIALS)
    static, part, rolling, restitution = rng.uniform(size=(4, size, size))
    values = np.stack([1.2 * static, 1.2 * static * part, 0.1 * rolling, restitution])
    symmetric = np.triu(values) + np.triu(values, 1).transpose(0, 2, 1)
    return StaticParameters(MATERIALS, rng.uniform(50.0, 3000.0, size), symmetric)


def _with_energies(kept: Kept, numbers: Sequence[int], held: bool) -> Kept:
    scenes, parameters, rollout = _rollout(kept.engine, numbers, TIMES)
    gains = largest_gains(
        Masses.of(scenes, parameters),
        rollout.positions,
        _orientations(rollout),
        held,
    )
    return replace(
        kept,
        scenes=kept.scenes + len(scenes),
        stopped=kept.stopped + int((rollout.status != 0).sum()),
        gain=kept.gain.or_of(gains, numbers),
    )


def _with_overlaps(kept: Kept, numbers: Sequence[int]) -> Kept:
    scenes, _, rollout = _rollout(kept.engine, numbers, DENSE_TIMES)
    found = find_overlaps(scenes, rollout.positions, _orientations(rollout))
    return replace(
        kept,
        dense_scenes=kept.dense_scenes + len(scenes),
        in_planes=kept.in_planes.or_of(found.in_planes, numbers),
        in_objects=kept.in_objects.or_of(found.in_objects, numbers),
        missed=kept.missed + int(found.missed.sum()),
    )


def _rollout(
    engine: str, numbers: Sequence[int], times: NDArray[np.float64]
) -> tuple[list[Scene], list[StaticParameters], Rollout]:
    drawn = [random_scene(number) for number in numbers]
    scenes, parameters = [scene for scene, _ in drawn], [theta for _, theta in drawn]
    return scenes, parameters, make_simulator(engine).rollout(scenes, parameters, times)


def _orientations(rollout: Rollout) -> NDArray[np.float64]:
    if rollout.orientations is None:
        raise ValueError("the rollout has no orientations; ask for them")
    return rollout.orientations
