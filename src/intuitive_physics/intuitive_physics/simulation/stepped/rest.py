"""Rest: what has come to a stop sleeps where contact forces within their limits balance gravity."""

from __future__ import annotations

from intuitive_physics.geometry.vectors import add_scaled, dot, load, norm, scaled, store
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.world import body_at, contact_at, member_at
from intuitive_physics.simulation.stepped.contacts import push, twist
from intuitive_physics.simulation.stepped.impacts import IMPACT_GAP
from intuitive_physics.simulation.stepped.motion import is_still
from intuitive_physics.simulation.stepped.solver import STIFF, solve

BALANCE = 1e-6
"""Speed that a step leaves to what is balanced, as a part of what falling adds in it."""


@kernel
def sleep_if_at_rest(world, moving, count, duration):
    """Stop an island that contacts hold, and let it sleep if it stood still before, too.

    `count` are its contacts. Their forces are sought over one more step of `duration` (s), from the
    velocities there are: so nothing stops that no friction ends, and what only comes through a
    turning point has a step in which to move on.
    """
    fall = duration * world.gravity_size
    stood, still = True, fall > 0.0
    for a in range(moving):
        body = body_at(world, member_at(world, a))
        velocity, spin = load(body.velocity), load(body.spin)
        still = still and body.pressed == 1 and is_still(body, velocity, spin)
        stood = stood and norm(load(body.start_velocity)) + norm(load(body.start_spin)) == 0.0
    if not still:
        return
    for a in range(moving):
        body = body_at(world, member_at(world, a))
        # The step is over: its path has room for what it has led to.
        store(body.path_velocity, load(body.velocity))
        store(body.turning, load(body.spin))
        falling = add_scaled(load(body.velocity), load(world.gravity), duration)
        store(body.velocity, falling)
    for c in range(count):
        _hold(world, contact_at(world, c))
    balanced = solve(world, 0, count, 1, STIFF, BALANCE * fall, BALANCE * fall)
    for a in range(moving):
        balanced = balanced and _moves_less(body_at(world, member_at(world, a)), BALANCE * fall)
    for a in range(moving):
        body = body_at(world, member_at(world, a))
        body.asleep = balanced and stood
        store(body.velocity, (0.0, 0.0, 0.0) if balanced else load(body.path_velocity))
        store(body.spin, (0.0, 0.0, 0.0) if balanced else load(body.turning))


@kernel
def _hold(world, contact):
    """Begin with the impulses by which a contact pressed in the step before."""
    pressed = contact.active == 1
    contact.active = contact.gap <= IMPACT_GAP
    contact.least_speed = 0.0
    contact.friction = contact.static
    contact.roll_limit = contact.roll_radius
    contact.rolls = contact.roll_radius > 0.0
    for axis in range(3):
        if contact.active == 1 and pressed:
            push(world, contact, axis, contact.impulse[axis])
        else:
            contact.impulse[axis] = 0.0
    if contact.rolls == 1 and contact.active == 1 and pressed:
        twist(world, contact, load(contact.torque))
    else:
        store(contact.torque, (0.0, 0.0, 0.0))


@fast_inlined
def _moves_less(body, speed):
    velocity, rim = load(body.velocity), scaled(load(body.spin), body.reach)
    return dot(velocity, velocity) + dot(rim, rim) < speed * speed
