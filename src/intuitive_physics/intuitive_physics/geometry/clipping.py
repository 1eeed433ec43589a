"""Cutting a convex polygon by half-spaces (Sutherland and Hodgman), for kernels.

A polygon is the address of its corners, an array (n, 3) of float64 in m. `polygons` has the same
for arrays.
"""

from __future__ import annotations

from intuitive_physics.geometry.vectors import add_scaled, cross, dot, put_vector, sub, vector_at
from intuitive_physics.kernels import kernel


@kernel
def clip(polygon, corners, normal, limit, clipped, room):
    """Write the part of a convex polygon where normal · point ≤ limit (m for a unit normal).

    The polygon has at least one corner. At most `room` corners are written to the address
    `clipped`; their number is returned.
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

    The other one, `boundary`, is counterclockwise about `normal`. `polygon` and `spare`, a second
    array, are overwritten; each has room for `room` corners. Returns the number of corners that
    are left, and where they are: `polygon` or `spare`.
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
