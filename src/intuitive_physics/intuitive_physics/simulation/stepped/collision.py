"""All contacts of the bodies of one island."""

from __future__ import annotations

from intuitive_physics.geometry.vectors import add_scaled, dot, load, store, sub
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.pairs import meet
from intuitive_physics.simulation.rigid_bodies.planes import meet_plane, separation_from_plane
from intuitive_physics.simulation.rigid_bodies.poses import set_inverse_inertia
from intuitive_physics.simulation.rigid_bodies.world import body_at, contact_at, member_at, plane_at

MARGIN = 2e-4
"""m. Features nearer than this are looked at: they may close during the step."""

OVERLAP = 2e-5
"""m. Overlaps smaller than this stay: so contacts that press stay contacts."""

PARTING_SWEEPS = 8
"""Most sweeps that move overlapping bodies apart."""


@kernel
def find_contacts(world, moving, members):
    """Write all contacts of an island's bodies, as in `parts.step_island`; return how many."""
    count = 0
    for a in range(moving):
        i = member_at(world, a)
        body = body_at(world, i)
        before = count
        for p in range(world.plane_count):
            if plane_at(world, p).corners > 0:
                _note_side(world, i, p)
            already = count
            count = meet_plane(world, i, p, MARGIN, count)
            _note_faces(world, already, count)
        for b in range(a + 1, members):
            j = member_at(world, b)
            other = body_at(world, j)
            reach = body.reach + other.reach + MARGIN
            apart = sub(load(body.position), load(other.position))
            if dot(apart, apart) < reach * reach:
                others = count
                count = meet(world, i, j, MARGIN, count)
                _note_faces(world, others, count)
                if count > others and other.inverse_mass > 0.0:
                    set_inverse_inertia(other)
        if count > before:
            set_inverse_inertia(body)
    return count


@fast_inlined
def _note_faces(world, first, last):
    for c in range(first, last):
        contact_at(world, c).on_face = last - first > 2


@kernel
def _note_side(world, i, p):
    """Let a body that is behind a bounded plane pass it until it is free of it again."""
    body, plane = body_at(world, i), plane_at(world, p)
    bit = 1 << p
    if dot(load(plane.normal), load(body.position)) <= plane.offset:
        body.behind |= bit
    elif body.behind & bit:
        body.behind &= ~bit
        gap, _ = separation_from_plane(world, i, p)
        if gap < 0.0:
            body.behind |= bit


@kernel
def part_overlaps(world, count):
    """Move overlapping bodies apart along the contacts' normals, the lighter ones further."""
    for _ in range(PARTING_SWEEPS):
        moved = False
        for c in range(count):
            contact = contact_at(world, c)
            if contact.gap < -OVERLAP:
                moved = True
                _part(world, contact, count)
        if not moved:
            break


@kernel
def _part(world, contact, count):
    i, j = contact.first, contact.second
    mobility = body_at(world, i).inverse_mass
    if j >= 0:
        mobility += body_at(world, j).inverse_mass
    n = load(contact.axes[0])
    distance = -contact.gap - 0.5 * OVERLAP
    _shift(world, i, n, distance * body_at(world, i).inverse_mass / mobility, count)
    if j >= 0 and body_at(world, j).inverse_mass > 0.0:
        _shift(world, j, n, -distance * body_at(world, j).inverse_mass / mobility, count)


@kernel
def _shift(world, i, direction, distance, count):
    """Move body i and bring the gaps of its contacts up to it."""
    body = body_at(world, i)
    store(body.position, add_scaled(load(body.position), direction, distance))
    for c in range(count):
        contact = contact_at(world, c)
        if contact.first == i:
            contact.gap += distance * dot(direction, load(contact.axes[0]))
        elif contact.second == i:
            contact.gap -= distance * dot(direction, load(contact.axes[0]))
