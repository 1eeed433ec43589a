"""Spheres, boxes and capsules in fixed steps: impacts at their time, contact forces by sweeps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.simulation.shares import run_in_shares
from intuitive_physics.simulation.simulator import Rollout, Simulator
from intuitive_physics.simulation.stepped.kernel import roll_worlds
from intuitive_physics.simulation.stepped.scratch import Scratch, scratch_sizes
from intuitive_physics.simulation.thread_scratch import ThreadScratch
from intuitive_physics.simulation.world_batch import WorldBatch

DEFAULT_TIME_STEP = 0.01

SMALLEST_SHARE = 4
"""Worlds for which another thread is worth its start."""

SCRATCH = ThreadScratch(Scratch)


class SteppedSimulator(Simulator):
    """Steps every scene there is: see `parts` for a step and `solver` for the contacts' laws.

    Parameters
    ----------
    time_step : s
    threads : worker threads over the worlds of a batch; the answer does not depend on it
    """

    name = "stepped"
    takes_contact_noise = True

    def __init__(self, *, time_step: float = DEFAULT_TIME_STEP, threads: int = 1) -> None:
        if not 1e-6 <= time_step <= 0.1:
            raise InvalidInputError(f"time step is {time_step} s; expected 1e-6 to 0.1 s")
        if threads < 1:
            raise InvalidInputError(f"threads is {threads}; expected at least 1")
        self.time_step = float(time_step)
        self.threads = threads

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        shape = (*worlds.states.shape[:2], times.shape[1])
        positions = np.empty((*shape, 3))
        turned = np.empty((*shape, 4) if orientations else (shape[0], 0, shape[2], 4))
        status = np.empty(worlds.size, dtype=np.int64)
        sizes = scratch_sizes(worlds)

        def roll(first: int, last: int) -> None:
            roll_worlds(
                first,
                last,
                self.time_step,
                worlds.object_counts,
                worlds.shape_kinds,
                worlds.dimensions,
                worlds.volumes,
                worlds.unit_inertias,
                worlds.object_materials,
                worlds.states,
                worlds.air_factors,
                worlds.mass_centres,
                worlds.environment_index,
                worlds.gravity,
                worlds.plane_counts,
                worlds.planes,
                worlds.plane_materials,
                worlds.corner_counts,
                worlds.corners,
                worlds.box_counts,
                worlds.boxes,
                worlds.box_materials,
                worlds.parameter_index,
                worlds.density,
                worlds.coefficients,
                worlds.noise_keys,
                worlds.contact_noise,
                times,
                SCRATCH.of_size(*sizes).world,
                positions,
                turned,
                status,
            )

        run_in_shares(roll, worlds.size, self.threads, SMALLEST_SHARE)
        return Rollout(positions, turned if orientations else None, status)
