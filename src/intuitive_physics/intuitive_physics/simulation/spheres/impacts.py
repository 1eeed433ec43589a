"""Resolve: what an impact does to velocity and spin.

Normal: Newton's restitution. Tangential: Coulomb's friction over the impact's impulse. A contact
that slips is braked by dynamic friction until its slip is gone (stick) or the normal impulse is
spent (slip): |J_t| = min(μ_d J_n, m_t |s|), where m_t is the mass felt at the contact point,
m κ / (1 + κ) with κ = I / (m r²) for one sphere: 2/7 m for a solid one. A sphere that sticks to a
solid also feels rolling friction, an angular impulse of at most μ_r r J_n. With noise, each impact
has a restitution and a normal of its own, see `noisy_impacts`; one that would not leave the surface
keeps the surface's normal.
"""

from __future__ import annotations

from intuitive_physics.geometry.vectors import (
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
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.noisy_impacts import noisy_restitution, tilted
from intuitive_physics.simulation.rigid_bodies.solids import solid_at
from intuitive_physics.simulation.rigid_bodies.world import body_at, pair_of
from intuitive_physics.simulation.spheres.contact_geometry import nearest
from intuitive_physics.simulation.spheres.touching import pair_coefficient, solid_coefficient, touch
from intuitive_physics.simulation.world_record import DYNAMIC, RESTITUTION, ROLLING

REBOUND_SPEED = 5e-3
"""m/s. A rebound slower than this ends the bouncing (Zeno): it would rise by about 1 µm."""

SOFT_SPEED = 1e-4
"""m/s. What comes to rest from less keeps the contacts it has, as in a cluster."""


@kernel
def contact_slip(body, n):
    """Velocity of a body's material at its contact of normal n, along the solid's surface."""
    velocity = tangential(load(body.velocity), n)
    return add_scaled(velocity, cross(load(body.spin), n), -body.radius)


@kernel
def hit_solid(world, i, s):
    """Let sphere i, touching solid s and approaching it, rebound."""
    body = body_at(world, i)
    _, n, _, _ = nearest(world, solid_at(world, s), load(body.position), body.radius)
    restitution = solid_coefficient(world, RESTITUTION, i, s)
    if world.noisy == 1:
        restitution = noisy_restitution(world, restitution)
        slanted = tilted(world, n)
        world.noisy_impacts += 1
        velocity, spin = load(body.velocity), load(body.spin)
        if -dot(velocity, slanted) * restitution >= REBOUND_SPEED:
            _rebound_from_solid(world, i, s, slanted, restitution)
            if dot(load(body.velocity), n) >= REBOUND_SPEED:
                return
            store(body.velocity, velocity)
            store(body.spin, spin)
    _rebound_from_solid(world, i, s, n, restitution)


@kernel
def _rebound_from_solid(world, i, s, n, restitution):
    body = body_at(world, i)
    approach = -dot(load(body.velocity), n)
    rebound = approach * restitution
    if rebound < REBOUND_SPEED:
        rebound = 0.0
        touch(world, body, s)
        if approach < SOFT_SPEED:
            body.clustered = 1
    impulse = body.mass * max(0.0, approach + rebound)

    slip = contact_slip(body, n)
    store(body.velocity, add_scaled(load(body.velocity), n, approach + rebound))
    felt_mass = (1.0 - body.rolling_share) * body.mass
    to_stick = felt_mass * norm(slip)
    limit = solid_coefficient(world, DYNAMIC, i, s) * impulse
    if to_stick > 0.0:
        _push(body, n, scaled(slip, -felt_mass * min(1.0, limit / to_stick)))
    if to_stick <= limit:
        # The angular impulse μ_r r J_n of a rolling sphere takes μ_r J_n / (1 + κ) of its momentum.
        # It needs as much friction, of which there is only what sticking has left.
        loss = body.rolling_share * solid_coefficient(world, ROLLING, i, s) * impulse
        _slow_rolling(body, n, min(loss, limit - to_stick))


@kernel
def _slow_rolling(body, n, loss):
    """Take so much momentum (N s) from a body that rolls without slip, or all it has."""
    rolling = tangential(load(body.velocity), n)
    speed = norm(rolling)
    if speed > 0.0:
        slowed = scaled(rolling, -min(1.0, loss / (body.mass * speed)))
        store(body.velocity, add(load(body.velocity), slowed))
        store(body.spin, add_scaled(load(body.spin), cross(n, slowed), 1.0 / body.radius))


@kernel
def _push(body, n, impulse):
    """Apply an impulse at the contact point -r n."""
    store(body.velocity, add_scaled(load(body.velocity), impulse, 1.0 / body.mass))
    turning = cross(n, impulse)
    store(
        body.spin, add_scaled(load(body.spin), turning, -body.radius * body.own_inverse_inertia[0])
    )


@kernel
def hit_sphere(world, i, j):
    """Let spheres i and j, touching and approaching each other, rebound."""
    one, other = body_at(world, i), body_at(world, j)
    apart = sub(load(one.position), load(other.position))
    n = scaled(apart, 1.0 / norm(apart))
    restitution = pair_coefficient(world, RESTITUTION, i, j)
    if world.noisy == 1:
        restitution = noisy_restitution(world, restitution)
        slanted = tilted(world, n)
        world.noisy_impacts += 1
        velocity, spin = load(one.velocity), load(one.spin)
        other_velocity, other_spin = load(other.velocity), load(other.spin)
        if -dot(sub(velocity, other_velocity), slanted) * restitution >= REBOUND_SPEED:
            _rebound_of_pair(world, i, j, slanted, restitution)
            if dot(sub(load(one.velocity), load(other.velocity)), n) >= REBOUND_SPEED:
                return
            store(one.velocity, velocity)
            store(one.spin, spin)
            store(other.velocity, other_velocity)
            store(other.spin, other_spin)
    _rebound_of_pair(world, i, j, n, restitution)


@kernel
def _rebound_of_pair(world, i, j, n, restitution):
    one, other = body_at(world, i), body_at(world, j)
    relative = sub(load(one.velocity), load(other.velocity))
    approach = -dot(relative, n)
    rebound = approach * restitution
    if rebound < REBOUND_SPEED:
        rebound = 0.0
        pair_of(world, i, j).touches = 1
    inverse_mass = 1.0 / one.mass + 1.0 / other.mass
    impulse = (approach + rebound) / inverse_mass

    arms = add_scaled(scaled(load(one.spin), one.radius), load(other.spin), other.radius)
    slip = sub(tangential(relative, n), cross(arms, n))
    speed = norm(slip)
    total = scaled(n, impulse)
    if speed > 0.0:
        to_stick = speed / (one.slip_gain / one.mass + other.slip_gain / other.mass)
        limit = pair_coefficient(world, DYNAMIC, i, j) * impulse
        total = add_scaled(total, slip, -min(to_stick, limit) / speed)
    _push(one, n, total)
    _push(other, scaled(n, -1.0), scaled(total, -1.0))
