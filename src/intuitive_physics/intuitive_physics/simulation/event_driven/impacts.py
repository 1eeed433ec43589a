"""Resolve: what an impact does to velocity and spin.

Normal: Newton's restitution. Tangential: Coulomb's friction over the impact's impulse. A contact
that slips is braked by dynamic friction until its slip is gone (stick) or the normal impulse is
spent (slip): |J_t| = min(μ_d J_n, m_t |s|), where m_t is the mass felt at the contact point, 2/7 m
for one solid sphere. A sphere that sticks to a plane also feels rolling friction, an angular
impulse of at most μ_r r J_n.
"""

from __future__ import annotations

from numba import njit

from intuitive_physics.simulation.event_driven.world import (
    DYNAMIC,
    RESTITUTION,
    ROLLING,
    inertia,
    object_coefficient,
    plane_coefficient,
)
from intuitive_physics.simulation.vectors import (
    add,
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    store,
    sub,
    tangential,
)

REBOUND_SPEED = 5e-3
"""m/s. A rebound slower than this ends the bouncing (Zeno): it would rise by about 1 µm."""


@njit(cache=True)
def plane_slip(world, i, n):
    """Velocity of object i's material at its contact with a plane of normal n, in the plane."""
    velocity = tangential(load(world.velocity, i), n)
    return add_scaled(velocity, cross(load(world.spin, i), n), -world.radius[i])


@njit(cache=True)
def hit_plane(world, i, p):
    """Let object i, touching plane p and approaching it, rebound."""
    n = load(world.normal, p)
    approach = -dot(load(world.velocity, i), n)
    rebound = approach * plane_coefficient(world, RESTITUTION, i, p)
    if rebound < REBOUND_SPEED:
        rebound = 0.0
        world.touches_plane[i, p] = True
    mass, radius = world.mass[i], world.radius[i]
    impulse = mass * (approach + rebound)

    slip = plane_slip(world, i, n)
    velocity = add_scaled(load(world.velocity, i), n, approach + rebound)
    spin = load(world.spin, i)
    to_stick = 2.0 / 7.0 * mass * norm(slip)
    limit = plane_coefficient(world, DYNAMIC, i, p) * impulse
    if to_stick > 0.0:
        friction = scaled(slip, -2.0 / 7.0 * mass * min(1.0, limit / to_stick))
        velocity = add_scaled(velocity, friction, 1.0 / mass)
        spin = add_scaled(spin, cross(n, friction), -radius / inertia(world, i))
    if to_stick <= limit:
        # The angular impulse μ_r r J_n of a rolling sphere takes 5/7 μ_r J_n of its momentum.
        rolling = tangential(velocity, n)
        speed = norm(rolling)
        if speed > 0.0:
            # It needs as much friction, of which there is only what sticking has left.
            loss = 5.0 / 7.0 * plane_coefficient(world, ROLLING, i, p) * impulse
            loss = min(loss, limit - to_stick)
            slowed = scaled(rolling, -min(1.0, loss / (mass * speed)))
            velocity = add(velocity, slowed)
            spin = add_scaled(spin, cross(n, slowed), 1.0 / radius)
    store(world.velocity, i, velocity)
    store(world.spin, i, spin)


@njit(cache=True)
def hit_object(world, i, j):
    """Let objects i and j, touching and approaching each other, rebound."""
    apart = sub(load(world.position, i), load(world.position, j))
    n = scaled(apart, 1.0 / norm(apart))
    relative = sub(load(world.velocity, i), load(world.velocity, j))
    approach = -dot(relative, n)
    rebound = approach * object_coefficient(world, RESTITUTION, i, j)
    if rebound < REBOUND_SPEED:
        rebound = 0.0
        world.touches_object[i, j] = True
        world.touches_object[j, i] = True
    inverse_mass = 1.0 / world.mass[i] + 1.0 / world.mass[j]
    impulse = (approach + rebound) / inverse_mass

    arms = add(
        scaled(load(world.spin, i), world.radius[i]), scaled(load(world.spin, j), world.radius[j])
    )
    slip = sub(tangential(relative, n), cross(arms, n))
    speed = norm(slip)
    total = scaled(n, impulse)
    if speed > 0.0:
        to_stick = speed / (3.5 * inverse_mass)
        limit = object_coefficient(world, DYNAMIC, i, j) * impulse
        friction = scaled(slip, -min(to_stick, limit) / speed)
        total = add(total, friction)
        turning = cross(n, friction)
        for k in (i, j):
            turned = add_scaled(load(world.spin, k), turning, -world.radius[k] / inertia(world, k))
            store(world.spin, k, turned)
    store(world.velocity, i, add_scaled(load(world.velocity, i), total, 1.0 / world.mass[i]))
    store(world.velocity, j, add_scaled(load(world.velocity, j), total, -1.0 / world.mass[j]))
