"""Objects that several contacts press at once: short steps with all contact impulses together.

A sphere wedged between planes or lying on other spheres has no closed form. For such a cluster the
contact impulses over a short step are found by projected Gauss-Seidel sweeps at the level of
velocities, and the accelerations they stand for hold during the step, so that everything else goes
on event by event.
"""

from __future__ import annotations

from math import inf

from numba import njit

from intuitive_physics.simulation.event_driven.world import (
    DYNAMIC,
    ROLLING,
    STATIC,
    inertia,
    object_coefficient,
    plane_coefficient,
)
from intuitive_physics.simulation.vectors import (
    add,
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

STEP = 1e-3
"""s."""

SWEEPS = 60

STILL_SPEED = 1e-5
"""m/s. A cluster in which nothing moves faster is at rest."""

STICKS = 1e-3
"""m/s. A contact that slips slower than this is held by static friction."""

NORMAL_IMPULSE, FRICTION, TORQUE, NORMAL = 0, 1, 4, 7
FIRST, SECOND, SLIPPED, FLOOR_SPEED = 10, 11, 12, 13
"""Columns of `World.contacts`; `SECOND` is an object or, as -1 - p, a plane."""


@njit(cache=True)
def gather(world, i):
    """Write i and all objects it touches, directly or through others; return how many."""
    world.members[0] = i
    count = 1
    at = 0
    while at < count:
        member = world.members[at]
        at += 1
        for other in range(world.radius.size):
            if world.touches_object[member, other]:
                known = False
                for k in range(count):
                    known = known or world.members[k] == other
                if not known:
                    world.members[count] = other
                    count += 1
    return count


@njit(cache=True)
def plan_cluster(world, count):
    """Set the accelerations of the first `count` members for the next step."""
    end = world.time[world.members[0]] + STEP
    moves = False
    for k in range(count):
        i = world.members[k]
        # While the impulses are sought, the accelerations hold the velocities at the step's end.
        store(
            world.acceleration,
            i,
            add(load(world.velocity, i), scaled(_gravity(world), STEP)),
        )
        store(world.spin_acceleration, i, load(world.spin, i))
    contacts = _list_contacts(world, count)
    for _ in range(SWEEPS):
        for c in range(contacts):
            _solve_contact(world, c)
    for k in range(count):
        i = world.members[k]
        velocity, spin = load(world.velocity, i), load(world.spin, i)
        change = sub(load(world.acceleration, i), velocity)
        turn = sub(load(world.spin_acceleration, i), spin)
        speed = norm(velocity) + norm(change) + world.radius[i] * (norm(spin) + norm(turn))
        moves = moves or speed > STILL_SPEED
        store(world.acceleration, i, scaled(change, 1.0 / STEP))
        store(world.spin_acceleration, i, scaled(turn, 1.0 / STEP))
        world.phase_end[i] = end
        world.clustered[i] = True
    if not moves:
        for k in range(count):
            _rest(world, world.members[k])


@njit(cache=True)
def _rest(world, i):
    for rows in (world.velocity, world.spin, world.acceleration, world.spin_acceleration):
        store(rows, i, (0.0, 0.0, 0.0))
    world.phase_end[i] = inf


@njit(cache=True)
def _gravity(world):
    return world.gravity[0], world.gravity[1], world.gravity[2]


@njit(cache=True)
def _list_contacts(world, count):
    contacts = 0
    for k in range(count):
        i = world.members[k]
        for p in range(world.normal.shape[0]):
            if world.touches_plane[i, p]:
                n = load(world.normal, p)
                gap = dot(load(world.position, i), n) - world.offset[p] - world.radius[i]
                _write_contact(world, contacts, n, i, -1 - p, gap)
                contacts += 1
        for j in range(i):
            if world.touches_object[i, j]:
                apart = sub(load(world.position, i), load(world.position, j))
                distance = norm(apart)
                gap = distance - world.radius[i] - world.radius[j]
                _write_contact(world, contacts, scaled(apart, 1.0 / distance), i, j, gap)
                contacts += 1
    return contacts


@njit(cache=True)
def _write_contact(world, c, n, i, other, gap):
    row = world.contacts[c]
    row[:] = 0.0
    row[NORMAL], row[NORMAL + 1], row[NORMAL + 2] = n
    row[FIRST] = i
    row[SECOND] = other
    now = _contact_motion(world, world.velocity, world.spin, n, i, other)
    row[SLIPPED] = norm(tangential(now, n))
    row[FLOOR_SPEED] = -max(gap, 0.0) / STEP


@njit(cache=True)
def _contact_motion(world, velocities, spins, n, i, other):
    """Velocity of i's material at the contact relative to the other's."""
    motion = add_scaled(load(velocities, i), cross(load(spins, i), n), -world.radius[i])
    if other >= 0:
        theirs = add_scaled(
            load(velocities, other), cross(load(spins, other), n), world.radius[other]
        )
        motion = sub(motion, theirs)
    return motion


@njit(cache=True)
def _push(world, i, other, n, impulse):
    """Apply an impulse to i at the contact, and its reaction to the other."""
    world_velocity, world_spin = world.acceleration, world.spin_acceleration
    arm = cross(n, impulse)
    store(world_velocity, i, add_scaled(load(world_velocity, i), impulse, 1.0 / world.mass[i]))
    turned = add_scaled(load(world_spin, i), arm, -world.radius[i] / inertia(world, i))
    store(world_spin, i, turned)
    if other >= 0:
        pushed = add_scaled(load(world_velocity, other), impulse, -1.0 / world.mass[other])
        store(world_velocity, other, pushed)
        turned = add_scaled(
            load(world_spin, other), arm, -world.radius[other] / inertia(world, other)
        )
        store(world_spin, other, turned)


@njit(cache=True)
def _solve_contact(world, c):
    row = world.contacts[c]
    i, other = int(row[FIRST]), int(row[SECOND])
    n = (row[NORMAL], row[NORMAL + 1], row[NORMAL + 2])
    inverse_mass = 1.0 / world.mass[i]
    if other >= 0:
        inverse_mass += 1.0 / world.mass[other]
        static = object_coefficient(world, STATIC, i, other)
        dynamic = object_coefficient(world, DYNAMIC, i, other)
        rolling = object_coefficient(world, ROLLING, i, other)
    else:
        static = plane_coefficient(world, STATIC, i, -1 - other)
        dynamic = plane_coefficient(world, DYNAMIC, i, -1 - other)
        rolling = plane_coefficient(world, ROLLING, i, -1 - other)

    motion = _contact_motion(world, world.acceleration, world.spin_acceleration, n, i, other)
    before = row[NORMAL_IMPULSE]
    row[NORMAL_IMPULSE] = max(0.0, before + (row[FLOOR_SPEED] - dot(motion, n)) / inverse_mass)
    _push(world, i, other, n, scaled(n, row[NORMAL_IMPULSE] - before))

    sticks = row[SLIPPED] < STICKS
    limit = (static if sticks else dynamic) * row[NORMAL_IMPULSE]
    old = (row[FRICTION], row[FRICTION + 1], row[FRICTION + 2])
    new = clamped(add_scaled(old, tangential(motion, n), -1.0 / (3.5 * inverse_mass)), limit)
    row[FRICTION], row[FRICTION + 1], row[FRICTION + 2] = new
    _push(world, i, other, n, sub(new, old))
    if sticks:
        _solve_rolling(world, row, i, other, rolling * row[NORMAL_IMPULSE])


@njit(cache=True)
def _solve_rolling(world, row, i, other, limit_per_radius):
    """Oppose the relative spin by a torque of at most μ_r r N, r the smaller radius."""
    spins = world.spin_acceleration
    relative = load(spins, i)
    softness = 1.0 / inertia(world, i)
    radius = world.radius[i]
    if other >= 0:
        relative = sub(relative, load(spins, other))
        softness += 1.0 / inertia(world, other)
        radius = min(radius, world.radius[other])
    old = (row[TORQUE], row[TORQUE + 1], row[TORQUE + 2])
    new = clamped(add_scaled(old, relative, -1.0 / softness), limit_per_radius * radius)
    row[TORQUE], row[TORQUE + 1], row[TORQUE + 2] = new
    change = sub(new, old)
    store(spins, i, add_scaled(load(spins, i), change, 1.0 / inertia(world, i)))
    if other >= 0:
        store(spins, other, add_scaled(load(spins, other), change, -1.0 / inertia(world, other)))
