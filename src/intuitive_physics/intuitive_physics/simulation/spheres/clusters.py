"""Spheres that several contacts press at once: short steps with all contact impulses together.

A sphere wedged between solids or lying on other spheres has no closed form. For such a cluster
`stepped.solver` finds the contact impulses over a short step, from those of the step before on. The
accelerations they stand for hold during the step, so that everything else goes on event by event.
"""

from __future__ import annotations

from math import inf

from numba import int64

from intuitive_physics.geometry.vectors import add_scaled, load, norm, scaled, store, sub
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.contact_points import write_contact
from intuitive_physics.simulation.rigid_bodies.solids import body_or_plane, solid_at
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    contact_at,
    followed_at,
    member_at,
    pair_of,
    set_member,
)
from intuitive_physics.simulation.rollout import NOT_CONVERGED
from intuitive_physics.simulation.spheres.contact_geometry import nearest
from intuitive_physics.simulation.stepped.contacts import let_press, prepare
from intuitive_physics.simulation.stepped.solver import (
    SWEEPS,
    solve,
    store_warm_start,
    sweep,
    warm_start,
)

STEP = 1e-3
"""s. Over one of these the accelerations of a cluster hold."""

MOST_SWEEPS = 400
"""Most sweeps over the contacts of a cluster, whose equations are many for Newton's method."""

PRECISION = 1e-6
"""m/s, of the 1e-2 m/s that a step of falling gives: a sweep that changes speeds by less is the
last one."""

TOLERANCE = 1e-4
"""m/s. Change that the last of them may leave; a world with more stops, NOT_CONVERGED."""

STILL_SPEED = 1e-5
"""m/s. A cluster in which nothing moves faster is at rest."""


@kernel
def gather(world, i):
    """Write i and all spheres it touches, directly or through others; return how many."""
    set_member(world, 0, i)
    count = 1
    at = 0
    while at < count:
        member = member_at(world, at)
        at += 1
        for a in range(world.followed_count):
            other = followed_at(world, a)
            if other != member and pair_of(world, member, other).touches:
                known = False
                for k in range(count):
                    known = known or member_at(world, k) == other
                if not known:
                    set_member(world, count, other)
                    count += 1
    return count


@kernel
def plan_cluster(world, count):
    """Set the accelerations of the first `count` members for the next step."""
    end = body_at(world, member_at(world, 0)).time + STEP
    _solve(world, count, STEP)
    moves = False
    for k in range(count):
        body = body_at(world, member_at(world, k))
        velocity, spin = load(body.start_velocity), load(body.start_spin)
        change = sub(load(body.velocity), velocity)
        turn = sub(load(body.spin), spin)
        speed = norm(velocity) + norm(change) + body.radius * (norm(spin) + norm(turn))
        moves = moves or speed > STILL_SPEED
        store(body.velocity, velocity)
        store(body.spin, spin)
        store(body.acceleration, scaled(change, 1.0 / STEP))
        store(body.spin_acceleration, scaled(turn, 1.0 / STEP))
        body.phase_end = end
        body.clustered = 1
        body.rounds_edge = 0
    if not moves:
        for k in range(count):
            _rest(body_at(world, member_at(world, k)))


@kernel
def stop_jam(world, count):
    """Let the first `count` members hit everything they touch at once, without restitution.

    Impacts one after the other need not come to an end where several contacts are wedged.
    """
    _solve(world, count, 0.0)
    for k in range(count):
        body_at(world, member_at(world, k)).clustered = 1


@kernel
def _solve(world, count, falling):
    """Give the members their velocities after all contact impulses and `falling` (s) of gravity.

    By those before, which are kept as those of the start, the contacts stick or slip.
    """
    contacts = _list_contacts(world, count)
    for c in range(contacts):
        prepare(world, c)
        let_press(contact_at(world, c), STEP)
    for k in range(count):
        body = body_at(world, member_at(world, k))
        store(body.start_velocity, load(body.velocity))
        store(body.start_spin, load(body.spin))
        store(body.velocity, add_scaled(load(body.velocity), load(world.gravity), falling))
    for c in range(contacts):
        warm_start(world, c, falling)
    left = sweep(world, 0, contacts, MOST_SWEEPS, PRECISION, 1.0)
    if left > TOLERANCE and not solve(world, 0, contacts, SWEEPS, PRECISION, TOLERANCE):
        world.status = NOT_CONVERGED
    for k in range(count):
        body_at(world, member_at(world, k)).warm_starts = 0
    if falling > 0.0:
        for c in range(contacts):
            store_warm_start(world, c, falling)


@kernel
def _rest(body):
    nothing = (0.0, 0.0, 0.0)
    store(body.velocity, nothing)
    store(body.spin, nothing)
    store(body.acceleration, nothing)
    store(body.spin_acceleration, nothing)
    body.phase_end = inf


@kernel
def _list_contacts(world, count):
    """Write all contacts of the first `count` members; return how many."""
    contacts = int64(0)
    for k in range(count):
        i = member_at(world, k)
        body = body_at(world, i)
        centre, r = load(body.position), body.radius
        for t in range(body.touched_count):
            solid = solid_at(world, body.touched[t])
            gap, n, _, _ = nearest(world, solid, centre, r)
            second, point = body_or_plane(world, solid), add_scaled(centre, n, -r)
            contacts = write_contact(world, contacts, i, second, gap, n, point)
        for a in range(k):
            j = member_at(world, a)
            if pair_of(world, i, j).touches:
                other = body_at(world, j)
                apart = sub(centre, load(other.position))
                distance = norm(apart)
                gap = distance - r - other.radius
                n = scaled(apart, 1.0 / distance)
                contacts = write_contact(world, contacts, i, j, gap, n, add_scaled(centre, n, -r))
    return contacts
