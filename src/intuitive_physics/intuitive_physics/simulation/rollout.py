"""The result of a rollout of a batch of worlds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class WorldStatus(IntEnum):
    """The end of one world of a rollout.

    - OK: it was simulated to the end.
    - NOT_FINITE: a position or velocity has become infinite or NaN.
    - TOO_MANY_EVENTS: spheres in closed form have met more events than `max_events`, or something
      has hit something more than 512 times for each body in one step.
    - TOO_MANY_CONTACTS: objects touch more at once than there is room for: 12 planes and boxes for
      a sphere in closed form; 48 contact points for each object, in all.
    - TOO_FAST: more than 4096 advances of a pair in a step would be needed to be sure that the two
      do not pass through each other.
    - STOPPED: the simulation was ended by its flag.
    - NOT_CONVERGED: no forces or impulses were found that obey the laws at all contacts of bodies
      that touch one another.
    - BEHIND_PLANE: an object begins with its centre behind a bounded plane through which it
      reaches. The plane holds only what is in front of it; see `Simulator.rollout_batch`.
    """

    OK = 0
    NOT_FINITE = 1
    TOO_MANY_EVENTS = 2
    TOO_MANY_CONTACTS = 3
    TOO_FAST = 4
    STOPPED = 5
    NOT_CONVERGED = 6
    BEHIND_PLANE = 7


OK, NOT_FINITE, TOO_MANY_EVENTS, TOO_MANY_CONTACTS, TOO_FAST, STOPPED, NOT_CONVERGED, _ = map(
    int, WorldStatus
)
"""Each `WorldStatus` as kernels write it."""


@dataclass(frozen=True, eq=False)
class Rollout:
    """Positions and orientations of a batch of worlds.

    Parameters
    ----------
    positions : (n_worlds, n_objects, n_times, 3) m; NaN where a world has fewer objects or times,
        and from where on a world stopped with a status other than OK
    orientations : (n_worlds, n_objects, n_times, 4) unit quaternions (x, y, z, w), NaN likewise;
        None when they were not asked for
    status : (n_worlds,) of `WorldStatus`
    """

    positions: NDArray[np.float64]
    orientations: NDArray[np.float64] | None
    status: NDArray[np.int64]


class OutputArrays(NamedTuple):
    """Times asked of a kernel, and the arrays it fills, as one record: `OutputArrays(*outputs)`.

    Parameters
    ----------
    times : (W or 1, T) s, NaN only at a row's end
    positions : (W, O, T, 3) m
    orientations : (W, O, T, 4) unit quaternions (x, y, z, w); axis O has length zero when they are
        not wanted
    status : (W,) of `WorldStatus`
    stop : (1,) as `StopFlag.number`
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    orientations: NDArray[np.float64]
    status: NDArray[np.int64]
    stop: NDArray[np.int64]
