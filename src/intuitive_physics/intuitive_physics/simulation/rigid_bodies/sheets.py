"""Where a body touches a bounded plane: a convex polygon that holds what is in front of it.

The polygon has no thickness. What has its centre behind it passes, until it is free of it again.
Otherwise it is a convex solid like any other: its edges push along the normal of the contact.
"""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.clipping import clip_by_edges
from intuitive_physics.geometry.closest_points import (
    nearest_of_segments,
    nearest_on_polygon,
    part_over_polygon,
)
from intuitive_physics.geometry.vectors import (
    add,
    add_scaled,
    cross,
    dot,
    load,
    norm,
    put_vector,
    scaled,
    sub,
    vector_at,
)
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.contact_points import (
    clip_by_sides,
    edge_towards,
    lowest_corner,
    write_contact,
    write_facing,
)
from intuitive_physics.simulation.rigid_bodies.distance import PARALLEL_EDGES, span_along
from intuitive_physics.simulation.rigid_bodies.manifolds import SAME_PLACE
from intuitive_physics.simulation.rigid_bodies.poses import segment_end, support
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    clipped_polygon,
    column,
    plane_at,
)
from intuitive_physics.simulation.world_batch import BOX, SPHERE

FACE_PREFERRED = 1e-3
"""m per m of size. Another axis has to separate by so much more than the plane's to be taken."""

ALONG = 1.0 - 1e-12
"""Cosine of what is along the plane's normal, but for rounding."""

CLEAR = 1e-9
"""m. Distance of what is moved back behind a plane: more than rounding."""

PLANE_AXIS, FIRST_EDGE = -1, 3
"""Codes of axes: the plane's normal, 0 to 2 those of the box, then 3 for each edge of the plane."""


@kernel
def separation_from_sheet(world, i, p):
    """Largest separation (m) of body i from a bounded plane, and its unit vector, to the body.

    It is infinite for what passes from behind.
    """
    body, plane = body_at(world, i), plane_at(world, p)
    if passes(body, plane, p):
        return inf, load(plane.normal)
    return _separation_in_front(body, plane)


@kernel
def _separation_in_front(body, plane):
    if body.kind == BOX:
        gap, normal, _ = _separating_axis(body, plane, 0.0)
        return gap, normal
    return _separation_of_core(body, plane)


@kernel
def way_from_behind(body, plane):
    """How far (m) to move a body along the normal of a plane through which it reaches from behind.

    Its centre is behind the bounded plane: it is moved to the front if it is less than half of
    its reach deep, else further back. 0 for a body that does not reach through.
    """
    n = load(plane.normal)
    height = dot(n, load(body.position)) - plane.offset
    reach = support(body, n)
    if height > 0.0 or height <= -reach:
        return 0.0
    gap, _ = _separation_in_front(body, plane)
    if gap >= 0.0:
        return 0.0
    return reach - height if height > -0.5 * reach else -reach - height - CLEAR


@fast_inlined
def passes(body, plane, p):
    """Whether a body is behind a bounded plane, or not yet free of it again."""
    height = dot(load(plane.normal), load(body.position)) - plane.offset
    return height <= 0.0 or body.behind & (1 << p) != 0


@kernel
def meet_sheet(world, i, p, margin, count):
    """Contacts of body i with a bounded plane; see `manifolds`."""
    body, plane = body_at(world, i), plane_at(world, p)
    if passes(body, plane, p):
        return count
    if body.kind != BOX:
        return _meet_core(world, i, p, margin, count)
    gap, normal, axis = _separating_axis(body, plane, FACE_PREFERRED * body.thinness)
    if gap > margin:
        return count
    before = count
    if axis == PLANE_AXIS:
        count = _box_on_plane(world, i, p, gap, margin, count)
    elif axis < FIRST_EDGE:
        count = _plane_on_face(world, i, p, axis, normal, margin, count)
    else:
        return _meet_edges(world, i, p, axis, gap, normal, count)
    if count == before:
        # Its lowest face passes the plane by, and only its side reaches over the edge.
        lowest = lowest_corner(body, normal)
        point = nearest_on_polygon(
            lowest, plane.boundary, plane.corners, load(plane.normal), plane.offset
        )
        count = write_contact(world, count, i, -1 - p, gap, normal, point)
    return count


@kernel
def _meet_edges(world, i, p, axis, gap, normal, count):
    body, plane = body_at(world, i), plane_at(world, p)
    start, span = edge_towards(body, axis % 3, scaled(normal, -1.0))
    corner, edge = _edge(plane, axis // 3 - 1)
    s, t = nearest_of_segments(start, span, corner, edge)
    point = add_scaled(corner, edge, t)
    middle = add_scaled(point, sub(add_scaled(start, span, s), point), 0.5)
    return write_contact(world, count, i, -1 - p, gap, normal, middle)


@fast_inlined
def _edge(plane, k):
    """Start and span of edge k of a bounded plane."""
    start = vector_at(plane.boundary, k)
    following = k + 1 if k + 1 < plane.corners else 0
    return start, sub(vector_at(plane.boundary, following), start)


@kernel
def _separating_axis(body, plane, preference):
    """Largest separation (m) of a box; the unit vector towards it and code of an axis.

    That axis is the plane's normal unless another one separates by so much more (m).
    """
    n = load(plane.normal)
    least = dot(n, load(body.position)) - plane.offset - span_along(body, n)
    gap, taken, axis, normal = least, least, PLANE_AXIS, n
    for k in range(3):
        opening, towards = _opening(body, plane, column(body.rotation, k))
        gap = max(gap, opening)
        if opening > max(taken, least + preference):
            taken, axis, normal = opening, k, towards
    if taken > 0.0 and axis != PLANE_AXIS:
        return gap, normal, axis
    for e in range(plane.corners):
        _, span = _edge(plane, e)
        length = norm(span)
        for k in range(3):
            product = cross(column(body.rotation, k), span)
            size = norm(product)
            if size > PARALLEL_EDGES * length:
                opening, towards = _opening(body, plane, scaled(product, 1.0 / size))
                gap = max(gap, opening)
                if opening > max(taken, least + preference):
                    taken, normal = opening, towards
                    axis = FIRST_EDGE * (e + 1) + k
    return gap, normal, axis


@kernel
def _opening(body, plane, axis):
    """Separation (m) of a box from a bounded plane along an axis, and the sense towards the box."""
    low, high = inf, -inf
    centre = load(body.position)
    for k in range(plane.corners):
        at = dot(axis, sub(vector_at(plane.boundary, k), centre))
        low, high = min(low, at), max(high, at)
    if low > -high:
        return low - span_along(body, axis), scaled(axis, -1.0)
    return -high - span_along(body, axis), axis


@kernel
def _box_on_plane(world, i, p, least, margin, count):
    """The box's lowest face, cut by the plane's edges, pushed along the plane's normal.

    Another axis may separate the two by more than the plane's, by `least` (m): no corner is nearer.
    """
    body, plane = body_at(world, i), plane_at(world, p)
    n = load(plane.normal)
    write_facing(world, body, n)
    polygon, spare = clipped_polygon(world, 0), clipped_polygon(world, 1)
    corners, polygon = clip_by_edges(
        polygon, 4, spare, world.clipped_room, plane.boundary, plane.corners, n
    )
    nearest = inf
    for k in range(corners):
        nearest = min(nearest, dot(n, vector_at(polygon, k)) - plane.offset)
    more = max(least - nearest, 0.0)
    for k in range(corners):
        point = vector_at(polygon, k)
        gap = dot(n, point) - plane.offset + more
        if gap < margin:
            count = write_contact(world, count, i, -1 - p, gap, n, point)
    return count


@kernel
def _plane_on_face(world, i, p, axis, normal, margin, count):
    """The part of the plane that lies over a face of the box, pushed along that face's normal."""
    body, plane = body_at(world, i), plane_at(world, p)
    for k in range(plane.corners):
        put_vector(clipped_polygon(world, 0), k, vector_at(plane.boundary, k))
    corners, polygon = clip_by_sides(world, body, axis, plane.corners)
    outward = scaled(normal, -1.0)
    top = dot(outward, load(body.position)) + body.half_extents[axis]
    for k in range(corners):
        point = vector_at(polygon, k)
        gap = dot(outward, point) - top
        if gap < margin:
            count = write_contact(world, count, i, -1 - p, gap, normal, point)
    return count


@kernel
def _meet_core(world, i, p, margin, count):
    """A sphere or capsule: both ends of its axis's part over the plane, and where it is beside."""
    body, plane = body_at(world, i), plane_at(world, p)
    n = load(plane.normal)
    start = segment_end(body, -1.0)
    span = sub(segment_end(body, 1.0), start)
    low, high = part_over_polygon(start, span, plane.boundary, plane.corners, n)
    if low > high:
        low, high = 0.0, 1.0
    least = inf
    for end in range(1 if body.kind == SPHERE else 2):
        centre = add_scaled(start, span, high if end else low)
        near, gap, normal = _nearest_of_point(plane, centre, body.radius)
        least = min(least, gap)
        if gap < margin:
            count = write_contact(world, count, i, -1 - p, gap, normal, near)
    if body.kind != SPHERE:
        near, gap, normal, place = _nearest_of_edges(plane, start, span, body.radius)
        if gap < min(least, margin) and min(abs(place - low), abs(place - high)) > SAME_PLACE:
            count = write_contact(world, count, i, -1 - p, gap, normal, near)
    return count


@kernel
def _separation_of_core(body, plane):
    """Gap (m) between a sphere or capsule and a bounded plane, and the unit vector to the body."""
    start = segment_end(body, -1.0)
    span = sub(segment_end(body, 1.0), start)
    _, gap, normal = _nearest_of_point(plane, start, body.radius)
    if body.kind != SPHERE:
        _, other_gap, other_normal = _nearest_of_point(plane, add(start, span), body.radius)
        if other_gap < gap:
            gap, normal = other_gap, other_normal
        if gap > -body.radius:
            _, edge_gap, edge_normal, _ = _nearest_of_edges(plane, start, span, body.radius)
            if edge_gap < gap:
                gap, normal = edge_gap, edge_normal
    return gap, normal


@kernel
def _nearest_of_point(plane, centre, radius):
    """The plane's point nearest to a ball, their gap (m), and the unit vector to the ball.

    A centre that is behind the plane within its edges is as deep as it is behind.
    """
    n = load(plane.normal)
    near = nearest_on_polygon(centre, plane.boundary, plane.corners, n, plane.offset)
    away = sub(centre, near)
    distance, height = norm(away), dot(away, n)
    if distance == 0.0 or (height < 0.0 and -height >= distance * ALONG):
        return near, height - radius, n
    return near, distance - radius, scaled(away, 1.0 / distance)


@kernel
def _nearest_of_edges(plane, start, span, radius):
    """The same for the segment of a capsule and the plane's edges, and the place on the segment."""
    n = load(plane.normal)
    nearest, least, towards, place = start, inf, n, 0.0
    for k in range(plane.corners):
        corner, edge = _edge(plane, k)
        s, t = nearest_of_segments(start, span, corner, edge)
        near = add_scaled(corner, edge, t)
        away = sub(add_scaled(start, span, s), near)
        distance = norm(away)
        if 0.0 < distance < least:
            nearest, least, towards, place = near, distance, scaled(away, 1.0 / distance), s
    return nearest, least - radius, towards, place
