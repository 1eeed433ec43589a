"""The paper's way: other engines simulate the same predictions, alone and at their best."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.peers.bullet_world import Bullet
from benchmarks.peers.engine import Engine, MissingPeerError
from benchmarks.peers.ode import Ode
from benchmarks.peers.ours import Ours
from benchmarks.scenes import thrown
from benchmarks.timing import measure, typical_seconds

INSTANCES, REPETITIONS = 3, 2  # throws of each scene, and turns of each engine at each
SEED = 3  # of the throws


def peer_times(scenes: Mapping[str, Sequence[str]]) -> dict[str, dict[str, float]]:
    """Return wall times (s) of one prediction on one thread, by scene and engine.

    Our engines, PyBullet and ODE, where it is installed, take turns. Nothing is timed but the
    simulation and the writing of positions.
    """
    engines: list[Engine] = [Ours("event_driven"), Ours("stepped"), Bullet()]
    try:
        measure([Ode()], thrown(["sphere"], np.random.default_rng(SEED)), 1)
    except MissingPeerError as error:
        print(f"bench-prediction: without ODE: {error}", file=sys.stderr)
    else:
        engines.append(Ode())
    times = {}
    for name, kinds in scenes.items():
        rng = np.random.default_rng(SEED)
        measured = [measure(engines, thrown(kinds, rng), REPETITIONS) for _ in range(INSTANCES)]
        times[name] = {engine: typical_seconds(measured, engine) for engine in measured[0].seconds}
    return times
