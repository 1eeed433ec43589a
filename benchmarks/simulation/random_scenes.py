"""Random scenes, by the thousand, in which energy must not grow and nothing may overlap."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes import thrown
from benchmarks.simulation.energy import HELD, TIMES, Masses, largest_gains
from benchmarks.simulation.overlaps import Overlaps, find_overlaps
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import Rollout, make_simulator

KINDS = ("sphere", "box", "capsule")
MOST_OBJECTS = 6
HALF_ROOM = 1.5  # m; objects meet more often than in the large room
BATCH = 200  # scenes of a rollout
SPHERES_EVERY = 4  # one scene in as many has spheres only, for `event_driven`
DENSE_BATCH = 40  # scenes of a rollout with dense outputs
DENSE_TIMES = 0.002 * np.arange(1, 1501)  # s
MATERIALS = (*(f"material_{i}" for i in range(MOST_OBJECTS)), "room")


@dataclass(frozen=True)
class Kept:
    """How well an engine has kept to the laws in random scenes.

    The gain is the largest of all scenes, as `largest_gains` has it. Stopped are scenes whose
    status is not OK; they count until there.
    """

    engine: str
    scenes: int = 0
    stopped: int = 0
    energy_gain: float = 0.0
    dense_scenes: int = 0
    overlaps: Overlaps = field(default_factory=Overlaps)


def run_random_scenes(scenes: int, dense: int, rng: np.random.Generator) -> list[Kept]:
    """Simulate random scenes; in the first `dense` of them overlaps are measured, too."""
    kept = {name: Kept(name) for name in HELD}
    for first in range(0, scenes, BATCH):
        batch = [random_scene(rng, i) for i in range(first, min(first + BATCH, scenes))]
        parameters = [random_parameters(rng) for _ in batch]
        for name in kept:
            kept[name] = _energies(kept[name], batch, parameters)
            ending = max(0, min(dense - first, len(batch)))
            for begin in range(0, ending, DENSE_BATCH):
                part = slice(begin, min(begin + DENSE_BATCH, ending))
                kept[name] = _overlaps(kept[name], batch[part], parameters[part])
    return list(kept.values())


def random_scene(rng: np.random.Generator, number: int) -> Scene:
    """Return one to six objects thrown through a small room."""
    count = rng.integers(1, MOST_OBJECTS + 1)
    kinds = ["sphere"] * count if number % SPHERES_EVERY == 0 else rng.choice(KINDS, count).tolist()
    return thrown(kinds, rng, simulations=1, half_room=HALF_ROOM).scene


def random_parameters(rng: np.random.Generator) -> StaticParameters:
    """Return θ_s of which all pairs differ."""
    size = len(MATERIALS)
    static, part, rolling, restitution = rng.uniform(size=(4, size, size))
    values = np.stack([1.2 * static, 1.2 * static * part, 0.1 * rolling, restitution])
    symmetric = np.triu(values) + np.triu(values, 1).transpose(0, 2, 1)
    return StaticParameters(MATERIALS, rng.uniform(50.0, 3000.0, size), symmetric)


def _energies(kept: Kept, scenes: list[Scene], parameters: list[StaticParameters]) -> Kept:
    scenes, parameters = _able(kept.engine, scenes, parameters)
    if not scenes:
        return kept
    rollout = _rollout(kept.engine, scenes, parameters, TIMES)
    gains = largest_gains(
        Masses.of(scenes, parameters),
        rollout.positions,
        _orientations(rollout),
        HELD[kept.engine],
    )
    return replace(
        kept,
        scenes=kept.scenes + len(scenes),
        stopped=kept.stopped + int((rollout.status != 0).sum()),
        energy_gain=max(kept.energy_gain, float(gains.max())),
    )


def _overlaps(kept: Kept, scenes: list[Scene], parameters: list[StaticParameters]) -> Kept:
    scenes, parameters = _able(kept.engine, scenes, parameters)
    if not scenes:
        return kept
    rollout = _rollout(kept.engine, scenes, parameters, DENSE_TIMES)
    found = find_overlaps(scenes, rollout.positions, _orientations(rollout))
    dense = kept.dense_scenes + len(scenes)
    return replace(kept, dense_scenes=dense, overlaps=kept.overlaps + found)


def _able(
    engine: str, scenes: list[Scene], parameters: list[StaticParameters]
) -> tuple[list[Scene], list[StaticParameters]]:
    """Return the scenes that an engine simulates, and their θ_s."""
    able = [
        (scene, theta)
        for scene, theta in zip(scenes, parameters, strict=True)
        if engine != "event_driven" or all(isinstance(o.shape, Sphere) for o in scene.objects)
    ]
    return [scene for scene, _ in able], [theta for _, theta in able]


def _rollout(
    engine: str,
    scenes: list[Scene],
    parameters: list[StaticParameters],
    times: NDArray[np.float64],
) -> Rollout:
    return make_simulator(engine).rollout(scenes, parameters, times)


def _orientations(rollout: Rollout) -> NDArray[np.float64]:
    if rollout.orientations is None:
        raise ValueError("the rollout has no orientations; ask for them")
    return rollout.orientations
