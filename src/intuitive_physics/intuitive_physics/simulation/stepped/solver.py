"""Impulses that satisfy all contacts at once, by projected Gauss-Seidel sweeps.

At each contact: the normal speed afterwards is at least `least_speed`, and the normal impulse
pushes only; friction opposes slip by at most μ_s J_n where the contact sticks and μ_d J_n where it
slips; on a contact that sticks, rolling friction opposes the relative spin by at most μ_r r J_n.

Where few sweeps are not enough, as for a heavy body on a light one, steps of Newton's method help,
each followed by sweeps.
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import (
    add_scaled,
    dot,
    load,
    scaled,
    store,
    sub,
)
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.world import (
    WARM_STARTS,
    body_at,
    contact_at,
    warm_start_at,
)
from intuitive_physics.simulation.stepped.contacts import (
    apply_impulses,
    push,
    relative_spin,
    speed_along,
    twist,
)
from intuitive_physics.simulation.stepped.newton import change_impulses, newton_step

SWEEPS = 40
"""Sweeps before the first step of Newton's method."""

NEWTON_STEPS = 24
"""Most steps of Newton's method in a search."""

STIFF, SOFT = 1e-10, 1e-4
"""Compliance that Newton's method adds to each contact, as a part of the contact's own. The four
corners of a face are redundant contacts: without it the equations are singular. Resting contacts
take no more of it than rounding needs: with more, Newton's method needs thousands of steps for a
tower in which a body stands on a lighter one. Where it does not converge, as where bodies slide and
jam, and in impacts, whose corners rebound at different speeds, the larger one keeps impulses
small."""

FREE_STEPS = 8
"""Steps of it that are taken whole. More of them have led round in a circle, as friction that grows
with the force that presses can: from then on steps are shortened and sweeps relaxed."""

HALVINGS = 4
"""Most halvings of a step of Newton's method that does not come nearer to the laws."""

FEW_STEPS = 1
"""Steps of it after which a tolerance counts."""

RELAXATION = 0.5
"""Share of each change that relaxed sweeps make."""

MOST_SWEEPS = 256
"""Most sweeps after one of its steps: one after the first, twice as many after each further one."""

LAST_SWEEPS = 20_000
"""Most relaxed sweeps where both searches have found no end."""

SAME_PLACE = 0.3
"""Motion in a step below which a contact is the same one, as a part of a body's reach."""


@kernel
def solve(world, first, last, sweeps, softness, precision, tolerance):
    """Find the impulses of the active contacts from `first` to `last` (exclusive).

    They are found when a sweep changes no speed by more than `precision` (m/s), which is looked
    for `sweeps` times before Newton's method, or by more than `tolerance` after some of its steps:
    contacts that are a little apart may ask for what no rigid body can do. `softness` is that of
    the first search, STIFF or SOFT. Returns whether they were found.
    """
    alone = _only_active(world, first, last)
    if alone >= 0 and contact_at(world, alone).rolls == 0:
        if _solve_alone(world, contact_at(world, alone), sweeps, precision):
            return True
    elif _sweep(world, first, last, sweeps, precision, 1.0) < precision:
        return True
    if _search(world, first, last, softness, precision, tolerance):
        return True
    if softness != SOFT:
        _withdraw(world, first, last)
        if _sweep(world, first, last, SWEEPS, precision, 1.0) < precision:
            return True
        if _search(world, first, last, SOFT, precision, tolerance):
            return True
    return _sweep(world, first, last, LAST_SWEEPS, precision, RELAXATION) < tolerance


@kernel
def _search(world, first, last, softness, precision, tolerance):
    """Take steps of Newton's method with sweeps after each; return whether they find an end."""
    further = 1
    for step in range(NEWTON_STEPS):
        circles = step >= FREE_STEPS
        if not _step(world, first, last, softness, HALVINGS if circles else 0):
            return False
        share = RELAXATION if circles else 1.0
        change = _sweep(world, first, last, further, precision, share)
        if change < precision or (change < tolerance and step >= FEW_STEPS):
            return True
        further = min(2 * further, MOST_SWEEPS)
    return False


@kernel
def _withdraw(world, first, last):
    """Take all impulses back, so that a search begins from none."""
    apply_impulses(world, first, last, -1.0)
    for c in range(first, last):
        contact = contact_at(world, c)
        store(contact.impulse, (0.0, 0.0, 0.0))
        store(contact.torque, (0.0, 0.0, 0.0))


@kernel
def _step(world, first, last, softness, halvings):
    """Take a step of Newton's method, or so much of it that the laws are not violated more.

    Returns whether there was one to take.
    """
    before = _sweep(world, first, last, 1, 0.0, 0.0) if halvings > 0 else 0.0
    rows = newton_step(world, first, last, softness)
    share = 1.0
    for _ in range(halvings):
        if rows == 0 or _sweep(world, first, last, 1, 0.0, 0.0) <= before:
            break
        share *= 0.5
        change_impulses(world, rows, -share)
    return rows > 0


@kernel
def _sweep(world, first, last, sweeps, precision, share):
    """Sweep until a sweep asks for no larger change of speed; return the last one (m/s).

    There are at most `sweeps`. Only a share of each change is made: with a share of 0
    nothing changes, and the returned speed is the error of the impulses.
    """
    largest = 0.0
    for sweep in range(sweeps):
        largest = 0.0
        for k in range(first, last):
            # To and fro: what one sweep carries up a stack the next one carries down.
            c = k if sweep & 1 == 0 else first + last - 1 - k
            contact = contact_at(world, c)
            if contact.active == 1:
                change = _solve_contact(world, contact, share)
                if contact.rolls == 1:
                    change = max(change, _solve_rolling(world, contact, share))
                largest = max(largest, change)
        if largest < precision:
            break
    return largest


@kernel
def _only_active(world, first, last):
    """Index of the active contact, or -1 where there are more or none."""
    found = -1
    for c in range(first, last):
        if contact_at(world, c).active == 1:
            if found >= 0:
                return -1
            found = c
    return found


@kernel
def _solve_alone(world, contact, sweeps, precision):
    """Sweep as over many contacts, but follow only the speeds along this one's axes.

    By an impulse along axis i that along axis j grows by W_ij: a third of what a sweep over
    velocities and spins computes. Returns whether the last one changed no speed by more.
    """
    cross = _coupling(world, contact, 0, 1)
    tilt, skew = _coupling(world, contact, 0, 2), _coupling(world, contact, 1, 2)
    inverse, effective = load(contact.inverse_effective_mass), load(contact.effective_mass)
    normal = speed_along(world, contact, 0) - contact.least_speed
    slip, drift = speed_along(world, contact, 1), speed_along(world, contact, 2)
    pressing, along, across = load(contact.impulse)
    grip, done = contact.grip_mass, False
    for _ in range(sweeps):
        new = max(pressing - normal * effective[0], 0.0)
        change, pressing = new - pressing, new
        normal += inverse[0] * change
        slip += cross * change
        drift += tilt * change
        limit = contact.friction * pressing
        first, second = _held(along - slip * grip, across - drift * grip, limit)
        largest = abs(change) * inverse[0]
        change, further, along, across = first - along, second - across, first, second
        largest = max(largest, abs(change) * inverse[1], abs(further) * inverse[2])
        normal += cross * change + tilt * further
        slip += inverse[1] * change + skew * further
        drift += skew * change + inverse[2] * further
        done = largest < precision
        if done:
            break
    old = load(contact.impulse)
    store(contact.impulse, (pressing, along, across))
    for axis in range(3):
        push(world, contact, axis, contact.impulse[axis] - old[axis])
    return done


@fast_inlined
def _coupling(world, contact, one, other):
    """Speed (m/s) along one axis of a contact from 1 N s along another one."""
    speed = dot(load(contact.turn[one]), load(contact.lever[other]))
    if contact.second >= 0:
        speed += dot(load(contact.other_turn[one]), load(contact.other_lever[other]))
    return speed


@fast_inlined
def _held(first, second, limit):
    """Friction (N s) that is asked for, as much of it as there can be."""
    square = first * first + second * second
    if square > limit * limit:
        shrink = limit / sqrt(square)
        return first * shrink, second * shrink
    return first, second


@kernel
def _solve_contact(world, contact, share):
    """Improve a contact's impulses, first along the normal, then in the plane, by a share."""
    body = body_at(world, contact.first)
    v, w = load(body.velocity), load(body.spin)
    paired = contact.second >= 0
    other = body_at(world, contact.second if paired else contact.first)
    ov, ow = load(other.velocity), load(other.spin)

    n = load(contact.axes[0])
    speed = dot(v, n) + dot(w, load(contact.lever[0]))
    if paired:
        speed -= dot(ov, n) + dot(ow, load(contact.other_lever[0]))
    before = contact.impulse[0]
    pressing = max(before + (contact.least_speed - speed) * contact.effective_mass[0], 0.0)
    asked = pressing - before
    change = share * asked
    pressing = before + change
    contact.impulse[0] = pressing
    largest = abs(asked) * contact.inverse_effective_mass[0]
    v, w = _pushed(v, w, n, load(contact.turn[0]), change, body.inverse_mass)
    if paired:
        ov, ow = _pushed(ov, ow, n, load(contact.other_turn[0]), -change, other.inverse_mass)

    along, across = load(contact.axes[1]), load(contact.axes[2])
    slip = dot(v, along) + dot(w, load(contact.lever[1]))
    drift = dot(v, across) + dot(w, load(contact.lever[2]))
    if paired:
        slip -= dot(ov, along) + dot(ow, load(contact.other_lever[1]))
        drift -= dot(ov, across) + dot(ow, load(contact.other_lever[2]))
    first = contact.impulse[1] - slip * contact.grip_mass
    second = contact.impulse[2] - drift * contact.grip_mass
    first, second = _held(first, second, contact.friction * pressing)
    change, change_across = first - contact.impulse[1], second - contact.impulse[2]
    largest = max(largest, abs(change) * contact.inverse_effective_mass[1])
    largest = max(largest, abs(change_across) * contact.inverse_effective_mass[2])
    change, change_across = share * change, share * change_across
    contact.impulse[1] += change
    contact.impulse[2] += change_across
    v, w = _pushed(v, w, along, load(contact.turn[1]), change, body.inverse_mass)
    v, w = _pushed(v, w, across, load(contact.turn[2]), change_across, body.inverse_mass)
    store(body.velocity, v)
    store(body.spin, w)
    if paired:
        mobility = other.inverse_mass
        ov, ow = _pushed(ov, ow, along, load(contact.other_turn[1]), -change, mobility)
        ov, ow = _pushed(ov, ow, across, load(contact.other_turn[2]), -change_across, mobility)
        store(other.velocity, ov)
        store(other.spin, ow)
    return largest


@fast_inlined
def _pushed(velocity, spin, axis, turn, impulse, inverse_mass):
    """Velocity and spin after an impulse (N s) along an axis."""
    return add_scaled(velocity, axis, impulse * inverse_mass), add_scaled(spin, turn, impulse)


@kernel
def _solve_rolling(world, contact, share):
    """Improve a contact's torques by a share: rolling and pivoting have a limit each."""
    n = load(contact.axes[0])
    old = load(contact.torque)
    wanted = add_scaled(old, relative_spin(world, contact), -contact.rolling_inertia)
    limit = contact.roll_limit * contact.impulse[0]
    pivot = dot(wanted, n)
    rolling = add_scaled(wanted, n, -pivot)
    square = dot(rolling, rolling)
    if square > limit * limit:
        rolling = scaled(rolling, limit / sqrt(square))
    new = add_scaled(rolling, n, min(max(pivot, -limit), limit))
    change = sub(new, old)
    store(contact.torque, add_scaled(old, change, share))
    twist(world, contact, scaled(change, share))
    return (abs(change[0]) + abs(change[1]) + abs(change[2])) * contact.rolling_response


@kernel
def warm_start(world, c, duration):
    """Begin with what acted nearest to the same place in the last step."""
    contact = contact_at(world, c)
    body = body_at(world, contact.first)
    nearest, least = -1, SAME_PLACE * SAME_PLACE * body.reach * body.reach
    for k in range(body.warm_starts):
        last = warm_start_at(world, contact.first, k)
        if last.second == contact.second:
            apart = sub(load(last.arm), load(contact.arm))
            if dot(apart, apart) < least:
                nearest, least = k, dot(apart, apart)
    if nearest < 0:
        return
    last = warm_start_at(world, contact.first, nearest)
    force = scaled(load(last.force), duration)
    contact.impulse[0] = max(dot(force, load(contact.axes[0])), 0.0)
    contact.impulse[1] = dot(force, load(contact.axes[1]))
    contact.impulse[2] = dot(force, load(contact.axes[2]))
    for axis in range(3):
        push(world, contact, axis, contact.impulse[axis])
    if contact.rolls == 1:
        torque = scaled(load(last.torque), duration)
        store(contact.torque, torque)
        twist(world, contact, torque)


@kernel
def store_warm_start(world, c, duration):
    """Keep a contact's forces for the next step."""
    contact = contact_at(world, c)
    body = body_at(world, contact.first)
    k = body.warm_starts
    if k < WARM_STARTS:
        body.warm_starts = k + 1
        warm = warm_start_at(world, contact.first, k)
        warm.second = contact.second
        store(warm.arm, load(contact.arm))
        force = scaled(load(contact.axes[0]), contact.impulse[0] / duration)
        force = add_scaled(force, load(contact.axes[1]), contact.impulse[1] / duration)
        force = add_scaled(force, load(contact.axes[2]), contact.impulse[2] / duration)
        store(warm.force, force)
        store(warm.torque, scaled(load(contact.torque), 1.0 / duration))
