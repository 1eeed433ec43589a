"""Each world by the engine that suits it: event_driven where it can, stepped elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation.event_driven import EventDrivenSimulator
from intuitive_physics.simulation.rollout import Rollout
from intuitive_physics.simulation.simulator import Simulator
from intuitive_physics.simulation.stepped import SteppedSimulator
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.simulation.world_batch import SPHERE, WorldBatch


class AutomaticSimulator(Simulator):
    """Simulates worlds of nothing but spheres, without air, event by event, all others in steps.

    Parameters
    ----------
    threads : worker threads over the worlds of a batch; the answer does not depend on it
    """

    name = "auto"
    takes_contact_noise = True

    def __init__(self, *, threads: int = 1) -> None:
        self.event_driven = EventDrivenSimulator(threads=threads)
        self.stepped = SteppedSimulator(threads=threads)

    def stopped_by(self, flag: StopFlag) -> AutomaticSimulator:
        """Return the same simulator whose simulations end once the flag is set."""
        made = super().stopped_by(flag)
        made.event_driven = self.event_driven.stopped_by(flag)
        made.stepped = self.stepped.stopped_by(flag)
        return made

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        suits = suits_event_driven(worlds)
        if suits.all():
            return self.event_driven._rollout(worlds, times, orientations)
        if not suits.any():
            return self.stepped._rollout(worlds, times, orientations)
        shape = (*worlds.states.shape[:2], times.shape[1])
        positions = np.empty((*shape, 3))
        turned = np.empty((*shape, 4)) if orientations else None
        status = np.empty(worlds.size, dtype=np.int64)
        for engine, chosen in ((self.event_driven, suits), (self.stepped, ~suits)):
            rows = times[chosen] if len(times) > 1 else times
            part = engine._rollout(worlds.taken(np.flatnonzero(chosen)), rows, orientations)
            positions[chosen], status[chosen] = part.positions, part.status
            if turned is not None:
                turned[chosen] = part.orientations
        return Rollout(positions, turned, status)


def suits_event_driven(worlds: WorldBatch) -> NDArray[np.bool_]:
    """Whether the event-driven engine can simulate each world, shape (W,)."""
    absent = np.arange(worlds.shape_kinds.shape[1]) >= worlds.object_counts[:, None]
    simple = (worlds.shape_kinds == SPHERE) & ~worlds.has_air_forces
    return (simple | absent).all(axis=1)
