"""Wall times of several engines, taken in turns so that a busy machine slows all alike."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import Engine, Prepared
from benchmarks.peers.ours import NAMES
from benchmarks.scenes import STEPS, TIME_STEP, Instance

# Seconds an engine's turn lasts at least: short predictions are repeated, their median counts
TURN = 0.02


@dataclass(frozen=True, eq=False)
class Measured:
    """What each engine did with one instance, by the engine's name.

    Seconds are the median wall time of one prediction; positions are
    (n_simulations, n_objects, STEPS, 3) m.
    """

    seconds: dict[str, float]
    positions: dict[str, NDArray[np.float64]]


def measure(engines: Sequence[Engine], instance: Instance, repetitions: int) -> Measured:
    """Let each engine predict an instance, one after the other, `repetitions` times.

    Each predicts once before, unmeasured, so that none pays for memory it touches first.
    """
    with ExitStack() as stack:
        prepared = {
            engine.name: stack.enter_context(engine.prepare(instance, STEPS, TIME_STEP))
            for engine in engines
        }
        positions = {name: world.predict().positions for name, world in prepared.items()}
        turns: dict[str, list[float]] = {name: [] for name in prepared}
        for _ in range(repetitions):
            for name, world in prepared.items():
                turns[name].append(_turn(world))
    seconds = {name: statistics.median(values) for name, values in turns.items()}
    return Measured(seconds, positions)


def own_engine(measured: Measured) -> str:
    """Return the engine of ours that stands for all: `auto`, or the one that was measured."""
    return next(name for name in NAMES if name in measured.seconds)


def best_peer(measured: Sequence[Measured]) -> str:
    """Return the engine that is not ours and the fastest on one scene, in whatever mode."""
    peers = [name for name in measured[0].seconds if not name.startswith(NAMES)]
    return min(peers, key=lambda name: typical_seconds(measured, name))


def ratio(measured: Sequence[Measured], slow: str, fast: str) -> float:
    """Return how many times longer `slow` takes than `fast`: the median over instances."""
    return statistics.median(m.seconds[slow] / m.seconds[fast] for m in measured)


def typical_seconds(measured: Sequence[Measured], name: str) -> float:
    """Return the median over instances of an engine's wall time."""
    return statistics.median(m.seconds[name] for m in measured)


def _turn(world: Prepared) -> float:
    seconds: list[float] = []
    while sum(seconds) < TURN:
        seconds.append(world.predict().seconds)
    return statistics.median(seconds)
