"""The common part of the engines whose worlds a kernel rolls out."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.simulation.rigid_bodies.overlaps import behind_planes
from intuitive_physics.simulation.rollout import OutputArrays, Rollout, WorldStatus
from intuitive_physics.simulation.shares import ThreadScratch, run_in_shares
from intuitive_physics.simulation.simulator import Simulator
from intuitive_physics.simulation.world_batch import WorldBatch


class KernelSimulator(Simulator):
    """Shares the worlds of a batch among threads, each with scratch memory of its own.

    Parameters
    ----------
    threads : worker threads over the worlds of a batch; the answer does not depend on it
    """

    takes_contact_noise = True
    scratch: ClassVar[ThreadScratch]
    """Each thread's scratch, for worlds of the sizes that `_scratch_sizes` returns."""
    smallest_share: ClassVar[int]
    """Worlds for which another thread is worth its start."""
    kernel: ClassVar[Callable[..., None]]
    """Rolls out the worlds `first` to `last` (exclusive), as `kernel(first, last, worlds, outputs,
    scratch, option)`, by `WorldBatch.arrays` and `OutputArrays` as plain tuples."""

    def __init__(self, *, threads: int = 1) -> None:
        if threads < 1:
            raise InvalidInputError(f"threads is {threads}; expected at least 1")
        self.threads = threads

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        self._check_supported(worlds)
        count, objects = worlds.states.shape[:2]
        outputs = OutputArrays(
            times,
            positions=np.empty((count, objects, times.shape[1], 3)),
            orientations=np.empty((count, objects if orientations else 0, times.shape[1], 4)),
            status=np.empty(count, dtype=np.int64),
            stop=self.stop_flag.number,
        )
        sizes = self._scratch_sizes(worlds)
        arrays, results = worlds.arrays, tuple(outputs)

        def roll(first: int, last: int) -> None:
            scratch = self.scratch.of_size(*sizes).world
            self.kernel(first, last, arrays, results, scratch, self._kernel_option)

        run_in_shares(roll, count, self.threads, self.smallest_share)
        behind = behind_planes(worlds)
        outputs.status[behind] = WorldStatus.BEHIND_PLANE
        outputs.positions[behind], outputs.orientations[behind] = np.nan, np.nan
        turned = outputs.orientations if orientations else None
        return Rollout(outputs.positions, turned, outputs.status)

    @abstractmethod
    def _check_supported(self, worlds: WorldBatch) -> None:
        """Raise UnsupportedSceneError when the engine cannot express a world."""

    @abstractmethod
    def _scratch_sizes(self, worlds: WorldBatch) -> tuple[int, ...]:
        """Return the sizes of the scratch that the batch's largest world needs."""

    @property
    @abstractmethod
    def _kernel_option(self) -> float:
        """The last argument of the kernel, which is the engine's own."""
