"""Cutting a convex polygon by half-spaces (Sutherland and Hodgman)."""

from __future__ import annotations

from intuitive_physics.geometry.vectors import add_scaled, cross, dot, load, store, sub
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.stepped.world import CLIPPED, boundary_corner, clipped_corner


@kernel
def clip(world, side, corners, normal, limit):
    """Keep the part of a polygon where normal · point ≤ limit.

    Parameters
    ----------
    side : that of the clipped corners which holds the polygon; the other one is written
    corners : of the polygon

    Returns
    -------
    The number of corners that are left.
    """
    left = 0
    previous = load(clipped_corner(world, side, corners - 1).point)
    before = dot(normal, previous) - limit
    for k in range(corners):
        point = load(clipped_corner(world, side, k).point)
        beyond = dot(normal, point) - limit
        if (before < 0.0) != (beyond < 0.0) and left < CLIPPED:
            crossing = add_scaled(previous, sub(point, previous), before / (before - beyond))
            store(clipped_corner(world, 1 - side, left).point, crossing)
            left += 1
        if beyond < 0.0 and left < CLIPPED:
            store(clipped_corner(world, 1 - side, left).point, point)
            left += 1
        previous, before = point, beyond
    return left


@kernel
def clip_by_edges(world, corners, plane):
    """Cut the polygon on side 0 by the edges of a plane; return its corners and its side."""
    n = load(plane.normal)
    side = 0
    for k in range(plane.corners):
        if corners == 0:
            break
        corner = load(boundary_corner(plane, k).point)
        following = load(boundary_corner(plane, (k + 1) % plane.corners).point)
        outward = cross(sub(following, corner), n)
        corners = clip(world, side, corners, outward, dot(outward, corner))
        side = 1 - side
    return corners, side
