"""Finds the spheres in the clusters of a frame: which are searched, how far, and what touches."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import allocating_entry
from intuitive_physics_perception.detection.cluster_memory import ClusterMemory, RememberedCluster
from intuitive_physics_perception.detection.cluster_view import ClusterView
from intuitive_physics_perception.detection.detections import NEW_GOES_ON, DetectedSphere
from intuitive_physics_perception.detection.fitted_sphere import (
    EXPECTED_REACH,
    MIN_PARTLY_VISIBLE,
    STRAY_SIGMAS,
    SphereFitter,
    Start,
)
from intuitive_physics_perception.detection.foreground import Clusters, in_a_row
from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.detection.sphere_hypotheses import (
    SPHERES_IN_CLUSTER,
    sphere_hypotheses,
)
from intuitive_physics_perception.detection.static_spheres import StaticSpheres
from intuitive_physics_perception.detection.swept_sphere import passing_way
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame import Scan
from intuitive_physics_perception.settings import PerceptionSettings

ROUGHLY_SEEN = 0.5
"""Part of the smallest visible fraction that a cluster must have for a sphere to be fitted."""

TOUCHING_GOES_ON = 0.2
"""`NEW_GOES_ON` of a sphere that was found inside the outline of a cluster, where the other spheres
of the cluster do not count: one more ball of its size covers 3 of 16 sectors, the finger that it
may be the tip of 4 or 5."""

ROUND_OUTLINE = 0.7
"""Part that a cluster is of the disc as wide as it is from which on it may be a ball by its
outline: half of a disc is one half."""

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


_Candidate = tuple[DetectedSphere, Start]
"""A sphere found in a cluster, and from where its fit began."""


class SphereFinder:
    """Finds spheres in the foreground of frames.

    `model`: the environment: a plane on which a sphere lies may go on round it.
    """

    def __init__(
        self, model: EnvironmentModel, settings: PerceptionSettings, rng: np.random.Generator
    ) -> None:
        noise = model.noise
        self._settings = settings
        self._memory = ClusterMemory(settings.min_radius, noise)
        self._static = StaticSpheres()
        self._lateral = noise.lateral
        self._fitter = SphereFitter(noise, settings, rng)
        self.look_from(model)

    def look_from(self, model: EnvironmentModel) -> None:
        """Take the same environment as the sensor sees it now."""
        self._memory.look_from(model.sensor_pose)
        self._static.look_from(model.sensor_pose)
        self._fitter.look_from(model)

    def find(
        self,
        points: NDArray[np.float32],
        clusters: Clusters,
        expected: Sequence[Start] = (),
        budget: FrameBudget | None = None,
        scan: Scan | None = None,
    ) -> list[ClusterSpheres]:
        """Return the spheres by cluster of a frame of points (height, width, 3), in the sensor's
        frame.

        `expected`: spheres that are followed, where they should be; `budget`: when it is spent,
        these alone are still looked for, and clusters that have not been searched to the end wait,
        too; but the first one, as it had nearly all of the time. None has no end; `scan`: when the
        points were read; None: all are of one time.
        """
        budget = budget or FrameBudget()
        results, searched = [], []
        flat = points.reshape(-1, 3)
        order, starts = clusters.in_a_row
        remembered = self._memory.recall(means_of(flat, order, starts), np.diff(starts))
        followed = _followed_in(flat, order, starts, expected)
        has_begun = False
        is_round = roundness_of(order, starts, points.shape[1]) > ROUND_OUTLINE
        if points.shape[0] == 1:
            is_round[:] = True
        for k in _in_turn(followed, clusters.new, remembered, is_round):
            cluster, memory = clusters.indices[k], remembered[k]
            budget.is_urgent = clusters.new[k] and memory.has_just_come
            if budget.is_spent and not followed[k]:
                budget.waiting += 1
                self._memory.postpone(memory)
                continue
            is_search = memory.deserves_a_search and not budget.is_spent
            inside = self._spheres_in(
                ClusterView(points, cluster, clusters.marks, scan),
                followed[k],
                budget,
                is_searched=is_search,
                may_move=memory.has_just_come,
            )
            results.append(inside)
            if has_begun and is_search and budget.is_spent and not inside.spheres:
                budget.waiting += 1
                self._memory.postpone(memory)
                continue
            has_begun |= is_search
            searched += [cluster] if is_search else []
            if inside.spheres:
                # It is searched in the next frame, too.
                memory.frames = 0
            if inside.spheres or is_search or not memory.deserves_a_search:
                self._memory.keep(memory)
            else:
                self._memory.postpone(memory)
        budget.is_urgent = False
        self._memory.end_frame()
        near = reached_by(flat, *in_a_row(searched), self._static.spheres).any(axis=0)
        self._static.take(near, [sphere for part in results for sphere in part.spheres])
        return [self._without_static(part) for part in results]

    def find_expected(
        self, points: NDArray[np.float32], clusters: Clusters, start: Start
    ) -> DetectedSphere | None:
        """Return the sphere in what is new in a frame of points (height, width, 3) that should be
        where one is expected, whatever it touches; None where none is.

        `points` in m, in the sensor's frame.
        """
        near = _followed_in(points.reshape(-1, 3), *clusters.in_a_row, [start])
        for k, cluster in enumerate(clusters.indices):
            if not (near[k] and clusters.new[k]):
                continue
            view = ClusterView(points, cluster, clusters.marks)
            part = self._fitter.part_inside(view, start)
            if part.total < self._settings.min_points:
                continue
            detected = self._fitter.fitted(view, part, replace(start, size_is_known=True))
            if detected is not None:
                return detected
        return None

    def _without_static(self, part: ClusterSpheres) -> ClusterSpheres:
        """A cluster's spheres without those that were there from the start and are seldom one."""
        balls = [
            sphere
            for sphere in part.spheres
            if sphere.outline is None
            or not sphere.outline.has_not_come
            or self._static.is_trusted(sphere)
        ]
        return replace(part, spheres=balls, rest=part.rest if balls else 1.0)

    def _spheres_in(
        self,
        whole: ClusterView,
        expected: Sequence[Start],
        budget: FrameBudget,
        *,
        is_searched: bool,
        may_move: bool,
    ) -> ClusterSpheres:
        candidates: list[_Candidate] = []
        view, fewest = whole, self._settings.min_points
        while len(candidates) < SPHERES_IN_CLUSTER and len(view.cluster) >= fewest:
            candidate = self._best_sphere(
                view,
                expected,
                budget,
                is_searched=is_searched,
                may_move=may_move and not candidates,
            )
            if candidate is None:
                break
            sphere, start = candidate
            # What others have left of a cluster has outlines that are none, too.
            must_end = start.must_end or any(earlier.must_end for _, earlier in candidates)
            candidates.append((sphere, replace(start, must_end=must_end)))
            view = view.part(self._off(view.readings, [sphere]))
        if len(candidates) > 1 or any(start.must_end for _, start in candidates):
            candidates = self._apart(whole, candidates, budget)
        spheres = [sphere for sphere, _ in candidates]
        rest = self._off(whole.readings, spheres).mean()
        return ClusterSpheres(whole.cluster, spheres, float(rest))

    def _apart(
        self, whole: ClusterView, candidates: list[_Candidate], budget: FrameBudget
    ) -> list[_Candidate]:
        """Fit each sphere of a cluster again without the readings of the others, which drew it
        to their side where they touch; leave out those that go on into what is no sphere, and all
        that may where there is no time to see it."""
        for _ in range(APART_ROUNDS):
            for candidate in list(candidates):
                sphere, start = candidate
                if budget.is_spent:
                    return [] if any(each.must_end for _, each in candidates) else candidates
                others = [other for other, _ in candidates if other is not sphere]
                view = whole.part(self._off(whole.readings, others))
                if len(view.cluster) < self._settings.min_points:
                    continue
                most = TOUCHING_GOES_ON if start.must_end else NEW_GOES_ON
                now = replace(start, sphere=sphere.numbers, sweep=sphere.sweep)
                refitted = self._fitter.fitted(view, self._fitter.part_near(view, now), now, most)
                k = candidates.index(candidate)
                if refitted is not None:
                    candidates[k] = refitted, start
                elif start.must_end:
                    del candidates[k]
        return candidates

    def _off(
        self, points: NDArray[np.float64], spheres: Iterable[DetectedSphere]
    ) -> NDArray[np.bool_]:
        """Mark the points (n,) whose rays pass all of some spheres by more than noise may stray."""
        off = np.ones(len(points), dtype=bool)
        for sphere in spheres:
            stray = STRAY_SIGMAS * self._lateral * sphere.range
            off &= passing_way(points, sphere.center, sphere.sweep) > sphere.radius + stray
        return off

    def _best_sphere(
        self,
        view: ClusterView,
        expected: Sequence[Start],
        budget: FrameBudget,
        *,
        is_searched: bool,
        may_move: bool,
    ) -> _Candidate | None:
        tried = False
        for part, start in sphere_hypotheses(
            view, expected, self._fitter, is_searched=is_searched, may_move=may_move
        ):
            if tried and budget.is_spent:
                return None
            tried = True
            if part.total >= self._fewest(view, start.sphere):
                sphere = self._fitter.fitted(view, part, start, beside_others=start.must_end)
                if sphere is not None:
                    return sphere, start
        return None

    def _fewest(self, view: ClusterView, sphere: NDArray[np.float64]) -> float:
        """Points below which a cluster is far too little of a sphere to be seen as one: a cheap
        test before the fit."""
        return ROUGHLY_SEEN * MIN_PARTLY_VISIBLE * view.readings_in_outline(sphere)


def _in_turn(
    followed: Sequence[Sequence[Start]],
    new: Sequence[bool],
    remembered: Sequence[RememberedCluster],
    is_round: Sequence[bool],
) -> list[int]:
    """Return the order in which clusters have their turn while there is time.

    What is followed comes first, then what is new, then the rest. Of the new ones, what has just
    come into view, as a ball in flight does in each frame, and what has waited longest take turns;
    of what has just come, what has a round outline is first, and of that what is large: what
    flickers is small and seldom round.
    """
    order = sorted(range(len(new)), key=lambda k: (-remembered[k].waited, remembered[k].count))
    came = [k for k in order if new[k] and not followed[k] and remembered[k].has_just_come]
    came.sort(key=lambda k: (not is_round[k], -remembered[k].count))
    stayed = [k for k in order if new[k] and not followed[k] and not remembered[k].has_just_come]
    taking_turns = [k for both in zip_longest(came, stayed) for k in both if k is not None]
    return [
        *(k for k in order if followed[k]),
        *taking_turns,
        *(k for k in order if not new[k] and not followed[k]),
    ]


def _followed_in(
    points: NDArray[np.float32],
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    expected: Sequence[Start],
) -> list[list[Start]]:
    """The expected spheres that come near a point of each cluster; arguments as of `reached_by`."""
    if not expected:
        return [[] for _ in starts[1:]]
    reach = np.array([start.sphere * [1.0, 1.0, 1.0, EXPECTED_REACH] for start in expected])
    return [
        [start for start, is_near in zip(expected, near, strict=True) if is_near]
        for near in reached_by(points, order, starts, reach)
    ]


@allocating_entry
def means_of(points: Any, order: Any, starts: Any) -> Any:
    """Return the mean (k, 3) of the points of each cluster.

    `points` (n, 3) float32 m; `order` (m,) indices of points, those of one cluster together;
    `starts` (k + 1,) where each cluster begins in it.
    """
    means = np.zeros((starts.size - 1, 3))
    for k in range(starts.size - 1):
        for j in range(starts[k], starts[k + 1]):
            for axis in range(3):
                means[k, axis] += points[order[j], axis]
        means[k] /= max(starts[k + 1] - starts[k], 1)
    return means


@allocating_entry
def roundness_of(order: Any, starts: Any, width: int) -> Any:
    """Return the part (k,) that each cluster is of the disc with its second moment along its
    longest axis: n pixels that fill a disc have n / 4π there.

    `order` and `starts` as in `means_of`, of pixels; `width` of the image.
    """
    parts = np.zeros(starts.size - 1)
    for k in range(starts.size - 1):
        n = starts[k + 1] - starts[k]
        # Whole numbers, and pixels in row-major order: neither divisions nor rounding.
        u = v = uu = uv = vv = 0
        row, end = -1, 0
        for j in range(starts[k], starts[k + 1]):
            while order[j] >= end:
                row, end = row + 1, end + width
            column = order[j] - (end - width)
            u, v = u + column, v + row
            uu, uv, vv = uu + column * column, uv + column * row, vv + row * row
        uu, uv, vv = n * uu - u * u, n * uv - u * v, n * vv - v * v
        longest = 0.5 * (uu + vv + np.sqrt(float(uu - vv) ** 2 + 4.0 * float(uv) ** 2)) / n**2
        parts[k] = n / (4.0 * np.pi * max(longest, 1e-9))
    return parts


@allocating_entry
def reached_by(points: Any, order: Any, starts: Any, spheres: Any) -> Any:
    """Mark (k, s) which of some spheres (s, 4) m hold a point of each cluster, as in `means_of`."""
    near = np.zeros((starts.size - 1, spheres.shape[0]), dtype=np.bool_)
    for k in range(starts.size - 1):
        for s in range(spheres.shape[0]):
            for j in range(starts[k], starts[k + 1]):
                x = points[order[j], 0] - spheres[s, 0]
                y = points[order[j], 1] - spheres[s, 1]
                z = points[order[j], 2] - spheres[s, 2]
                if x * x + y * y + z * z < spheres[s, 3] ** 2:
                    near[k, s] = True
                    break
    return near
