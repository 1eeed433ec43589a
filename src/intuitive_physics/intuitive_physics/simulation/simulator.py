"""The interface every engine stands behind."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError, UnsupportedSceneError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.rollout import Rollout
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.simulation.world_batch import WorldBatch, pack_worlds
from intuitive_physics.validation import increasing_times

Self = TypeVar("Self", bound="Simulator")


class Simulator(ABC):
    """Rolls out batches of worlds; holds no state between calls and may be shared by threads."""

    name: ClassVar[str]
    takes_contact_noise: ClassVar[bool] = False
    """Whether it can make impacts noisy."""
    threads: int = 1
    """Threads over the worlds of a batch."""
    stop_flag: StopFlag = StopFlag()
    """Ends its simulations once it is set; that of the class never is."""

    def stopped_by(self: Self, flag: StopFlag) -> Self:
        """Return the same simulator whose simulations end once the flag is set."""
        made = copy(self)
        made.stop_flag = flag
        return made

    def rollout(
        self,
        scenes: Sequence[Scene],
        static_parameters: StaticParameters | Sequence[StaticParameters],
        times: ArrayLike,
        *,
        orientations: bool = True,
        push_out: bool = False,
    ) -> Rollout:
        """Simulate each scene from its initial states.

        Parameters
        ----------
        scenes : n_worlds scenes
        static_parameters : one θ_s for all scenes or one for each
        times : (n_times,) s after the initial states, strictly increasing, none negative
        orientations : whether to answer orientations too
        push_out : whether to move objects out of bounded planes, as in `rollout_batch`

        Raises
        ------
        InvalidInputError
            When there is no scene, a material is unknown, the times are not as above or a scene
            begins with an object that overlaps another one, a plane or a static box by more than
            a quarter of the smaller object's inradius. Less is parted.
        UnsupportedSceneError
            When this engine cannot express a scene.
        """
        # Imported late: Numba takes a moment.
        from intuitive_physics.simulation.rigid_bodies.overlaps import check_overlaps

        worlds = pack_worlds(scenes, static_parameters)
        check_overlaps(scenes, worlds)
        return self.rollout_batch(worlds, times, orientations=orientations, push_out=push_out)

    def rollout_batch(
        self,
        worlds: WorldBatch,
        times: ArrayLike,
        *,
        orientations: bool = True,
        push_out: bool = False,
    ) -> Rollout:
        """Like `rollout`, for worlds that are packed already and may overlap at the start.

        Parameters
        ----------
        times : (n_times,) for all worlds, or (n_worlds, n_times), a row for each; a row may end
            in NaN, where no output is wanted
        push_out : whether to move objects that reach through a bounded plane from behind along its
            normal: until they touch the plane from its front, if their centre is behind it by less
            than half of the length that they reach along the normal, else until they are behind.
            Otherwise our engines end such worlds as BEHIND_PLANE.

        Raises
        ------
        InvalidInputError
            When the times are not as above.
        UnsupportedSceneError
            When this engine cannot express a world, or impacts that are noisy.
        SimulationStoppedError
            When its flag was set before the end.
        """
        if worlds.contact_noise.any() and not self.takes_contact_noise:
            raise UnsupportedSceneError(
                f"impacts are to be noisy, which {self.name} cannot simulate; "
                "set their noise to 0 or use the simulator event_driven or stepped"
            )
        checked = _checked_times(times, worlds.size)
        if push_out:
            # Imported late: Numba takes a moment.
            from intuitive_physics.simulation.rigid_bodies.overlaps import pushed_out

            worlds = pushed_out(worlds)
        rollout = self._rollout(worlds, checked, orientations)
        self.stop_flag.check()
        return rollout

    @abstractmethod
    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        """Simulate; `times` is checked and has the shape (n_worlds or 1, n_times)."""


def _checked_times(times: ArrayLike, worlds: int) -> NDArray[np.float64]:
    try:
        array = np.array(times, dtype=np.float64, order="C", ndmin=1)
    except (TypeError, ValueError):
        raise InvalidInputError(
            f"output times are {times!r:.80}; expected an array of numbers (s)"
        ) from None
    if array.ndim == 1:
        rows = increasing_times(array, "output times")[None, :]
    else:
        rows = array
        if rows.ndim != 2 or rows.shape[0] != worlds or rows.shape[1] == 0:
            raise InvalidInputError(
                f"output times have shape {rows.shape}; "
                f"expected (n_times,) or ({worlds}, n_times) with at least one time"
            )
        missing = np.isnan(rows)
        steps = np.diff(rows, axis=1)
        falls = ~missing[:, 1:] & ~(steps > 0.0)
        if missing[:, 0].any() or falls.any() or np.isinf(rows).any():
            raise InvalidInputError(
                "output times do not strictly increase in every row; "
                "expected increasing finite times, NaN only at the end of a row"
            )
    first = rows[:, 0].min()
    if first < 0.0:
        raise InvalidInputError(f"output times start at {first:g} s; expected ≥ 0")
    return rows
