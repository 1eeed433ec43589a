"""Where a body touches, or nearly touches, a plane; see `manifolds`."""

from __future__ import annotations

from intuitive_physics.geometry.vectors import add, add_scaled, dot, load, scaled
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.contact_points import write_contact
from intuitive_physics.simulation.rigid_bodies.poses import segment_end, support
from intuitive_physics.simulation.rigid_bodies.sheets import meet_sheet, separation_from_sheet
from intuitive_physics.simulation.rigid_bodies.world import body_at, column, plane_at
from intuitive_physics.simulation.world_batch import BOX, SPHERE


@kernel
def separation_from_plane(world, i, p):
    """Largest separation (m) of body i from plane p, and its unit vector, towards the body.

    It is infinite for what passes a bounded plane from behind.
    """
    body, plane = body_at(world, i), plane_at(world, p)
    if plane.corners > 0:
        return separation_from_sheet(world, i, p)
    n = load(plane.normal)
    return dot(n, load(body.position)) - plane.offset - support(body, n), n


@kernel
def meet_plane(world, i, p, margin, count):
    """Contacts of body i with plane p."""
    body, plane = body_at(world, i), plane_at(world, p)
    n = load(plane.normal)
    height = dot(n, load(body.position)) - plane.offset
    if height > body.reach + margin:
        return count
    if plane.corners > 0:
        return meet_sheet(world, i, p, margin, count)
    if body.kind == BOX:
        return _box_on_plane(world, i, p, height, margin, count)
    if body.kind == SPHERE:
        gap = height - body.radius
        if gap < margin:
            point = add_scaled(load(body.position), n, -body.radius)
            count = write_contact(world, count, i, -1 - p, gap, n, point)
        return count
    for end in range(2):
        centre = segment_end(body, 2.0 * end - 1.0)
        gap = dot(n, centre) - plane.offset - body.radius
        if gap < margin:
            point = add_scaled(centre, n, -body.radius)
            count = write_contact(world, count, i, -1 - p, gap, n, point)
    return count


@kernel
def _box_on_plane(world, i, p, height, margin, count):
    body, plane = body_at(world, i), plane_at(world, p)
    n = load(plane.normal)
    x, y, z = column(body.rotation, 0), column(body.rotation, 1), column(body.rotation, 2)
    hx, hy, hz = load(body.half_extents)
    a, b, c = hx * dot(n, x), hy * dot(n, y), hz * dot(n, z)
    if height - abs(a) - abs(b) - abs(c) >= margin:
        return count
    for corner in range(8):
        u = 1.0 if corner & 1 else -1.0
        v = 1.0 if corner & 2 else -1.0
        w = 1.0 if corner & 4 else -1.0
        gap = height + u * a + v * b + w * c
        if gap < margin:
            arm = add_scaled(add_scaled(scaled(x, u * hx), y, v * hy), z, w * hz)
            point = add(load(body.position), arm)
            count = write_contact(world, count, i, -1 - p, gap, n, point)
    return count
