"""How far two bodies are apart, and along which direction.

The separation along a unit vector n is the least n · (p - q) of points p of the first and q of the
second; bodies that are convex do not overlap where it is above zero along any n. What is returned
is the largest separation there is, along closest points, or for two boxes along one of fifteen
axes (Gottschalk, Lin, Manocha: OBBTree, 1996), which then is at most the distance.
"""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.closest_points import (
    nearest_of_segments,
    point_from_box,
    segment_nearest_to_box,
)
from intuitive_physics.geometry.vectors import add_scaled, cross, dot, load, norm, scaled, sub
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.poses import into_frame, segment_end
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    column,
    times,
    transposed_times,
)
from intuitive_physics.simulation.world_batch import BOX, CAPSULE

UP = (0.0, 0.0, 1.0)
"""A direction for what has none: two centres at the same place."""

SAME_AXIS = 1e-9
"""m. An axis has to separate by so much more than one before it to be taken instead."""

PARALLEL_EDGES = 1e-4
"""Sine of the angle between two edges below which their product is no axis."""


@kernel
def separation(world, i, j):
    """Largest separation (m) of bodies i and j, and its unit vector, towards i."""
    one, other = body_at(world, i), body_at(world, j)
    if one.kind == BOX and other.kind == BOX:
        apart = sub(load(one.position), load(other.position))
        gap, _, normal = separating_face(one, other, apart)
        edge_gap, _, edge_normal = separating_edges(one, other, apart)
        return (edge_gap, edge_normal) if edge_gap > gap else (gap, normal)
    if one.kind == BOX:
        gap, normal = _from_box(other, one)
        return gap, scaled(normal, -1.0)
    if other.kind == BOX:
        return _from_box(one, other)
    return _of_rounded(one, other)


@kernel
def _of_rounded(one, other):
    start, other_start = segment_end(one, -1.0), segment_end(other, -1.0)
    span = sub(segment_end(one, 1.0), start)
    other_span = sub(segment_end(other, 1.0), other_start)
    s, t = nearest_of_segments(start, span, other_start, other_span)
    apart = sub(add_scaled(start, span, s), add_scaled(other_start, other_span, t))
    distance = norm(apart)
    normal = scaled(apart, 1.0 / distance) if distance > 0.0 else UP
    return distance - one.radius - other.radius, normal


@kernel
def _from_box(rounded, box):
    half, start = load(box.half_extents), segment_end(rounded, -1.0)
    local = into_frame(box, start)
    if rounded.kind == CAPSULE:
        span = transposed_times(box.rotation, sub(segment_end(rounded, 1.0), start))
        local = add_scaled(local, span, segment_nearest_to_box(local, span, half))
    distance, away = point_from_box(local, half)
    return distance - rounded.radius, times(box.rotation, away)


@kernel
def span_along(box, axis):
    """Half the length (m) of a box's shadow on an axis."""
    h = box.half_extents
    return (
        h[0] * abs(dot(axis, column(box.rotation, 0)))
        + h[1] * abs(dot(axis, column(box.rotation, 1)))
        + h[2] * abs(dot(axis, column(box.rotation, 2)))
    )


@kernel
def separating_face(one, other, apart):
    """Largest separation (m) of two boxes along a face normal, of which face, and that normal.

    `apart` leads from the centre of the other to that of the first. Faces 0 to 2 are the first's.
    """
    gap, best, normal = -inf, -1, UP
    for candidate in range(6):
        body = one if candidate < 3 else other
        axis = column(body.rotation, candidate % 3)
        distance = dot(apart, axis)
        opening = abs(distance) - span_along(one, axis) - span_along(other, axis)
        if opening > gap + SAME_AXIS:
            gap, best = opening, candidate
            normal = scaled(axis, 1.0 if distance >= 0.0 else -1.0)
    return gap, best, normal


@kernel
def separating_edges(one, other, apart):
    """The same along products of edges a and b, which are returned as 3 a + b."""
    gap, edges, normal = -inf, 0, UP
    for a in range(3):
        for b in range(3):
            axis = cross(column(one.rotation, a), column(other.rotation, b))
            length = norm(axis)
            if length > PARALLEL_EDGES:
                axis = scaled(axis, 1.0 / length)
                distance = dot(apart, axis)
                opening = abs(distance) - span_along(one, axis) - span_along(other, axis)
                if opening > gap:
                    gap, edges = opening, 3 * a + b
                    normal = scaled(axis, 1.0 if distance >= 0.0 else -1.0)
    return gap, edges, normal
