"""Memory of clusters: what stays as it is from frame to frame need not be searched each time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.kernels import allocating_entry
from intuitive_physics_perception.detection.detections import DetectedSolid
from intuitive_physics_perception.environment.noise import RangeNoise

COUNT_TOLERANCE = 0.2
"""Part by which the size of a cluster may change while it stays as it is."""

MOVEMENT = 0.2
"""Movement of its centre while it stays as it is, in smallest sphere radii."""

MOVEMENT_SIGMAS = 3.0
"""Standard deviations of the movement that the noise of its readings makes, added to that."""

FIRST_SEARCHES = 3
"""Frames in a row in which a cluster is searched before it counts as known."""

SEARCH_PERIOD = 30
"""Frames after which a known cluster is searched again."""

FRAMES_REMEMBERED = 15
"""Frames for which a cluster that is not there is remembered: noise takes some in and out."""


@dataclass(eq=False)
class RememberedCluster:
    """A cluster, in how many frames it has stayed as it is, and the result of its search.

    Parameters
    ----------
    centre : (3,) m, mean of its points, in the frame that stands still
    count : of its points
    frames : in which it was there as it is now, less those in which its search had to wait
    phase : in which frame of a period it is searched, so that not all are in the same one
    result : the box or capsule that the last search found
    waited : frames in which its search had to wait, since the last one
    """

    centre: NDArray[np.float64]
    count: int
    frames: int
    phase: int
    result: DetectedSolid | None
    waited: int = 0

    @property
    def deserves_a_search(self) -> bool:
        """Whether to search it: what stays the same only rarely, as that costs most of the time."""
        turn = (self.frames + self.phase) % SEARCH_PERIOD == 0
        return self.frames < FIRST_SEARCHES or turn

    @property
    def has_just_come(self) -> bool:
        """Whether it was not there before, or elsewhere."""
        return self.frames == 0 and self.waited == 0


class ClusterMemory:
    """Recognises the clusters of the last frames.

    `min_radius` in m, of a sphere; `noise`: of the readings.
    """

    def __init__(self, min_radius: float, noise: RangeNoise) -> None:
        self._stillness = MOVEMENT * min_radius
        self._noise = noise
        self._pose = RigidTransform()
        self._turn = 0
        self._last: list[RememberedCluster] = []
        self._next: list[RememberedCluster] = []
        self._centres = np.zeros((0, 3))
        self._counts = np.zeros(0, dtype=np.int64)
        # Frames since each was there.
        self._unseen = np.zeros(0, dtype=np.int64)

    def look_from(self, pose: RigidTransform) -> None:
        """Take the pose of the sensor in a frame that stands still."""
        self._pose = pose

    def recall(
        self, middles: NDArray[np.float64], counts: NDArray[np.int64]
    ) -> list[RememberedCluster]:
        """Return what is known of the clusters of a frame, or of some of them.

        `middles` (n, 3) m, means of their points in the sensor's frame; `counts` (n,) of points.
        """
        centres = self._pose.points(middles)
        # The difference of the means of two times n readings.
        deviations = self._noise.deviation(np.linalg.norm(middles, axis=1))
        moved = MOVEMENT_SIGMAS * deviations * np.sqrt(2.0 * self._noise.correlated / counts)
        places = _recognised(
            centres, counts, np.square(self._stillness + moved), self._centres, self._counts
        )
        return [
            self._recalled(centre, count, k)
            for centre, count, k in zip(centres, counts.tolist(), places.tolist(), strict=True)
        ]

    def _recalled(self, centre: NDArray[np.float64], count: int, k: int) -> RememberedCluster:
        """What is known of one cluster, the `k`-th of the last frames; -1: nothing is."""
        if k < 0:
            self._turn += 1
            return RememberedCluster(centre, count, 0, self._turn, None)
        # Each is recalled once.
        self._counts[k] = 0
        old = self._last[k]
        old.centre, old.count, old.frames = centre, count, old.frames + 1
        return old

    def keep(self, cluster: RememberedCluster, result: DetectedSolid | None = None) -> None:
        """Remember a cluster for the next frame with what its search has found."""
        cluster.result, cluster.waited = result, 0
        self._next.append(cluster)

    def postpone(self, cluster: RememberedCluster) -> None:
        """Remember a cluster of which the search has to wait for the next frame."""
        cluster.frames -= 1
        cluster.waited += 1
        self._next.append(cluster)

    def end_frame(self) -> None:
        """Forget clusters that were neither kept nor there for a while."""
        missing = np.flatnonzero((self._counts > 0) & (self._unseen < FRAMES_REMEMBERED))
        unseen = self._unseen[missing] + 1
        self._last, self._next = self._next + [self._last[k] for k in missing], []
        self._unseen = np.concatenate([np.zeros(len(self._last) - len(missing), np.int64), unseen])
        centres = [np.zeros(0), *(old.centre for old in self._last)]
        self._centres = np.concatenate(centres).reshape(-1, 3)
        self._counts = np.array([old.count for old in self._last], dtype=np.int64)


@allocating_entry
def _recognised(centres: Any, counts: Any, moved2: Any, old_centres: Any, old_counts: Any) -> Any:
    """The first of the last clusters that each of a frame (n,) is like, and none before it; -1 for
    none. `moved2` (n,) m²: square of the movement of one that stays; count 0 is of one taken."""
    places = np.full(counts.size, -1)
    taken = np.zeros(old_counts.size, dtype=np.bool_)
    for i in range(counts.size):
        for k in range(old_counts.size):
            if taken[k] or abs(counts[i] - old_counts[k]) >= COUNT_TOLERANCE * old_counts[k]:
                continue
            away2 = 0.0
            for axis in range(3):
                away2 += (centres[i, axis] - old_centres[k, axis]) ** 2
            if away2 < moved2[i]:
                places[i], taken[k] = k, True
                break
    return places
