"""Where two bodies touch; two boxes by the separating axis, then clipped faces or nearest edges.

See Gottschalk, Lin, Manocha: OBBTree (1996) for the fifteen axes.
"""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.clipping import clip
from intuitive_physics.geometry.closest_points import nearest_of_segments
from intuitive_physics.geometry.vectors import (
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    sub,
    vector_at,
)
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.manifolds import (
    meet_box,
    meet_rounded,
    write_contact,
    write_face,
)
from intuitive_physics.simulation.rigid_bodies.world import body_at, clipped_polygon, column
from intuitive_physics.simulation.world_batch import BOX

FACES_PREFERRED = 1e-3
"""m per m of size. An edge axis has to separate by so much more than a face to be taken."""


@kernel
def meet(world, i, j, margin, count):
    """Contacts of bodies i and j; see `manifolds`."""
    first_box, second_box = body_at(world, i).kind == BOX, body_at(world, j).kind == BOX
    if first_box and second_box:
        return meet_boxes(world, i, j, margin, count)
    if first_box or second_box:
        return meet_box(world, i, j, i if first_box else j, margin, count)
    return meet_rounded(world, i, j, margin, count)


@kernel
def _span_along(box, axis):
    """Half the length (m) of a box's shadow on an axis."""
    h = box.half_extents
    return (
        h[0] * abs(dot(axis, column(box.rotation, 0)))
        + h[1] * abs(dot(axis, column(box.rotation, 1)))
        + h[2] * abs(dot(axis, column(box.rotation, 2)))
    )


@kernel
def meet_boxes(world, i, j, margin, count):
    """Contacts of two boxes; the gap is that of the nearest one, or of the separating axis."""
    one, other = body_at(world, i), body_at(world, j)
    apart = sub(load(one.position), load(other.position))
    gap, best, normal = -inf, -1, (0.0, 0.0, 1.0)
    for candidate in range(6):
        body = one if candidate < 3 else other
        axis = column(body.rotation, candidate % 3)
        distance = dot(apart, axis)
        opening = abs(distance) - _span_along(one, axis) - _span_along(other, axis)
        if opening > gap + 1e-9:
            gap, best = opening, candidate
            normal = scaled(axis, 1.0 if distance >= 0.0 else -1.0)
    if gap > margin:
        return count, gap
    edge_gap, edges, edge_normal = _separating_edges(one, other, apart)
    if edge_gap > gap + FACES_PREFERRED * (one.thinness + other.thinness):
        if edge_gap < margin:
            count = _meet_edges(world, i, j, edges, edge_normal, edge_gap, count)
        return count, edge_gap
    count, nearest = _meet_faces(world, i, j, best, normal, margin, count)
    # Faces that pass each other by have no corner in common, but do not overlap either.
    return count, nearest if nearest < inf else max(gap, edge_gap)


@kernel
def _separating_edges(one, other, apart):
    gap, edges, normal = -inf, 0, (0.0, 0.0, 1.0)
    for a in range(3):
        for b in range(3):
            axis = cross(column(one.rotation, a), column(other.rotation, b))
            length = norm(axis)
            if length > 1e-4:
                axis = scaled(axis, 1.0 / length)
                distance = dot(apart, axis)
                opening = abs(distance) - _span_along(one, axis) - _span_along(other, axis)
                if opening > gap:
                    gap, edges = opening, 3 * a + b
                    normal = scaled(axis, 1.0 if distance >= 0.0 else -1.0)
    return gap, edges, normal


@kernel
def _edge_towards(box, axis, direction):
    """Start and span of the edge along an axis that lies farthest in a direction."""
    start = load(box.position)
    for k in range(3):
        along = column(box.rotation, k)
        if k == axis:
            start = add_scaled(start, along, -box.half_extents[k])
        else:
            sign = 1.0 if dot(along, direction) > 0.0 else -1.0
            start = add_scaled(start, along, sign * box.half_extents[k])
    return start, scaled(column(box.rotation, axis), 2.0 * box.half_extents[axis])


@kernel
def _meet_edges(world, i, j, edges, normal, gap, count):
    one, other = body_at(world, i), body_at(world, j)
    start, span = _edge_towards(one, edges // 3, scaled(normal, -1.0))
    other_start, other_span = _edge_towards(other, edges % 3, normal)
    s, t = nearest_of_segments(start, span, other_start, other_span)
    here, there = add_scaled(start, span, s), add_scaled(other_start, other_span, t)
    middle = add_scaled(here, sub(there, here), 0.5)
    return write_contact(world, count, i, j, gap, normal, middle)


@kernel
def _meet_faces(world, i, j, best, normal, margin, count):
    """Clip the face that meets the reference face by its sides; also return the smallest gap."""
    owner, guest = (i, j) if best < 3 else (j, i)
    axis = best % 3
    box, visitor = body_at(world, owner), body_at(world, guest)
    outward = scaled(normal, -1.0) if owner == i else normal
    facing, steepest = 0, 0.0
    for k in range(3):
        slope = dot(outward, column(visitor.rotation, k))
        if abs(slope) > abs(steepest):
            facing, steepest = k, slope
    write_face(world, visitor, facing, 1.0 if steepest < 0.0 else -1.0)
    clipped, spare = clipped_polygon(world, 0), clipped_polygon(world, 1)
    corners = 4
    for turn in range(1, 3):
        k = (axis + turn) % 3
        along = column(box.rotation, k)
        middle = dot(along, load(box.position))
        for sign in range(2):
            if corners > 0:
                out = along if sign else scaled(along, -1.0)
                limit = (middle if sign else -middle) + box.half_extents[k]
                corners = clip(clipped, corners, out, limit, spare, world.clipped_room)
                clipped, spare = spare, clipped
    top = dot(outward, load(box.position)) + box.half_extents[axis]
    nearest = inf
    for k in range(corners):
        point = vector_at(clipped, k)
        gap = dot(outward, point) - top
        nearest = min(nearest, gap)
        if gap < margin:
            middle_point = add_scaled(point, outward, -0.5 * gap)
            count = write_contact(world, count, i, j, gap, normal, middle_point)
    return count, nearest
