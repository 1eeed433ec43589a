"""The engines whose worlds the core rolls out."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnsupportedSceneError
from intuitive_physics.simulation.core.kernel import roll_worlds
from intuitive_physics.simulation.rigid_bodies.overlaps import behind_planes
from intuitive_physics.simulation.rigid_bodies.scratch import Scratch, scratch_sizes
from intuitive_physics.simulation.rigid_bodies.world import MOST_PLANES
from intuitive_physics.simulation.rollout import OutputArrays, Rollout, WorldStatus
from intuitive_physics.simulation.shares import ThreadScratch, run_in_shares
from intuitive_physics.simulation.simulator import Simulator
from intuitive_physics.simulation.world_batch import SPHERE, WorldBatch

DEFAULT_TIME_STEP = 0.01
"""s. Chosen for speed: impacts are timed within a step, so that it bounds no accuracy of theirs."""

LEAST_SHARE, LEAST_SHARE_OF_SPHERES = 4, 64
"""Worlds for which another thread is worth its start."""


class CoreSimulator(Simulator):
    """Shares the worlds of a batch among threads, each with scratch memory of its own.

    Parameters
    ----------
    time_step : s, of what has no closed form
    threads : worker threads over the worlds of a batch; the answer does not depend on it
    max_events : a world in which spheres in closed form have more events stops and is marked
        TOO_MANY_EVENTS

    Raises
    ------
    InvalidInputError
        When one of them is out of its range.
    """

    takes_contact_noise = True
    closed_forms: ClassVar[bool]
    """Whether motion is carried in closed form wherever it has one."""
    _scratch = ThreadScratch(Scratch)

    def __init__(
        self,
        *,
        time_step: float = DEFAULT_TIME_STEP,
        threads: int = 1,
        max_events: int = 100_000,
    ) -> None:
        if not 1e-6 <= time_step <= 0.1:
            raise InvalidInputError(f"time step is {time_step} s; expected 1e-6 to 0.1 s")
        if threads < 1:
            raise InvalidInputError(f"threads is {threads}; expected at least 1")
        if max_events < 1:
            raise InvalidInputError(f"max_events is {max_events}; expected at least 1")
        self.time_step = float(time_step)
        self.threads = threads
        self.max_events = max_events

    @property
    def settings(self) -> tuple[float, int, int]:
        """Time step, most events, and whether closed forms are used, as the kernel takes them."""
        return self.time_step, self.max_events, int(self.closed_forms)

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        in_steps = np.full(worlds.size, True)
        if self.closed_forms:
            in_steps = ~_in_closed_form(worlds)
        _check_planes(worlds, in_steps)
        count, objects = worlds.states.shape[:2]
        outputs = OutputArrays(
            times,
            positions=np.empty((count, objects, times.shape[1], 3)),
            orientations=np.empty((count, objects if orientations else 0, times.shape[1], 4)),
            status=np.empty(count, dtype=np.int64),
            stop=self.stop_flag.number,
        )
        sizes = scratch_sizes(worlds)
        arrays, results, settings = worlds.arrays, tuple(outputs), self.settings

        def roll(first: int, last: int) -> None:
            scratch = self._scratch.of_size(*sizes).world
            roll_worlds(first, last, arrays, results, scratch, settings)

        least_share = LEAST_SHARE if in_steps.any() else LEAST_SHARE_OF_SPHERES
        run_in_shares(roll, count, self.threads, least_share)
        behind = behind_planes(worlds)
        outputs.status[behind] = WorldStatus.BEHIND_PLANE
        outputs.positions[behind], outputs.orientations[behind] = np.nan, np.nan
        turned = outputs.orientations if orientations else None
        return Rollout(outputs.positions, turned, outputs.status)


class EventDrivenSimulator(CoreSimulator):
    """Jumps from event to event where motion has a closed form, and steps what has none.

    Free flight, sliding and rolling of spheres on a plane are parabolas, and their impacts roots of
    polynomials; capsules that roll have closed forms as well. See `spheres` and `stepped`.
    """

    name = "event_driven"
    closed_forms = True


class SteppedSimulator(CoreSimulator):
    """Steps all contacts: the witness of each closed form."""

    name = "stepped"
    closed_forms = False


def _in_closed_form(worlds: WorldBatch) -> NDArray[np.bool_]:
    """Whether each world has nothing but spheres without air, which never step, (W,)."""
    absent = np.arange(worlds.shape_kinds.shape[1]) >= worlds.object_counts[:, None]
    return ((worlds.shape_kinds == SPHERE) & ~worlds.has_air_forces | absent).all(axis=1)


def _check_planes(worlds: WorldBatch, in_steps: NDArray[np.bool_]) -> None:
    """Check that worlds (W,) of which something may step have few planes before bounded ones.

    Raises
    ------
    UnsupportedSceneError
        When one has a bounded plane behind the first `MOST_PLANES` ones.
    """
    environments = worlds.environment_index[in_steps]
    if (worlds.corner_counts[environments, MOST_PLANES:] > 0).any():
        raise UnsupportedSceneError(
            f"scene has {worlds.plane_counts[environments].max()} planes with a bounded one among "
            f"the last; bounded planes are simulated among the first {MOST_PLANES} only, put those "
            "first or leave some out"
        )
