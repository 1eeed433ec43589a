"""The rows of a contact: how impulses along its axes change velocities, and its coefficients."""

from __future__ import annotations

from math import sqrt

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
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.world import body_at, contact_at, plane_at, times
from intuitive_physics.simulation.world_batch import BOX
from intuitive_physics.simulation.world_record import (
    DYNAMIC,
    RESTITUTION,
    ROLLING,
    STATIC,
    coefficient,
)

STICK_SPEED = 1e-3
"""m/s. A contact that slips slower than this is held by static friction."""

STEADY = 5e-3
"""Normal speed above which a contact is unsteady, as a part of what falling adds in a step."""


@kernel
def prepare(world, c):
    """Fill in a contact of which the geometry is known."""
    contact = contact_at(world, c)
    body = body_at(world, contact.first)
    n = load(contact.axes[0])
    slip = tangential(speed_at(world, contact), n)
    slipping = norm(slip)
    along = scaled(slip, 1.0 / slipping) if slipping > 1e-9 else _any_perpendicular(n)
    store(contact.axes[1], along)
    store(contact.axes[2], cross(n, along))
    contact.sticks = slipping < STICK_SPEED
    for axis in range(3):
        contact.impulse[axis] = 0.0
        contact.torque[axis] = 0.0
        direction = load(contact.axes[axis])
        lever = cross(load(contact.arm), direction)
        turn = times(body.inverse_inertia, lever)
        store(contact.lever[axis], lever)
        store(contact.turn[axis], turn)
        inverse_mass = body.inverse_mass + dot(lever, turn)
        if contact.second >= 0:
            other = body_at(world, contact.second)
            lever = cross(load(contact.other_arm), direction)
            turn = times(other.inverse_inertia, lever)
            store(contact.other_lever[axis], lever)
            store(contact.other_turn[axis], turn)
            inverse_mass += other.inverse_mass + dot(lever, turn)
        contact.inverse_effective_mass[axis] = inverse_mass
        contact.effective_mass[axis] = 1.0 / inverse_mass
    contact.grip_mass = min(contact.effective_mass[1], contact.effective_mass[2])
    _look_up(world, contact)


@kernel
def _look_up(world, contact):
    body = body_at(world, contact.first)
    a = body.material
    response = _rolling_response(body)
    radius = 0.0 if contact.on_face and body.kind == BOX else body.thinness
    if contact.second >= 0:
        other = body_at(world, contact.second)
        b = other.material
        if other.inverse_mass > 0.0:
            response += _rolling_response(other)
        radius = _rolling_radius(contact, body, other)
    else:
        b = plane_at(world, -1 - contact.second).material
    contact.static = coefficient(world, STATIC, a, b)
    contact.dynamic = coefficient(world, DYNAMIC, a, b)
    contact.restitution = coefficient(world, RESTITUTION, a, b)
    contact.roll_radius = coefficient(world, ROLLING, a, b) * radius
    contact.rolling_response = response * radius
    contact.rolling_inertia = 1.0 / response


@fast_inlined
def _rolling_radius(contact, body, other):
    """The radius (m) of the round one of two bodies, the smaller one of two that are alike.

    That of a box is half its shortest edge; one that never moves has none. On a face a box does not
    roll.
    """
    if contact.on_face and body.kind == BOX and other.kind == BOX:
        return 0.0
    if other.inverse_mass == 0.0 or (body.kind != BOX and other.kind == BOX):
        return body.thinness
    if body.kind == BOX and other.kind != BOX:
        return other.thinness
    return min(body.thinness, other.thinness)


@fast_inlined
def _rolling_response(body):
    inverse = body.own_inverse_inertia
    return max(max(inverse[0], inverse[1]), inverse[2])


@fast_inlined
def _any_perpendicular(n):
    if abs(n[2]) > 0.7:
        scale = 1.0 / sqrt(n[1] * n[1] + n[2] * n[2])
        return 0.0, -n[2] * scale, n[1] * scale
    scale = 1.0 / sqrt(n[0] * n[0] + n[1] * n[1])
    return -n[1] * scale, n[0] * scale, 0.0


@kernel
def speed_at(world, contact):
    """Velocity (m/s) of the first's material at the contact, relative to the second's."""
    body = body_at(world, contact.first)
    speed = add(load(body.velocity), cross(load(body.spin), load(contact.arm)))
    if contact.second >= 0:
        other = body_at(world, contact.second)
        there = add(load(other.velocity), cross(load(other.spin), load(contact.other_arm)))
        speed = sub(speed, there)
    return speed


@fast_inlined
def speed_along(world, contact, axis):
    """The part of `speed_at` along one axis of a prepared contact."""
    body = body_at(world, contact.first)
    speed = dot(load(body.velocity), load(contact.axes[axis])) + dot(
        load(body.spin), load(contact.lever[axis])
    )
    if contact.second >= 0:
        other = body_at(world, contact.second)
        speed -= dot(load(other.velocity), load(contact.axes[axis])) + dot(
            load(other.spin), load(contact.other_lever[axis])
        )
    return speed


@fast_inlined
def push(world, contact, axis, impulse):
    """Apply an impulse (N s) along one axis of a prepared contact, to both."""
    body = body_at(world, contact.first)
    n = load(contact.axes[axis])
    store(body.velocity, add_scaled(load(body.velocity), n, impulse * body.inverse_mass))
    store(body.spin, add_scaled(load(body.spin), load(contact.turn[axis]), impulse))
    if contact.second >= 0:
        other = body_at(world, contact.second)
        store(other.velocity, add_scaled(load(other.velocity), n, -impulse * other.inverse_mass))
        store(other.spin, add_scaled(load(other.spin), load(contact.other_turn[axis]), -impulse))


@kernel
def twist(world, contact, torque):
    """Apply an angular impulse (N m s), in the world's axes, to both."""
    body = body_at(world, contact.first)
    store(body.spin, add(load(body.spin), times(body.inverse_inertia, torque)))
    if contact.second >= 0:
        other = body_at(world, contact.second)
        store(other.spin, sub(load(other.spin), times(other.inverse_inertia, torque)))


@kernel
def apply_impulses(world, first, last, share):
    """Apply a share of the impulses and torques of the active contacts once more."""
    for c in range(first, last):
        contact = contact_at(world, c)
        if contact.active == 1:
            for axis in range(3):
                push(world, contact, axis, share * contact.impulse[axis])
            twist(world, contact, scaled(load(contact.torque), share))


@kernel
def relative_spin(world, contact):
    """Spin (rad/s) of the first relative to the second."""
    spin = load(body_at(world, contact.first).spin)
    if contact.second >= 0:
        spin = sub(spin, load(body_at(world, contact.second).spin))
    return spin
