"""What stays as it is from frame to frame need not be searched each time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Found = TypeVar("Found")

SAME_COUNT = 0.2
SEARCHES, PERIOD = 3, 10


@dataclass(frozen=True, eq=False)
class RememberedCluster(Generic[Found]):
    """A cluster, for how many frames it has stayed as it is, and what was found in it."""

    centre: NDArray[np.float64]
    count: int
    frames: int
    found: Found | None

    @property
    def deserves_a_search(self) -> bool:
        """What stays the same is searched now and then only: it costs most of the time."""
        return self.frames < SEARCHES or self.frames % PERIOD == 0


class ClusterMemory(Generic[Found]):
    """Knows clusters of the last frame again.

    Parameters
    ----------
    stillness : m that the centre of a cluster moves at most while it stays as it is
    """

    def __init__(self, stillness: float) -> None:
        self._stillness = stillness
        self._last: list[RememberedCluster[Found]] = []
        self._next: list[RememberedCluster[Found]] = []

    def recall(self, own: NDArray[np.float64]) -> RememberedCluster[Found]:
        """Return what is known of a cluster of points (n, 3)."""
        centre, count = own.mean(axis=0), len(own)
        for old in self._last:
            if (
                abs(count - old.count) < SAME_COUNT * old.count
                and np.linalg.norm(centre - old.centre) < self._stillness
            ):
                return RememberedCluster(centre, count, old.frames + 1, old.found)
        return RememberedCluster(centre, count, 0, None)

    def keep(self, cluster: RememberedCluster[Found], found: Found | None) -> None:
        """Remember a cluster for the next frame with what was found in it."""
        self._next.append(RememberedCluster(cluster.centre, cluster.count, cluster.frames, found))

    def end_frame(self) -> None:
        """Forget clusters that were not kept."""
        self._last, self._next = self._next, []
