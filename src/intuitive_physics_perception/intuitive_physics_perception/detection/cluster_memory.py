"""What stays as it is from frame to frame need not be searched each time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Found = TypeVar("Found")

SAME_COUNT = 0.2
SEARCHES, PERIOD = 3, 30
KEPT_UNSEEN = 15
"""Frames for which a cluster that is not there is remembered: noise takes some in and out."""


@dataclass(frozen=True, eq=False)
class RememberedCluster(Generic[Found]):
    """A cluster, in how many frames it has stayed as it is, and what was found in it.

    Parameters
    ----------
    centre : (3,) m, mean of its points
    count : of its points
    frames : in which it was there as it is now, less those in which its search had to wait
    phase : in which of `PERIOD` frames it has its turn, so that not all have it in the same
    found : what the last search found
    unseen : frames since it was there
    """

    centre: NDArray[np.float64]
    count: int
    frames: int
    phase: int
    found: Found | None
    unseen: int = 0

    @property
    def deserves_a_search(self) -> bool:
        """What stays the same is searched now and then only: it costs most of the time."""
        return self.frames < SEARCHES or (self.frames + self.phase) % PERIOD == 0


class ClusterMemory(Generic[Found]):
    """Knows clusters of the last frames again.

    Parameters
    ----------
    stillness : m that the centre of a cluster moves at most while it stays as it is
    """

    def __init__(self, stillness: float) -> None:
        self._stillness = stillness
        self._turn = 0
        self._last: list[RememberedCluster[Found]] = []
        self._next: list[RememberedCluster[Found]] = []

    def recall(self, own: NDArray[np.float64]) -> RememberedCluster[Found]:
        """Return what is known of a cluster of points (n, 3)."""
        centre, count = own.mean(axis=0), len(own)
        for k, old in enumerate(self._last):
            if (
                abs(count - old.count) < SAME_COUNT * old.count
                and np.linalg.norm(centre - old.centre) < self._stillness
            ):
                del self._last[k]
                return RememberedCluster(centre, count, old.frames + 1, old.phase, old.found)
        self._turn += 1
        return RememberedCluster(centre, count, 0, self._turn, None)

    def keep(self, cluster: RememberedCluster[Found], found: Found | None) -> None:
        """Remember a cluster for the next frame with what was found in it."""
        self._next.append(replace(cluster, found=found))

    def postpone(self, cluster: RememberedCluster[Found]) -> None:
        """Remember a cluster of which the search has to wait for the next frame."""
        self._next.append(replace(cluster, frames=cluster.frames - 1))

    def end_frame(self) -> None:
        """Forget clusters that were neither kept nor there for a while."""
        missing = [
            replace(old, unseen=old.unseen + 1) for old in self._last if old.unseen < KEPT_UNSEEN
        ]
        self._last, self._next = self._next + missing, []
