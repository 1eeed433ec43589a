"""Points where bodies touch, as they are written, and the faces and edges of boxes they lie on."""

from __future__ import annotations

from intuitive_physics.geometry.clipping import clip
from intuitive_physics.geometry.vectors import (
    add,
    add_scaled,
    dot,
    load,
    put_vector,
    scaled,
    store,
    sub,
)
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.poses import centre_of_mass
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    clipped_polygon,
    column,
    contact_at,
)
from intuitive_physics.simulation.rollout import TOO_MANY_CONTACTS


@kernel
def write_contact(world, count, first, second, gap, normal, point):
    """Write one contact at a point (m) behind the first `count`; return how many there are then."""
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
def write_facing(world, box, direction):
    """Write the face of a box that faces against a direction to the first clipped polygon."""
    facing, steepest = 0, 0.0
    for k in range(3):
        slope = dot(direction, column(box.rotation, k))
        if abs(slope) > abs(steepest):
            facing, steepest = k, slope
    _write_face(world, box, facing, 1.0 if steepest < 0.0 else -1.0)


@kernel
def clip_by_sides(world, box, axis, corners):
    """Cut the first clipped polygon by the four sides of a box along its other two axes.

    Returns the number of corners that are left, and the address of the polygon they make.
    """
    polygon, spare = clipped_polygon(world, 0), clipped_polygon(world, 1)
    for turn in range(1, 3):
        k = (axis + turn) % 3
        along = column(box.rotation, k)
        middle = dot(along, load(box.position))
        for sign in range(2):
            if corners > 0:
                out = along if sign else scaled(along, -1.0)
                limit = (middle if sign else -middle) + box.half_extents[k]
                corners = clip(polygon, corners, out, limit, spare, world.clipped_room)
                polygon, spare = spare, polygon
    return corners, polygon


@kernel
def _write_face(world, body, axis, sign):
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
def edge_towards(box, axis, direction):
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
def lowest_corner(box, direction):
    """Corner (m) of a box that lies farthest against a direction."""
    corner = load(box.position)
    for k in range(3):
        along = column(box.rotation, k)
        sign = -1.0 if dot(along, direction) > 0.0 else 1.0
        corner = add_scaled(corner, along, sign * box.half_extents[k])
    return corner
