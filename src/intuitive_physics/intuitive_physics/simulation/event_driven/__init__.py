"""Spheres among static planes, from event to event: exact, at a cost that grows with bounces."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnsupportedSceneError
from intuitive_physics.simulation.event_driven.kernel import roll_worlds
from intuitive_physics.simulation.simulator import Rollout, Simulator
from intuitive_physics.simulation.world_batch import SPHERE, WorldBatch

SMALLEST_SHARE = 16
"""Worlds for which another thread is worth its start."""


class EventDrivenSimulator(Simulator):
    """Jumps from event to event, between which motion has a closed form.

    Free flight, sliding and rolling on a plane are parabolas; impacts are roots of polynomials.
    See `contact_phases`, `impacts` and `clusters` for the laws.

    Parameters
    ----------
    threads : worker threads over the worlds of a batch; the answer does not depend on it
    max_events : a world with more events stops and is marked TOO_MANY_EVENTS
    """

    name = "event_driven"

    def __init__(self, *, threads: int = 1, max_events: int = 100_000) -> None:
        if threads < 1 or max_events < 1:
            raise InvalidInputError(
                f"threads is {threads} and max_events {max_events}; expected at least 1 of each"
            )
        self.threads = threads
        self.max_events = max_events

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        _check_supported(worlds)
        shape = (*worlds.states.shape[:2], times.shape[1])
        positions = np.full((*shape, 3), np.nan)
        turned = np.full((*shape, 4) if orientations else (shape[0], 0, shape[2], 4), np.nan)
        status = np.zeros(worlds.size, dtype=np.int64)

        def roll(first: int, last: int) -> None:
            roll_worlds(
                first,
                last,
                worlds.object_counts,
                worlds.dimensions,
                worlds.object_materials,
                worlds.states,
                worlds.environment_index,
                worlds.gravity,
                worlds.plane_counts,
                worlds.planes,
                worlds.plane_materials,
                worlds.parameter_index,
                worlds.density,
                worlds.coefficients,
                times,
                self.max_events,
                positions,
                turned,
                status,
            )

        shares = max(1, min(self.threads, worlds.size // SMALLEST_SHARE))
        if shares == 1:
            roll(0, worlds.size)
        else:
            edges = np.linspace(0, worlds.size, shares + 1).astype(int).tolist()
            with ThreadPoolExecutor(shares) as pool:
                list(pool.map(roll, edges[:-1], edges[1:]))
        return Rollout(positions, turned if orientations else None, status)


def _check_supported(worlds: WorldBatch) -> None:
    present = np.arange(worlds.shape_kinds.shape[1]) < worlds.object_counts[:, None]
    if (worlds.shape_kinds[present] != SPHERE).any():
        raise UnsupportedSceneError(
            "scene has an object that is not a sphere; event_driven simulates spheres only, "
            "use the bullet simulator"
        )
    for environment in worlds.environments:
        if environment.boxes:
            raise UnsupportedSceneError(
                f"environment has the static box {environment.boxes[0].id}; event_driven "
                "simulates planes only, use the bullet simulator"
            )
        for plane in environment.planes:
            if plane.boundary is not None:
                raise UnsupportedSceneError(
                    f"plane {plane.id} has a boundary; event_driven simulates planes without "
                    "edges only, leave the boundary out"
                )
