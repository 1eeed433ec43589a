"""Cutting a convex polygon by half-spaces (Sutherland and Hodgman), for kernels.

A polygon is the address of its corners, an array (n, 3) of float64 in m. `polygons` has the same
for arrays.
"""

from __future__ import annotations

from intuitive_physics.geometry.vectors import add_scaled, cross, dot, put_vector, sub, vector_at
from intuitive_physics.kernels import kernel


@kernel
def clip(polygon, corners, normal, limit, clipped, room):
    """Write the part of a convex polygon where normal · point ≤ limit.

    Parameters
    ----------
    polygon, corners : address of its corners and their number, at least one
    normal, limit : of the half-space, limit in m for a unit normal
    clipped, room : address to write to, and the most corners there is room for

    Returns
    -------
    The number of corners that are left.
    """
    left = 0
    previous = vector_at(polygon, corners - 1)
    before = dot(normal, previous) - limit
    for k in range(corners):
        point = vector_at(polygon, k)
        beyond = dot(normal, point) - limit
        if (before < 0.0) != (beyond < 0.0) and left < room:
            share = before / (before - beyond)
            put_vector(clipped, left, add_scaled(previous, sub(point, previous), share))
            left += 1
        if beyond < 0.0 and left < room:
            put_vector(clipped, left, point)
            left += 1
        previous, before = point, beyond
    return left


@kernel
def clip_by_edges(polygon, corners, spare, room, boundary, boundary_corners, normal):
    """Cut a convex polygon by the upright half-spaces through the edges of another one.

    Parameters
    ----------
    polygon, corners : address of its corners and their number; overwritten
    spare, room : address of a second array, and the most corners either has room for
    boundary, boundary_corners : the other polygon, counterclockwise about `normal`

    Returns
    -------
    The number of corners that are left, and the address where they are: `polygon` or `spare`.
    """
    for k in range(boundary_corners):
        if corners == 0:
            break
        corner = vector_at(boundary, k)
        following = vector_at(boundary, (k + 1) % boundary_corners)
        outward = cross(sub(following, corner), normal)
        corners = clip(polygon, corners, outward, dot(outward, corner), spare, room)
        polygon, spare = spare, polygon
    return corners, polygon
