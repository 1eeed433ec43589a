"""PyBullet behind the simulators' interface: another engine's opinion.

Spheres, boxes and capsules among planes without edges and static boxes. Where Bullet cannot express
a scene this engine refuses instead of simulating something else: see `surfaces` for the pairs of
materials, and Bullet knows neither planes with edges nor the forces of the air.
"""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.simulation.bullet.client import Client, roll_world
from intuitive_physics.simulation.bullet.plan import plan_world
from intuitive_physics.simulation.rollout import Rollout, WorldStatus
from intuitive_physics.simulation.simulator import Simulator
from intuitive_physics.simulation.world_batch import WorldBatch

_PYBULLET_LOCK = threading.Lock()
"""PyBullet crashes when two threads use it, each with a client of its own."""

DEFAULT_TIME_STEP = 1e-3
"""s. Bullet sees impacts at the ends of its steps only, so that these have to be short."""


class BulletSimulator(Simulator):
    """Simulates one world after the other in PyBullet; threads that share it take turns.

    Parameters
    ----------
    time_step : s, of the engine; outputs are interpolated linearly between steps
    """

    name = "bullet"

    def __init__(self, *, time_step: float = DEFAULT_TIME_STEP) -> None:
        if not 1e-6 <= time_step <= 0.1:
            raise InvalidInputError(f"time step is {time_step} s; expected 1e-6 to 0.1 s")
        self.time_step = time_step

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        plans = [plan_world(worlds, w) for w in range(worlds.size)]
        shape = (*worlds.states.shape[:2], times.shape[1])
        positions = np.full((*shape, 3), np.nan)
        turned = np.full((*shape, 4), np.nan)
        status = np.zeros(worlds.size, dtype=np.int64)
        with _PYBULLET_LOCK, Client() as engine:
            for w, plan in enumerate(plans):
                row = times[w if len(times) > 1 else 0]
                row = row[np.isfinite(row)]
                x, q = roll_world(engine, plan, row, self.time_step, self.stop_flag)
                if self.stop_flag.is_set():
                    break
                finite = np.isfinite(x).all() and np.isfinite(q).all()
                status[w] = WorldStatus.OK if finite else WorldStatus.NOT_FINITE
                if finite:
                    positions[w, : x.shape[1], : row.size] = x.transpose(1, 0, 2)
                    turned[w, : x.shape[1], : row.size] = q.transpose(1, 0, 2)
        return Rollout(positions, turned if orientations else None, status)
