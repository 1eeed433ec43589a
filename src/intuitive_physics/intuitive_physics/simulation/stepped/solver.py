"""Impulses that satisfy all contacts at once, by projected Gauss-Seidel sweeps.

At each contact: the normal speed afterwards is at least `least_speed`, and the normal impulse
pushes only; friction opposes slip by at most μ_s J_n where the contact sticks and μ_d J_n where it
slips; on a contact that sticks, rolling friction opposes the relative spin by at most μ_r r J_n.
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.simulation.kernels import kernel
from intuitive_physics.simulation.stepped.contacts import (
    push,
    relative_spin,
    speed_along,
    twist,
)
from intuitive_physics.simulation.stepped.world import body_at, contact_at
from intuitive_physics.simulation.vectors import (
    add_scaled,
    clamped,
    dot,
    load,
    norm,
    scaled,
    store,
    sub,
    tangential,
)


@kernel
def solve(world, first, last, sweeps, precision):
    """Sweep over the active contacts from `first` to `last` (exclusive).

    Parameters
    ----------
    sweeps : at most so many; fewer where a sweep changes no speed by more than
    precision : m/s
    """
    for _ in range(sweeps):
        largest = 0.0
        for c in range(first, last):
            contact = contact_at(world, c)
            if contact.active == 1:
                change = _solve_normal(world, contact)
                change = max(change, _solve_friction(world, contact))
                if contact.rolls == 1:
                    change = max(change, _solve_rolling(world, contact))
                largest = max(largest, change)
        if largest < precision:
            break


@kernel
def _solve_normal(world, contact):
    before = contact.impulse[0]
    needed = before + (contact.least_speed - speed_along(world, contact, 0)) / contact.softness[0]
    contact.impulse[0] = max(needed, 0.0)
    change = contact.impulse[0] - before
    if change != 0.0:
        push(world, contact, 0, change)
    return abs(change) * contact.softness[0]


@kernel
def _solve_friction(world, contact):
    old, old_across = contact.impulse[1], contact.impulse[2]
    new = old - speed_along(world, contact, 1) / contact.softness[1]
    across = old_across - speed_along(world, contact, 2) / contact.softness[2]
    limit = contact.friction * contact.impulse[0]
    square = new * new + across * across
    if square > limit * limit:
        shrink = limit / sqrt(square)
        new, across = new * shrink, across * shrink
    contact.impulse[1], contact.impulse[2] = new, across
    push(world, contact, 1, new - old)
    push(world, contact, 2, across - old_across)
    change = max(abs(new - old), abs(across - old_across))
    return change * max(contact.softness[1], contact.softness[2])


@kernel
def _solve_rolling(world, contact):
    """Rolling and pivoting have a limit each."""
    n = load(contact.axes[0])
    old = load(contact.torque)
    new = add_scaled(old, relative_spin(world, contact), -1.0 / contact.roll_softness)
    limit = contact.roll_radius * contact.impulse[0]
    pivot = min(max(dot(new, n), -limit), limit)
    new = add_scaled(clamped(tangential(new, n), limit), n, pivot)
    store(contact.torque, new)
    change = sub(new, old)
    twist(world, contact, change)
    return norm(change) * contact.roll_softness * norm(load(contact.arm))


@kernel
def start_from_kept(world, c, duration):
    """Begin with what acted on the same contact in the last step."""
    contact = contact_at(world, c)
    body = body_at(world, contact.first)
    code = 64 * contact.second + contact.key
    for k in range(body.kept):
        if body.kept_keys[k] == code:
            force = scaled(load(body.kept_forces[k]), duration)
            contact.impulse[0] = max(dot(force, load(contact.axes[0])), 0.0)
            contact.impulse[1] = dot(force, load(contact.axes[1]))
            contact.impulse[2] = dot(force, load(contact.axes[2]))
            for axis in range(3):
                push(world, contact, axis, contact.impulse[axis])
            if contact.rolls == 1:
                torque = scaled(load(body.kept_torques[k]), duration)
                store(contact.torque, torque)
                twist(world, contact, torque)
            return


@kernel
def keep(world, c, duration):
    """Keep a contact's forces for the next step."""
    contact = contact_at(world, c)
    body = body_at(world, contact.first)
    k = body.kept
    if k < body.kept_keys.size:
        body.kept = k + 1
        body.kept_keys[k] = 64 * contact.second + contact.key
        force = scaled(load(contact.axes[0]), contact.impulse[0] / duration)
        force = add_scaled(force, load(contact.axes[1]), contact.impulse[1] / duration)
        force = add_scaled(force, load(contact.axes[2]), contact.impulse[2] / duration)
        store(body.kept_forces[k], force)
        store(body.kept_torques[k], scaled(load(contact.torque), 1.0 / duration))
