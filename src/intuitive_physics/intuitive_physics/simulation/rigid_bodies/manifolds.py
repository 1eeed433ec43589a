"""Where a body touches, or nearly touches, a plane or another body.

Each function writes the contacts whose gap is below `margin` behind the first `count` of
the world's contacts, or none where `count` is GAP_ONLY. It returns the new count and the smallest
gap there is (m), which is infinite where the two cannot meet. Normals point towards the first body.
"""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.clipping import clip_by_edges
from intuitive_physics.geometry.closest_points import (
    nearest_of_segments,
    nearest_on_polygon,
    nearest_on_segment,
    part_over_polygon,
    point_from_box,
    segment_nearest_to_box,
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
    store,
    sub,
    vector_at,
)
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.poses import centre_of_mass, into_frame, segment_end
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    clipped_polygon,
    column,
    contact_at,
    plane_at,
    times,
    transposed_times,
)
from intuitive_physics.simulation.rollout import TOO_MANY_CONTACTS
from intuitive_physics.simulation.world_batch import BOX, CAPSULE, SPHERE

GAP_ONLY = -1
"""In place of a number of contacts: writes none."""

PARALLEL = 0.05
"""Sine of the angle between capsules below which they touch at two points."""

UP = (0.0, 0.0, 1.0)
"""A direction for what has none: two centres at the same place."""


@kernel
def write_contact(world, count, first, second, gap, normal, point):
    """Write one contact at a point (m) if `count` is not GAP_ONLY; return the new count."""
    if count == GAP_ONLY:
        return count
    if count == world.contact_room:
        world.status = TOO_MANY_CONTACTS
        return count
    contact = contact_at(world, count)
    contact.first, contact.second, contact.gap = first, second, gap
    store(contact.axes[0], normal)
    store(contact.arm, sub(point, centre_of_mass(body_at(world, first))))
    if second >= 0:
        store(contact.other_arm, sub(point, centre_of_mass(body_at(world, second))))
    return count + 1


@kernel
def meet_plane(world, i, p, margin, count):
    """Contacts of body i with plane p; what is deeper than the body is thin has passed a sheet."""
    return meet_plane_within(world, i, p, margin, body_at(world, i).thinness, count)


@kernel
def meet_plane_within(world, i, p, margin, depth, count):
    """Like `meet_plane`, where a box has passed a bounded plane only below `depth` (m)."""
    body, plane = body_at(world, i), plane_at(world, p)
    n = load(plane.normal)
    height = dot(n, load(body.position)) - plane.offset
    if height > body.reach + margin:
        return count, height - body.reach
    if plane.corners > 0:
        if height <= 0.0 or body.behind & (1 << p):
            return count, inf
        if body.kind == BOX:
            return _box_on_sheet(world, i, p, margin, depth, count)
        return _rounded_on_sheet(world, i, p, margin, count)
    if body.kind == BOX:
        return _box_on_plane(world, i, p, height, margin, count)
    if body.kind == SPHERE:
        gap = height - body.radius
        if gap < margin:
            point = add_scaled(load(body.position), n, -body.radius)
            count = write_contact(world, count, i, -1 - p, gap, n, point)
        return count, gap
    least = inf
    for end in range(2):
        centre = segment_end(body, 2.0 * end - 1.0)
        gap = dot(n, centre) - plane.offset - body.radius
        least = min(least, gap)
        if gap < margin:
            point = add_scaled(centre, n, -body.radius)
            count = write_contact(world, count, i, -1 - p, gap, n, point)
    return count, least


@kernel
def _box_on_plane(world, i, p, height, margin, count):
    body, plane = body_at(world, i), plane_at(world, p)
    n = load(plane.normal)
    x, y, z = column(body.rotation, 0), column(body.rotation, 1), column(body.rotation, 2)
    hx, hy, hz = load(body.half_extents)
    a, b, c = hx * dot(n, x), hy * dot(n, y), hz * dot(n, z)
    least = height - abs(a) - abs(b) - abs(c)
    if least >= margin:
        return count, least
    for corner in range(8):
        u = 1.0 if corner & 1 else -1.0
        v = 1.0 if corner & 2 else -1.0
        w = 1.0 if corner & 4 else -1.0
        gap = height + u * a + v * b + w * c
        if gap < margin:
            arm = add_scaled(add_scaled(scaled(x, u * hx), y, v * hy), z, w * hz)
            point = add(load(body.position), arm)
            count = write_contact(world, count, i, -1 - p, gap, n, point)
    return count, least


@kernel
def _rounded_on_sheet(world, i, p, margin, count):
    """A sphere or capsule on a bounded plane: the ends of the part of its axis over the plane."""
    body, plane = body_at(world, i), plane_at(world, p)
    start = segment_end(body, -1.0)
    span = sub(segment_end(body, 1.0), start)
    n = load(plane.normal)
    low, high = part_over_polygon(start, span, plane.boundary, plane.corners, n)
    if low > high:
        low, high = 0.0, 1.0
    least = inf
    for end in range(1 if body.kind == SPHERE else 2):
        centre = add_scaled(start, span, high if end else low)
        near = nearest_on_polygon(centre, plane.boundary, plane.corners, n, plane.offset)
        away = sub(centre, near)
        distance = norm(away)
        gap = distance - body.radius
        least = min(least, gap)
        if gap < margin and dot(away, n) > 0.0:
            normal = scaled(away, 1.0 / distance)
            count = write_contact(world, count, i, -1 - p, gap, normal, near)
    return count, least


@kernel
def _box_on_sheet(world, i, p, margin, depth, count):
    """A box on a bounded plane: its lowest face, clipped by the plane's edges.

    The edge of the plane pushes along the plane's normal. What is deeper than `depth` (m) has
    passed the plane by.
    """
    body, plane = body_at(world, i), plane_at(world, p)
    n = load(plane.normal)
    lowest, steepest = 0, 0.0
    for k in range(3):
        slope = dot(n, column(body.rotation, k))
        if abs(slope) > abs(steepest):
            lowest, steepest = k, slope
    write_face(world, body, lowest, 1.0 if steepest < 0.0 else -1.0)
    clipped, spare = clipped_polygon(world, 0), clipped_polygon(world, 1)
    room = world.clipped_room
    corners, clipped = clip_by_edges(clipped, 4, spare, room, plane.boundary, plane.corners, n)
    least = inf
    for k in range(corners):
        point = vector_at(clipped, k)
        gap = dot(n, point) - plane.offset
        if gap > -depth:
            least = min(least, gap)
            if gap < margin:
                count = write_contact(world, count, i, -1 - p, gap, n, point)
    return count, least


@kernel
def write_face(world, body, axis, sign):
    """Write the four corners (m) of a box's face, in turn, to the first of the clipped polygons."""
    other, third = (axis + 1) % 3, (axis + 2) % 3
    out = scaled(column(body.rotation, axis), sign * body.half_extents[axis])
    centre = add(load(body.position), out)
    u = scaled(column(body.rotation, other), body.half_extents[other])
    v = scaled(column(body.rotation, third), body.half_extents[third])
    face = clipped_polygon(world, 0)
    put_vector(face, 0, add(add(centre, u), v))
    put_vector(face, 1, add(sub(centre, u), v))
    put_vector(face, 2, sub(sub(centre, u), v))
    put_vector(face, 3, sub(add(centre, u), v))


@kernel
def meet_rounded(world, i, j, margin, count):
    """Contacts of body i with body j, both spheres or capsules."""
    one, other = body_at(world, i), body_at(world, j)
    start, other_start = segment_end(one, -1.0), segment_end(other, -1.0)
    span = sub(segment_end(one, 1.0), start)
    other_span = sub(segment_end(other, 1.0), other_start)
    s, t = nearest_of_segments(start, span, other_start, other_span)
    length, other_length = norm(span), norm(other_span)
    if norm(cross(span, other_span)) < PARALLEL * length * other_length:
        return _meet_along(world, i, j, margin, count)
    here, there = add_scaled(start, span, s), add_scaled(other_start, other_span, t)
    return _meet_points(world, i, j, here, there, margin, count)


@kernel
def _meet_points(world, i, j, here, there, margin, count):
    one, other = body_at(world, i), body_at(world, j)
    apart = sub(here, there)
    distance = norm(apart)
    gap = distance - one.radius - other.radius
    if gap < margin:
        n = scaled(apart, 1.0 / distance) if distance > 0.0 else UP
        point = add_scaled(here, n, -one.radius - 0.5 * gap)
        count = write_contact(world, count, i, j, gap, n, point)
    return count, gap


@kernel
def _meet_along(world, i, j, margin, count):
    """Two capsules side by side touch where their common stretch begins and ends."""
    one, other = body_at(world, i), body_at(world, j)
    start, other_start = segment_end(one, -1.0), segment_end(other, -1.0)
    span = sub(segment_end(one, 1.0), start)
    other_span = sub(segment_end(other, 1.0), other_start)
    a = nearest_on_segment(other_start, start, span)
    b = nearest_on_segment(segment_end(other, 1.0), start, span)
    least = inf
    for end in range(1 if a == b else 2):
        here = add_scaled(start, span, b if end else a)
        t = nearest_on_segment(here, other_start, other_span)
        there = add_scaled(other_start, other_span, t)
        count, gap = _meet_points(world, i, j, here, there, margin, count)
        least = min(least, gap)
    return count, least


@kernel
def meet_box(world, i, j, box, margin, count):
    """Contacts of bodies i and j, of which `box` is a box and the other none."""
    rounded = body_at(world, j if box == i else i)
    solid = body_at(world, box)
    start = segment_end(rounded, -1.0)
    if rounded.kind != CAPSULE:
        return _meet_point(world, i, j, box, start, margin, count)
    span = sub(segment_end(rounded, 1.0), start)
    nearest = segment_nearest_to_box(
        into_frame(solid, start), transposed_times(solid.rotation, span), load(solid.half_extents)
    )
    least = inf
    for end in range(3):
        t = 0.5 * end
        if end == 1:
            if nearest < 0.02 or nearest > 0.98:
                continue
            t = nearest
        centre = add_scaled(start, span, t)
        count, gap = _meet_point(world, i, j, box, centre, margin, count)
        least = min(least, gap)
    return count, least


@kernel
def _meet_point(world, i, j, box, centre, margin, count):
    rounded = body_at(world, j if box == i else i)
    solid = body_at(world, box)
    distance, away = point_from_box(into_frame(solid, centre), load(solid.half_extents))
    n = times(solid.rotation, away)
    gap = distance - rounded.radius
    if gap < margin:
        point = add_scaled(centre, n, -rounded.radius - 0.5 * gap)
        towards = n if box == j else scaled(n, -1.0)
        count = write_contact(world, count, i, j, gap, towards, point)
    return count, gap
