"""Finds the spheres in the clusters of a frame: which are searched, how far, and what touches."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.cluster_memory import ClusterMemory, RememberedCluster
from intuitive_physics_perception.detection.cluster_view import ClusterView, passing
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.fitted_sphere import EXPECTED_REACH, SphereFitter
from intuitive_physics_perception.detection.foreground import Clusters
from intuitive_physics_perception.detection.sphere_hypotheses import Effort, SphereHypotheses
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.settings import PerceptionSettings

APART_ROUNDS = 2
"""Rounds in which the spheres of a cluster are fitted again: in the first one, the others were
drawn to each other's side."""


@dataclass(frozen=True, eq=False)
class ClusterSpheres:
    """The spheres of one cluster.

    Parameters
    ----------
    cluster : (n,) indices of its points
    spheres : in it
    rest : part of its points that lie on none of them
    """

    cluster: NDArray[np.int64]
    spheres: list[DetectedSphere]
    rest: float


@dataclass(frozen=True, eq=False)
class Candidate:
    """A sphere found in a cluster, and whether it must end where no other sphere touches it: the
    part of a cluster that it was fitted to would be a ball even at the tip of a finger."""

    sphere: DetectedSphere
    must_end: bool


class RecentFrames:
    """The newest frames and their clusters, in which what is found only later was there already.

    Parameters
    ----------
    duration : s for which a frame is kept
    """

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self._frames: deque[tuple[float, NDArray[np.float32], Clusters]] = deque()

    def keep(self, time: float, points: NDArray[np.float32], clusters: Clusters) -> None:
        """Keep a frame.

        Parameters
        ----------
        time : s, of its stamp
        points : (height, width, 3) m
        clusters : of the frame
        """
        self._frames.append((time, points, clusters))
        while self._frames[0][0] < time - self._duration:
            self._frames.popleft()

    def forget(self) -> None:
        """Forget all frames: the sensor has moved, or time has gone back."""
        self._frames.clear()

    def before(self, time: float) -> tuple[float, NDArray[np.float32], Clusters] | None:
        """Return the newest frame before a time, None where none is kept.

        Parameters
        ----------
        time : s

        Returns
        -------
        tuple or None
            Time (s), points (height, width, 3) m, and their clusters.
        """
        earlier = (frame for frame in reversed(self._frames) if frame[0] < time)
        return next(earlier, None)


class SphereFinder:
    """Finds spheres in the foreground of frames.

    Parameters
    ----------
    noise : of the range readings
    settings : limits of what is a sphere
    rng : decides which hypotheses are tried
    before : (height, width) m, what an organised cloud read when the environment was modelled, NaN
        where nothing was; None where it is not known
    """

    def __init__(
        self,
        noise: RangeNoise,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        before: NDArray[np.float32] | None = None,
    ) -> None:
        self._before = before
        self._settings = settings
        self._search = settings.spheres
        self._memory: ClusterMemory[None] = ClusterMemory(
            settings.clusters.movement * settings.min_radius, settings.clusters, noise
        )
        self._lateral = noise.lateral
        self._fitter = SphereFitter(noise, settings, rng, knows_before=before is not None)
        self._hypotheses = SphereHypotheses(self._fitter, settings, rng)

    def find(
        self,
        points: NDArray[np.float32],
        clusters: Clusters,
        searches: int | None = None,
        expected: Sequence[NDArray[np.float64]] = (),
    ) -> list[ClusterSpheres]:
        """Return the spheres by cluster of a frame of points (height, width, 3), in the sensor's
        frame.

        Parameters
        ----------
        searches : clusters that are searched at random when neither expectation nor outline
            suggests a sphere: what is new first, then what has waited longest, then the smallest;
            the others wait for the next frame. None searches all
        expected : spheres (4,) m that are followed, where they should be
        """
        found = []
        left = len(clusters.indices) if searches is None else searches
        parts = [points.reshape(-1, 3)[one].astype(np.float64) for one in clusters.indices]
        remembered = [self._memory.recall(own) for own in parts]
        # What flickers is another cluster in each frame, and must not keep the others waiting.
        order = sorted(
            range(len(parts)),
            key=lambda k: (not clusters.new[k], -remembered[k].waited, len(parts[k])),
        )
        for k in order:
            cluster, own, known = clusters.indices[k], parts[k], remembered[k]
            here = [sphere for sphere in expected if _reaches(sphere, own)]
            effort = self._effort(known.deserves_a_search, left)
            inside = self._spheres_in(points, cluster, own, here, effort)
            if inside.spheres or effort is Effort.RANDOM:
                known = known.after_search(success=bool(inside.spheres))
            if inside.spheres:
                self._memory.keep(known, None)
                if not clusters.new[k] and not self._is_trusted(known):
                    inside = ClusterSpheres(cluster, [], 1.0)
            elif effort is Effort.RANDOM or not known.deserves_a_search:
                self._memory.keep(known, None)
                left -= effort is Effort.RANDOM
            else:
                self._memory.postpone(known)
            found.append(inside)
        self._memory.end_frame()
        return found

    def find_expected(
        self, points: NDArray[np.float32], clusters: Clusters, sphere: NDArray[np.float64]
    ) -> DetectedSphere | None:
        """Return the sphere in what is new in a frame of points (height, width, 3) that should be
        where one is expected, whatever it touches; None where none is.

        Parameters
        ----------
        points : m, in the sensor's frame
        clusters : of the frame
        sphere : (4,) m, centre and radius
        """
        for cluster, new in zip(clusters.indices, clusters.new, strict=True):
            own = points.reshape(-1, 3)[cluster].astype(np.float64)
            if not new or not _reaches(sphere, own):
                continue
            part = self._fitter.part_inside(own, sphere)
            if part.total < self._settings.min_points:
                continue
            view = ClusterView(points, cluster, self._search, self._before)
            found = self._fitter.fitted(view, part, sphere, size_is_known=True)
            if found is not None:
                return found
        return None

    def _is_trusted(self, known: RememberedCluster[None]) -> bool:
        """Whether what was there when the environment was modelled has been a sphere in enough
        searches: what looks like one only as the noise has it is none."""
        return known.successes >= self._search.static_successes * known.searches

    @staticmethod
    def _effort(deserves_a_search: bool, left: int) -> Effort:
        """How far a search goes: what has to wait for it is looked at by its outline."""
        if not deserves_a_search:
            return Effort.EXPECTED
        return Effort.RANDOM if left > 0 else Effort.OUTLINE

    def _spheres_in(
        self,
        points: NDArray[np.float32],
        cluster: NDArray[np.int64],
        own: NDArray[np.float64],
        expected: Sequence[NDArray[np.float64]],
        effort: Effort,
    ) -> ClusterSpheres:
        found: list[Candidate] = []
        left, rest = cluster, own
        while (
            len(found) < self._search.spheres_in_cluster and len(rest) >= self._settings.min_points
        ):
            view = ClusterView(points, left, self._search, self._before)
            candidate = self._best_sphere(view, rest, expected, effort)
            if candidate is None:
                break
            # What others have left of a cluster has outlines that are none, too.
            must_end = candidate.must_end or any(one.must_end for one in found)
            found.append(Candidate(candidate.sphere, must_end))
            off = self._miss(rest, candidate.sphere)
            left, rest = left[off], rest[off]
        if len(found) > 1 or any(one.must_end for one in found):
            found = self._apart(points, cluster, own, found)
        off = np.ones(len(own), dtype=bool)
        for one in found:
            off &= self._miss(own, one.sphere)
        return ClusterSpheres(cluster, [one.sphere for one in found], float(off.mean()))

    def _apart(
        self,
        points: NDArray[np.float32],
        cluster: NDArray[np.int64],
        own: NDArray[np.float64],
        found: list[Candidate],
    ) -> list[Candidate]:
        """Fit each sphere of a cluster again without the readings of the others, which drew it
        to their side where they touch; leave out those that go on into what is no sphere."""
        for _ in range(APART_ROUNDS):
            for one in list(found):
                off = np.ones(len(own), dtype=bool)
                for other in found:
                    if other is not one:
                        off &= self._miss(own, other.sphere)
                if off.sum() < self._settings.min_points:
                    continue
                view = ClusterView(points, cluster[off], self._search, self._before)
                most = self._search.touching_goes_on if one.must_end else None
                again = self._fitter.fitted(
                    view,
                    self._fitter.part_near(own[off], one.sphere.numbers),
                    one.sphere.numbers,
                    most,
                )
                k = found.index(one)
                if again is not None:
                    found[k] = Candidate(again, one.must_end)
                elif one.must_end:
                    del found[k]
        return found

    def _miss(self, points: NDArray[np.float64], sphere: DetectedSphere) -> NDArray[np.bool_]:
        """Which points' (n,) rays pass a sphere far enough not to be of it: noise must not make a
        second sphere of the readings that stray farthest."""
        stray = self._search.stray_sigmas * self._lateral * sphere.range
        return passing(points, sphere.center) > sphere.radius + stray

    def _best_sphere(
        self,
        view: ClusterView,
        own: NDArray[np.float64],
        expected: Sequence[NDArray[np.float64]],
        effort: Effort,
    ) -> Candidate | None:
        for part, hypothesis, must_end in self._hypotheses.of_cluster(view, own, expected, effort):
            if len(part.points) and part.total >= self._fewest(view, hypothesis):
                sphere = self._fitter.fitted(view, part, hypothesis)
                if sphere is not None:
                    return Candidate(sphere, must_end)
        return None

    def _fewest(self, view: ClusterView, sphere: NDArray[np.float64]) -> float:
        """Points below which a cluster is far too little of a sphere to be seen as one: a cheap
        test before the fit."""
        least = min(self._settings.min_visible_fraction, self._settings.min_partly_visible)
        return self._search.roughly_seen * least * view.readings_in_outline(sphere)


def _reaches(sphere: NDArray[np.float64], points: NDArray[np.float64]) -> bool:
    """Whether a sphere (4,) m comes near one of some points (n, 3) m."""
    away = np.linalg.norm(points - sphere[:3], axis=1)
    return bool(away.min() < EXPECTED_REACH * sphere[3])
