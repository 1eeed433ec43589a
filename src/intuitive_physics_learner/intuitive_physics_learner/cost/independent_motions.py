"""Observations taken apart into motions that have nothing to do with each other.

What an object touches moves it, and of all that it can touch only other objects move. So objects
that never come near each other move as if each were alone. A fit to each by itself has fewer
unknowns and does not end where another one cannot be explained; what tumbles can be fitted in
segments; and nothing is lost, for the likelihood of independent motions is the product of theirs.

Two objects that touch between two points have met on the way: the sum of the gaps between their
bounding spheres at both points is at most the way that they go relative to each other meanwhile. So
the smaller gap is at most half of that, by the speed that they had before or have after, whichever
is larger, and by gravity, where one of them alone is supported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import STANDARD_GRAVITY

HIDDEN_GAP = 0.05
"""Gap between bounding spheres that errors of position may hide, m: five standard deviations of the
1 cm of the worst sensors."""

LONGEST_GAP = 0.1
"""Time without a point beyond which an object may have been anywhere, s: three frames at 30 Hz."""

GRAVITY = -STANDARD_GRAVITY[2]
"""Acceleration of objects relative to each other where one of them is supported, m/s²."""


def independent_motions(
    observations: Sequence[Observation],
) -> tuple[list[Observation], NDArray[np.int64]]:
    """Take observations apart into groups of objects that may have touched.

    Returns
    -------
    motions : the observations, one for each group of their objects
    origins : (n_motions,) index of the observation that each is a part of
    """
    motions: list[Observation] = []
    origins: list[int] = []
    for index, observation in enumerate(observations):
        parts = _parts(observation)
        motions += parts
        origins += [index] * len(parts)
    return motions, np.array(origins, dtype=np.int64)


def _parts(observation: Observation) -> list[Observation]:
    objects = observation.objects
    met = [[_may_have_met(a, b) for b in objects] for a in objects]
    count, labels = connected_components(np.array(met), directed=False)
    if count == 1:
        return [observation]
    return [
        replace(
            observation,
            objects=tuple(objects[k] for k in np.flatnonzero(labels == group)),
            id=f"{observation.id}_{group}",
        )
        for group in range(count)
    ]


def _may_have_met(a: ObservedObject, b: ObservedObject) -> bool:
    """Whether two objects may have touched while they were seen, or one of them was not."""
    tracks = a.trajectory, b.trajectory
    times = np.union1d(*(track.times for track in tracks))
    ends = np.array([[track.times[0], track.times[-1]] for track in tracks])
    if (np.ptp(ends, axis=0) > LONGEST_GAP).any():
        return True
    if any((np.diff(track.times) > LONGEST_GAP).any() for track in tracks):
        return True
    places = [
        np.column_stack([np.interp(times, track.times, axis) for axis in track.positions.T])
        for track in tracks
    ]
    apart = places[0] - places[1]
    radii = a.object.shape.bounding_radius + b.object.shape.bounding_radius
    gaps = np.linalg.norm(apart, axis=1) - radii
    return bool((np.minimum(gaps[:-1], gaps[1:]) < 0.5 * _ways(apart, times) + HIDDEN_GAP).any())


def _ways(apart: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Longest ways (n - 1,) in m from each of n places `apart` (n, 3) in m to the next one.

    `times` (n,) s.
    """
    durations = np.diff(times)
    speeds = np.linalg.norm(np.diff(apart, axis=0), axis=1) / durations
    beside = np.pad(speeds, 1)
    fastest = np.maximum(speeds, np.maximum(beside[:-2], beside[2:]))
    return (fastest + GRAVITY * durations) * durations
