"""Memory of clusters: what stays as it is from frame to frame need not be searched each time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
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

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class RememberedCluster(Generic[Result]):
    """A cluster, in how many frames it has stayed as it is, and the result of its search.

    Parameters
    ----------
    centre : (3,) m, mean of its points, in the frame that stands still
    count : of its points
    frames : in which it was there as it is now, less those in which its search had to wait
    phase : in which frame of a period it is searched, so that not all are in the same one
    result : what the last search found
    unseen : frames since it was there
    waited : frames in which its search had to wait, since the last one
    searches, successes : how often it was searched, and how often something was found
    """

    centre: NDArray[np.float64]
    count: int
    frames: int
    phase: int
    result: Result | None
    unseen: int = 0
    waited: int = 0
    searches: int = 0
    successes: int = 0

    @property
    def deserves_a_search(self) -> bool:
        """Whether to search it: what stays the same only rarely, as that costs most of the time."""
        period = SEARCH_PERIOD
        return self.frames < FIRST_SEARCHES or (self.frames + self.phase) % period == 0

    @property
    def has_just_come(self) -> bool:
        """Whether it was not there before, or elsewhere."""
        return self.frames == 0 and self.waited == 0

    def after_search(self, *, success: bool) -> RememberedCluster[Result]:
        """Return it after a search; after a success it is searched in the next frame, too."""
        return replace(
            self,
            frames=0 if success else self.frames,
            searches=self.searches + 1,
            successes=self.successes + success,
        )


class ClusterMemory(Generic[Result]):
    """Recognises the clusters of the last frames.

    `stillness` is the largest movement in m of the centre of a cluster that stays as it is, without
    that by the noise of its readings.
    """

    def __init__(self, stillness: float, noise: RangeNoise) -> None:
        self._stillness = stillness
        self._noise = noise
        self._pose = RigidTransform()
        self._turn = 0
        self._last: list[RememberedCluster[Result]] = []
        self._next: list[RememberedCluster[Result]] = []
        self._centres = np.zeros((0, 3))
        self._counts = np.zeros(0, dtype=np.int64)

    def look_from(self, pose: RigidTransform) -> None:
        """Take the pose of the sensor in a frame that stands still."""
        self._pose = pose

    def recall(self, points: NDArray[np.float64]) -> RememberedCluster[Result]:
        """Return what is known of a cluster.

        `points` (n, 3) m, its points in the sensor's frame.
        """
        middle, count = points.mean(axis=0), len(points)
        centre = self._pose.points(middle)
        # The difference of the means of two times n readings.
        variance = self._noise.deviation(np.linalg.norm(middle)) ** 2 * self._noise.correlated
        moved = MOVEMENT_SIGMAS * np.sqrt(2.0 * variance / count)
        alike = (np.abs(count - self._counts) < COUNT_TOLERANCE * self._counts) & (
            np.square(self._centres - centre).sum(axis=1) < (self._stillness + moved) ** 2
        )
        if alike.any():
            k = int(np.argmax(alike))
            # Each is recalled once.
            self._counts[k] = 0
            old = self._last[k]
            return replace(old, centre=centre, count=count, frames=old.frames + 1, unseen=0)
        self._turn += 1
        return RememberedCluster(centre, count, 0, self._turn, None)

    def keep(self, cluster: RememberedCluster[Result], result: Result | None) -> None:
        """Remember a cluster for the next frame with the result of its search."""
        self._next.append(replace(cluster, result=result, waited=0))

    def postpone(self, cluster: RememberedCluster[Result]) -> None:
        """Remember a cluster of which the search has to wait for the next frame."""
        self._next.append(replace(cluster, frames=cluster.frames - 1, waited=cluster.waited + 1))

    def end_frame(self) -> None:
        """Forget clusters that were neither kept nor there for a while."""
        missing = [
            replace(old, unseen=old.unseen + 1)
            for old, count in zip(self._last, self._counts, strict=True)
            if count > 0 and old.unseen < FRAMES_REMEMBERED
        ]
        self._last, self._next = self._next + missing, []
        self._centres = np.array([old.centre for old in self._last]).reshape(-1, 3)
        self._counts = np.array([old.count for old in self._last], dtype=np.int64)
