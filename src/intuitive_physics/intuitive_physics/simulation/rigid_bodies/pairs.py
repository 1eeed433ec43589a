"""Where two bodies touch; two boxes by the separating axis, then clipped faces or nearest edges."""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.closest_points import nearest_of_segments
from intuitive_physics.geometry.vectors import (
    add_scaled,
    dot,
    load,
    scaled,
    sub,
    vector_at,
)
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.contact_points import (
    clip_by_sides,
    edge_towards,
    write_contact,
    write_facing,
)
from intuitive_physics.simulation.rigid_bodies.distance import separating_edges, separating_face
from intuitive_physics.simulation.rigid_bodies.manifolds import meet_box, meet_rounded
from intuitive_physics.simulation.rigid_bodies.world import body_at
from intuitive_physics.simulation.world_batch import BOX

SAME_GAP = 1e-6
"""m. Gaps of faces and of edges that differ by less are one."""

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
def meet_boxes(world, i, j, margin, count):
    """Contacts of two boxes."""
    one, other = body_at(world, i), body_at(world, j)
    apart = sub(load(one.position), load(other.position))
    gap, best, normal = separating_face(one, other, apart)
    if gap > margin:
        return count
    edge_gap, edges, edge_normal = separating_edges(one, other, apart)
    if edge_gap > gap + FACES_PREFERRED * (one.thinness + other.thinness):
        if edge_gap < margin:
            count = _meet_edges(world, i, j, edges, edge_normal, edge_gap, count)
        return count
    least = max(gap, edge_gap)
    count, nearest = _meet_faces(world, i, j, best, normal, least, margin, count)
    if nearest > least + SAME_GAP and least < margin:
        # The corner that is nearest is beside the other box: then two edges meet.
        towards = edge_normal if edge_gap >= gap else normal
        count = _meet_edges(world, i, j, edges, towards, least, count)
    return count


@kernel
def _meet_edges(world, i, j, edges, normal, gap, count):
    one, other = body_at(world, i), body_at(world, j)
    start, span = edge_towards(one, edges // 3, scaled(normal, -1.0))
    other_start, other_span = edge_towards(other, edges % 3, normal)
    s, t = nearest_of_segments(start, span, other_start, other_span)
    here, there = add_scaled(start, span, s), add_scaled(other_start, other_span, t)
    middle = add_scaled(here, sub(there, here), 0.5)
    return write_contact(world, count, i, j, gap, normal, middle)


@kernel
def _meet_faces(world, i, j, best, normal, least, margin, count):
    """Clip the face that meets the reference face by its sides; also return the smallest gap.

    An edge axis may separate the boxes by more than their faces, by `least` (m): none is nearer.
    """
    owner, guest = (i, j) if best < 3 else (j, i)
    axis = best % 3
    box, visitor = body_at(world, owner), body_at(world, guest)
    outward = scaled(normal, -1.0) if owner == i else normal
    write_facing(world, visitor, outward)
    corners, clipped = clip_by_sides(world, box, axis, 4)
    top = dot(outward, load(box.position)) + box.half_extents[axis]
    nearest = inf
    for k in range(corners):
        nearest = min(nearest, dot(outward, vector_at(clipped, k)) - top)
    more = max(least - nearest, 0.0)
    for k in range(corners):
        point = vector_at(clipped, k)
        gap = dot(outward, point) - top + more
        if gap < margin:
            middle_point = add_scaled(point, outward, -0.5 * gap)
            count = write_contact(world, count, i, j, gap, normal, middle_point)
    return count, nearest + more
