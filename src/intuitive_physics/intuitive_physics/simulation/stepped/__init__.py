"""Spheres, boxes and capsules in fixed steps: impacts at their time, contact forces by sweeps."""

from __future__ import annotations

from intuitive_physics.errors import InvalidInputError, UnsupportedSceneError
from intuitive_physics.simulation.kernel_simulator import KernelSimulator
from intuitive_physics.simulation.rigid_bodies.world import MOST_PLANES, Scratch, scratch_sizes
from intuitive_physics.simulation.shares import ThreadScratch
from intuitive_physics.simulation.stepped.kernel import roll_worlds
from intuitive_physics.simulation.world_batch import WorldBatch

DEFAULT_TIME_STEP = 0.01
"""s. Chosen for speed: impacts are timed within a step, so that it bounds no accuracy of theirs."""


class SteppedSimulator(KernelSimulator):
    """Steps every scene there is: see `parts` for a step and `solver` for the contacts' laws.

    Parameters
    ----------
    time_step : s
    threads : worker threads over the worlds of a batch; the answer does not depend on it
    """

    name = "stepped"
    scratch = ThreadScratch(Scratch)
    smallest_share = 4
    kernel = staticmethod(roll_worlds)

    def __init__(self, *, time_step: float = DEFAULT_TIME_STEP, threads: int = 1) -> None:
        if not 1e-6 <= time_step <= 0.1:
            raise InvalidInputError(f"time step is {time_step} s; expected 1e-6 to 0.1 s")
        super().__init__(threads=threads)
        self.time_step = float(time_step)

    def _check_supported(self, worlds: WorldBatch) -> None:
        if (worlds.corner_counts[:, MOST_PLANES:] > 0).any():
            raise UnsupportedSceneError(
                f"scene has {worlds.plane_counts.max()} planes with a bounded one among the last; "
                f"stepped simulates bounded planes among the first {MOST_PLANES} only, put those "
                "first or leave some out"
            )

    def _scratch_sizes(self, worlds: WorldBatch) -> tuple[int, ...]:
        return scratch_sizes(worlds)

    @property
    def _kernel_option(self) -> float:
        return self.time_step
