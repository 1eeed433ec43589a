"""Cutting a convex polygon by half-spaces (Sutherland and Hodgman)."""

from __future__ import annotations

from intuitive_physics.simulation.kernels import kernel
from intuitive_physics.simulation.stepped.world import CLIPPED
from intuitive_physics.simulation.vectors import add_scaled, cross, dot, load, store, sub


@kernel
def clip(clips, side, corners, normal, limit):
    """Keep the part of a polygon where normal · point ≤ limit.

    Parameters
    ----------
    clips : (2, CLIPPED, 3) m; `clips[side]` holds the polygon of so many corners, the other side
        is written

    Returns
    -------
    The number of corners that are left.
    """
    left = 0
    previous = load(clips[side, corners - 1])
    before = dot(normal, previous) - limit
    for k in range(corners):
        point = load(clips[side, k])
        beyond = dot(normal, point) - limit
        if (before < 0.0) != (beyond < 0.0) and left < CLIPPED:
            crossing = add_scaled(previous, sub(point, previous), before / (before - beyond))
            store(clips[1 - side, left], crossing)
            left += 1
        if beyond < 0.0 and left < CLIPPED:
            store(clips[1 - side, left], point)
            left += 1
        previous, before = point, beyond
    return left


@kernel
def clip_by_edges(clips, corners, plane, boundary):
    """Cut the polygon in `clips[0]` by the edges of a plane; return its corners and its side."""
    n = load(plane.normal)
    side = 0
    for k in range(plane.corners):
        if corners == 0:
            break
        corner = load(boundary[plane.first_corner + k])
        following = load(boundary[plane.first_corner + (k + 1) % plane.corners])
        outward = cross(sub(following, corner), n)
        corners = clip(clips, side, corners, outward, dot(outward, corner))
        side = 1 - side
    return corners, side
