"""Spheres that several contacts press at once: short steps with all contact impulses together.

A sphere wedged between solids or lying on other spheres has no closed form. For such a cluster the
contact impulses over a short step are found by projected Gauss-Seidel sweeps at the level of
velocities, from those of the step before on, and the accelerations they stand for hold during the
step, so that everything else goes on event by event.
"""

from __future__ import annotations

from math import inf

from numba import int64

from intuitive_physics.geometry.vectors import (
    add_scaled,
    clamped,
    cross,
    dot,
    load,
    norm,
    scaled,
    store,
    sub,
    tangential,
)
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.solids import solid_at
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    followed_at,
    member_at,
    pair_of,
    set_member,
    sphere_contact_at,
)
from intuitive_physics.simulation.rollout import NOT_CONVERGED
from intuitive_physics.simulation.spheres.contact_geometry import nearest
from intuitive_physics.simulation.spheres.touching import pair_coefficient, solid_coefficient
from intuitive_physics.simulation.world_record import DYNAMIC, ROLLING, STATIC

STEP = 1e-3
"""s. Over one of these the accelerations of a cluster hold."""

SWEEPS = 20_000
"""Most sweeps over the contacts of a cluster, which end once none changes by `CONVERGED`."""

TOLERANCE = 1e-4
"""m/s. Change that the last of them may leave; a world with more stops, NOT_CONVERGED."""

CONVERGED = 1e-7
"""m/s, of the 1e-2 m/s that a step of falling gives."""

STILL_SPEED = 1e-5
"""m/s. A cluster in which nothing moves faster is at rest."""

STICKS = 1e-3
"""m/s. A contact that slips slower than this is held by static friction."""


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
    for k in range(count):
        body = body_at(world, member_at(world, k))
        store(body.start_velocity, load(body.velocity))
        store(body.start_spin, load(body.spin))
    contacts = _list_contacts(world, count, falling)
    for k in range(count):
        body = body_at(world, member_at(world, k))
        fallen = add_scaled(load(body.velocity), load(world.gravity), falling)
        store(body.velocity, fallen)
    for c in range(contacts):
        _begin(world, sphere_contact_at(world, c))
    largest = 0.0
    for _ in range(SWEEPS):
        largest = 0.0
        for c in range(contacts):
            largest = max(largest, _solve_contact(world, c))
        if largest < CONVERGED:
            return
    if largest > TOLERANCE:
        world.status = NOT_CONVERGED


@kernel
def _rest(body):
    nothing = (0.0, 0.0, 0.0)
    store(body.velocity, nothing)
    store(body.spin, nothing)
    store(body.acceleration, nothing)
    store(body.spin_acceleration, nothing)
    body.phase_end = inf


@kernel
def _list_contacts(world, count, falling):
    contacts = int64(0)
    for k in range(count):
        i = member_at(world, k)
        body = body_at(world, i)
        for t in range(body.touched_count):
            s = body.touched[t]
            solid = solid_at(world, s)
            gap, n, _, _ = nearest(world, solid, load(body.position), body.radius)
            _write_contact(world, contacts, n, i, -1 - s, gap, falling)
            contacts += 1
        for j in range(i):
            if pair_of(world, i, j).touches:
                other = body_at(world, j)
                apart = sub(load(body.position), load(other.position))
                distance = norm(apart)
                gap = distance - body.radius - other.radius
                n = scaled(apart, 1.0 / distance)
                _write_contact(world, contacts, n, i, j, gap, falling)
                contacts += 1
    return contacts


@kernel
def _write_contact(world, c, n, i, other, gap, falling):
    contact = sphere_contact_at(world, c)
    now = body_at(world, i).time
    same = contact.first == i and contact.second == other
    if not same or contact.until != now or falling == 0.0:
        contact.normal_impulse = 0.0
        store(contact.friction, (0.0, 0.0, 0.0))
        store(contact.torque, (0.0, 0.0, 0.0))
    contact.until = now + falling if falling > 0.0 else -1.0
    contact.first, contact.second = i, other
    store(contact.normal, n)
    contact.least_speed = -max(gap, 0.0) / STEP
    contact.slip = norm(tangential(_speed_at_contact(world, contact), n))


@kernel
def _begin(world, contact):
    """Apply the impulses of the step before, from which the search goes on."""
    friction = tangential(load(contact.friction), load(contact.normal))
    store(contact.friction, friction)
    _push(world, contact, add_scaled(friction, load(contact.normal), contact.normal_impulse))
    if contact.slip < STICKS:
        _twist(world, contact, load(contact.torque))
    else:
        store(contact.torque, (0.0, 0.0, 0.0))


@kernel
def _speed_at_contact(world, contact):
    """Velocity of the first's material at the contact relative to the other's."""
    n = load(contact.normal)
    body = body_at(world, contact.first)
    arm = cross(load(body.spin), n)
    speed = add_scaled(load(body.velocity), arm, -body.radius)
    if contact.second >= 0:
        body = body_at(world, contact.second)
        arm = cross(load(body.spin), n)
        speed = sub(speed, add_scaled(load(body.velocity), arm, body.radius))
    return speed


@kernel
def _push(world, contact, impulse):
    """Apply an impulse to the first at the contact, and its reaction to the other."""
    arm = cross(load(contact.normal), impulse)
    _push_one(body_at(world, contact.first), impulse, arm)
    if contact.second >= 0:
        _push_one(body_at(world, contact.second), scaled(impulse, -1.0), arm)


@kernel
def _push_one(body, impulse, arm):
    store(body.velocity, add_scaled(load(body.velocity), impulse, 1.0 / body.mass))
    turned = add_scaled(load(body.spin), arm, -body.radius / body.inertia[0])
    store(body.spin, turned)


@kernel
def _solve_contact(world, c):
    """Improve the impulses of one contact; return by how much (m/s) that changed a velocity."""
    contact = sphere_contact_at(world, c)
    i, other = contact.first, contact.second
    n = load(contact.normal)
    inverse_mass = 1.0 / body_at(world, i).mass
    slip_gain = body_at(world, i).slip_gain * inverse_mass
    if other >= 0:
        second = body_at(world, other)
        inverse_mass += 1.0 / second.mass
        slip_gain += second.slip_gain / second.mass
        static = pair_coefficient(world, STATIC, i, other)
        dynamic = pair_coefficient(world, DYNAMIC, i, other)
        rolling = pair_coefficient(world, ROLLING, i, other)
    else:
        static = solid_coefficient(world, STATIC, i, -1 - other)
        dynamic = solid_coefficient(world, DYNAMIC, i, -1 - other)
        rolling = solid_coefficient(world, ROLLING, i, -1 - other)

    speed = _speed_at_contact(world, contact)
    before = contact.normal_impulse
    needed = before + (contact.least_speed - dot(speed, n)) / inverse_mass
    contact.normal_impulse = max(0.0, needed)
    _push(world, contact, scaled(n, contact.normal_impulse - before))

    sticks = contact.slip < STICKS
    limit = (static if sticks else dynamic) * contact.normal_impulse
    old = load(contact.friction)
    new = clamped(add_scaled(old, tangential(speed, n), -1.0 / slip_gain), limit)
    store(contact.friction, new)
    _push(world, contact, sub(new, old))
    change = (abs(contact.normal_impulse - before) + norm(sub(new, old))) * inverse_mass
    if sticks:
        change += _solve_rolling(world, contact, rolling * contact.normal_impulse)
    return change


@kernel
def _solve_rolling(world, contact, limit_per_radius):
    """Oppose the relative spin by a torque of at most μ_r r N, r the smaller radius.

    Returns the change in m/s at the surface.
    """
    body = body_at(world, contact.first)
    relative = load(body.spin)
    inverse_inertia = 1.0 / body.inertia[0]
    radius = body.radius
    if contact.second >= 0:
        other = body_at(world, contact.second)
        relative = sub(relative, load(other.spin))
        inverse_inertia += 1.0 / other.inertia[0]
        radius = min(radius, other.radius)
    old = load(contact.torque)
    new = clamped(add_scaled(old, relative, -1.0 / inverse_inertia), limit_per_radius * radius)
    store(contact.torque, new)
    change = sub(new, old)
    _twist(world, contact, change)
    return norm(change) * inverse_inertia * radius


@kernel
def _twist(world, contact, torque):
    """Apply an angular impulse to the first, and its reaction to the other."""
    _twist_one(body_at(world, contact.first), torque)
    if contact.second >= 0:
        _twist_one(body_at(world, contact.second), scaled(torque, -1.0))


@kernel
def _twist_one(body, torque):
    turned = add_scaled(load(body.spin), torque, 1.0 / body.inertia[0])
    store(body.spin, turned)
