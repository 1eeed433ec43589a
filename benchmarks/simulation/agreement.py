"""Whether the engines simulate the same physics, so that their times may be compared at all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.ode import Ode
from benchmarks.peers.ours import Ours
from benchmarks.scenes import DENSITY, STEPS, TIME_STEP, Instance, Surface, rolling_radius, thrown
from benchmarks.timing import Measured, own_engine

EARLY = 0.5  # s after which trajectories have not yet parted by chance
# Largest energy over that at the start; stepping engines push apart what has penetrated, which
# costs 1 % at 10 ms
MOST_ENERGY = 1.02
WITNESS_STEPS = (1e-2, 1e-3, 1e-4)  # s, steps of ODE with which it is compared with `event_driven`
# m, largest distance of both at the last of these; the rest is of the order of ODE's step
MOST_APART = 0.005


@dataclass(frozen=True)
class Agreement:
    """One engine's trajectories of a scene beside those of ours that `auto` picks.

    The energy is the largest kinetic energy of translation plus potential energy at any later time,
    over all energy at the start; above MOST_ENERGY an engine has made energy.
    """

    scene: str
    engine: str
    early: float  # m, mean distance after EARLY
    late: float  # m, mean distance at the end
    spread: float  # m, mean distance of noisy copies' end positions from their mean
    most_energy: float
    deepest: float  # m that an object's inner radius reached through the floor or a wall


def agreements(scenes: Mapping[str, Sequence[tuple[Instance, Measured]]]) -> list[Agreement]:
    """Compare each engine's trajectories of each scene."""
    return [
        _agreement(scene, engine, pairs)
        for scene, pairs in scenes.items()
        for engine in pairs[0][1].positions
        if not engine.endswith("orientations")
    ]


def _agreement(scene: str, engine: str, pairs: Sequence[tuple[Instance, Measured]]) -> Agreement:
    """Return means over instances, and the largest energy and depth."""
    early, late, spreads, energies, depths = [], [], [], [], []
    for instance, measured in pairs:
        positions = measured.positions[engine]
        apart = np.linalg.norm(positions - measured.positions[own_engine(measured)], axis=-1)
        early.append(apart[:, :, round(EARLY / TIME_STEP) - 1].mean())
        late.append(apart[:, :, -1].mean())
        ends = positions[:, :, -1]
        spreads.append(np.linalg.norm(ends - ends.mean(axis=0), axis=-1).mean())
        energies.append(_most_energy(instance, positions))
        depths.append(_deepest(instance, positions))
    return Agreement(
        scene,
        engine,
        early=float(np.mean(early)),
        late=float(np.mean(late)),
        spread=float(np.mean(spreads)),
        most_energy=max(energies),
        deepest=max(depths),
    )


def convergence(instances: int, rng: np.random.Generator) -> dict[float, float]:
    """Return the mean distance in m of ODE from `event_driven`, by ODE's step in s.

    One sphere thrown through the room, without rolling friction: ODE's acts in impacts and on
    contacts that slip, ours on those that roll only. All else is the same law, so that the
    distance vanishes with the step.
    """
    no_resistance = Surface(rolling_arm=0.0)
    distances: dict[float, list[float]] = {step: [] for step in WITNESS_STEPS}
    for _ in range(instances):
        instance = replace(thrown(["sphere"], rng, simulations=5), surface=no_resistance)
        with Ours("event_driven").prepare(instance, STEPS, TIME_STEP) as world:
            exact = world.predict().positions
        for step in WITNESS_STEPS:
            every = round(TIME_STEP / step)
            with Ode().prepare(instance, STEPS * every, step) as world:
                positions = world.predict().positions[:, :, every - 1 :: every]
            distances[step].append(float(np.linalg.norm(positions - exact, axis=-1).mean()))
    return {step: float(np.mean(values)) for step, values in distances.items()}


def complaints(rows: Iterable[Agreement], distances: Mapping[float, float]) -> list[str]:
    """Return what speaks against the same physics in agreements and distances of convergence."""
    doubts = [
        f"{a.engine} has {a.most_energy:.3f} times its first energy on {a.scene}; "
        f"expected at most {MOST_ENERGY:g}"
        for a in rows
        if not a.most_energy <= MOST_ENERGY
    ]
    step = WITNESS_STEPS[-1]
    if not distances[step] <= MOST_APART:
        doubts.append(
            f"ODE at a step of {1e3 * step:g} ms is {100 * distances[step]:.2f} cm from "
            f"event_driven; expected at most {100 * MOST_APART:g} cm"
        )
    return doubts


def _most_energy(instance: Instance, positions: NDArray[np.float64]) -> float:
    masses = np.array([shape.mass(DENSITY) for shape in instance.shapes])
    inertias = np.array([shape.inertia(DENSITY).max() for shape in instance.shapes])
    g = -instance.scene.environment.gravity[2]
    start = instance.starts
    turning = 0.5 * inertias * (start[..., 10:13] ** 2).sum(axis=-1)
    first = turning + masses * _specific_energy(start[..., 7:10], start[..., 2], g)
    # In free flight a difference of positions is the velocity half a step before.
    velocities = np.diff(positions, axis=2) / TIME_STEP
    heights = (positions[:, :, 1:, 2] + positions[:, :, :-1, 2]) / 2
    later = masses[:, None] * _specific_energy(velocities, heights, g)
    return float((later.sum(axis=1) / first.sum(axis=1)[:, None]).max())


def _specific_energy(
    velocities: NDArray[np.float64], heights: NDArray[np.float64], g: float
) -> NDArray[np.float64]:
    return 0.5 * (velocities**2).sum(axis=-1) + g * heights


def _deepest(instance: Instance, positions: NDArray[np.float64]) -> float:
    inner = np.array([rolling_radius(shape) for shape in instance.shapes])
    planes = instance.scene.environment.planes
    gaps = [plane.signed_distances(positions) - inner[:, None] for plane in planes]
    return max(0.0, -float(np.min(gaps)))
