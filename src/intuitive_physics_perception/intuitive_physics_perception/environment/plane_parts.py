"""Which readings near one infinite plane are one surface, and which are several at one height.

A table before a floor leaves two parts of the floor in view that are one; two tables of one height
are two. Between the parts of one surface something hides it; between two one sees through.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.environment.range_cloud import RangeCloud, convex_hull, plane_axes

DEEP = 2.0
"""Scaled distance behind a plane that is neither noise nor unevenness."""

MIN_THROUGH = 10
THROUGH_FRACTION = 0.3


def surfaces(
    cloud: RangeCloud,
    plane: NDArray[np.float64],
    others: Sequence[NDArray[np.float64]],
    needed: int,
) -> list[NDArray[np.intp]]:
    """Return the indices of the points of each surface that lies in a plane, largest first.

    Parameters
    ----------
    plane : (4,) normal and offset in m
    others : the other planes
    needed : points that a part must have
    """
    axes = np.column_stack(plane_axes(plane[:3]))
    found: list[NDArray[np.intp]] = []
    for part in cloud.connected_parts(plane, others):
        if part.size < needed:
            continue
        for k, surface in enumerate(found):
            if not _seen_between(cloud, plane, axes, surface, part):
                found[k] = np.concatenate([surface, part])
                break
        else:
            found.append(part)
    return sorted(found, key=len, reverse=True)


def _seen_between(
    cloud: RangeCloud,
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    first: NDArray[np.intp],
    second: NDArray[np.intp],
) -> bool:
    """Whether rays go through the plane between two parts of it."""
    hulls = [
        convex_hull(cloud.points[part] @ axes)
        for part in (first, second, np.concatenate([first, second]))
    ]
    meeting = cloud.meeting(plane)
    feet = cloud.feet(plane, axes, meeting)
    in_first, in_second, in_both = (_inside(hull, feet) for hull in hulls)
    between = meeting[in_both & ~in_first & ~in_second]
    through = np.count_nonzero(cloud.scaled_distances(plane, between) < -DEEP)
    return int(through) >= max(MIN_THROUGH, THROUGH_FRACTION * between.size)


def _inside(hull: NDArray[np.float64] | None, places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which places (n, 2) lie in a convex polygon, counter-clockwise."""
    if hull is None:
        return np.zeros(len(places), dtype=bool)
    along = np.roll(hull, -1, axis=0) - hull
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    return np.asarray((places @ outward.T <= (outward * hull).sum(axis=1)).all(axis=1))
