"""Impacts: pair after pair rebounds, until none approaches.

All contacts of one pair are solved together: Newton's restitution along each normal, Coulomb's
friction with μ_d over the impulse. Where several eccentric contacts would together raise the
kinetic energy, all their impulses are scaled down to keep it. With noise, `noisy_impacts` gives
each impact a restitution and normals of its own.
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import dot, load, norm, scaled, store
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.noisy_impacts import noisy_restitution, tilted
from intuitive_physics.simulation.rigid_bodies.world import body_at, contact_at
from intuitive_physics.simulation.rollout import NOT_CONVERGED
from intuitive_physics.simulation.stepped.contacts import (
    apply_impulses,
    prepare,
    relative_spin,
    speed_along,
)
from intuitive_physics.simulation.stepped.solver import SOFT, SWEEPS, solve
from intuitive_physics.simulation.world_batch import BOX, SPHERE

IMPACT_GAP = 1e-5
"""m. Bodies farther apart have not hit each other yet."""

PRECISION = 1e-5
"""m/s. A sweep that changes speeds by less is the last one."""

TOLERANCE = 1e-3
"""Change of speed that a sweep may leave where the search finds no end, as a part of the impact's
speed."""

STICKING = 1.0 - 1e-6
"""Part of the greatest friction below which a contact sticks. One that slips uses all of it but for
rounding, which must not decide."""

ROUNDS_A_CONTACT = 4
"""Most impacts for each contact; what still approaches is left to the solver of what presses."""


@kernel
def rebound(world, count, threshold):
    """Let all prepared contacts that have closed rebound; return the number of impacts.

    Approaches slower than the threshold (m/s) are no impacts, and slower rebounds are none.
    """
    impacts = 0
    for _ in range(ROUNDS_A_CONTACT * count):
        fastest, hit = -threshold, -1
        for c in range(count):
            if contact_at(world, c).gap <= IMPACT_GAP:
                speed = speed_along(world, contact_at(world, c), 0)
                if speed < fastest:
                    fastest, hit = speed, c
        if hit < 0:
            break
        impacts += 1
        first, last = _pair_of(world, hit, count)
        _hit(world, first, last, threshold, -fastest)
    return impacts


@kernel
def _pair_of(world, c, count):
    """The range of contacts between the same two bodies."""
    one, other = contact_at(world, c).first, contact_at(world, c).second
    first, last = c, c + 1
    while first > 0 and (
        contact_at(world, first - 1).first == one and contact_at(world, first - 1).second == other
    ):
        first -= 1
    while last < count and (
        contact_at(world, last).first == one and contact_at(world, last).second == other
    ):
        last += 1
    return first, last


@kernel
def _hit(world, first, last, threshold, approach):
    if world.noisy == 1:
        _disturb(world, first, last, threshold)
    for c in range(first, last):
        contact = contact_at(world, c)
        speed = speed_along(world, contact, 0)
        back = -contact.restitution * speed
        contact.least_speed = back if back > threshold else 0.0
        contact.active = contact.gap <= IMPACT_GAP or speed >= -threshold
        contact.friction = contact.dynamic
        contact.rolls = 0
        for axis in range(3):
            contact.impulse[axis] = 0.0
            contact.torque[axis] = 0.0
    tolerance = PRECISION + TOLERANCE * approach
    solved = solve(world, first, last, SWEEPS, SOFT, PRECISION, tolerance)
    if _let_roll(world, first, last):
        solved = solve(world, first, last, SWEEPS, SOFT, PRECISION, tolerance) and solved
    if not solved:
        world.status = NOT_CONVERGED
    contact = contact_at(world, first)
    if last - first > 1 or _is_eccentric(world, contact):
        _limit_energy(world, first, last)
    if world.noisy == 1:
        for c in range(first, last):
            _turn(world, c, load(contact_at(world, c).normal))


@kernel
def _disturb(world, first, last, threshold):
    """Give the contacts of one pair the restitution and normals of a noisy impact.

    What rebounds too slowly to leave keeps its normals, else what rests would wander.
    """
    restitution = noisy_restitution(world, contact_at(world, first).restitution)
    fastest = 0.0
    for c in range(first, last):
        fastest = min(fastest, speed_along(world, contact_at(world, c), 0))
    leaves = -restitution * fastest > threshold
    for c in range(first, last):
        contact = contact_at(world, c)
        store(contact.normal, load(contact.axes[0]))
        if leaves:
            _turn(world, c, tilted(world, load(contact.normal)))
        contact.restitution = restitution
    world.noisy_impacts += 1


@kernel
def _turn(world, c, n):
    """Give a contact another normal; that of a sphere always passes through its centre."""
    contact = contact_at(world, c)
    store(contact.axes[0], n)
    if body_at(world, contact.first).kind == SPHERE:
        store(contact.arm, scaled(n, -norm(load(contact.arm))))
    if contact.second >= 0 and body_at(world, contact.second).kind == SPHERE:
        store(contact.other_arm, scaled(n, norm(load(contact.other_arm))))
    prepare(world, c)


@kernel
def _let_roll(world, first, last):
    """Let rolling friction act where a contact has come to stick, which shows only afterwards.

    A torque T on a rolling body needs the friction T / (r (1 + κ)) with κ = I / (m r²). A contact
    that has not as much grip left passes on only the part it can.
    """
    any_rolls = False
    for c in range(first, last):
        contact = contact_at(world, c)
        grip = contact.friction * contact.impulse[0]
        used = sqrt(contact.impulse[1] ** 2 + contact.impulse[2] ** 2)
        contact.rolls = contact.roll_radius > 0.0 and used < STICKING * grip
        if contact.rolls == 1:
            rolling, arm = body_at(world, contact.first), load(contact.arm)
            if rolling.kind == BOX and contact.second >= 0:
                other = body_at(world, contact.second)
                if other.kind != BOX:
                    rolling, arm = other, load(contact.other_arm)
            radius = abs(dot(arm, load(contact.axes[0])))
            bearable = (1.0 + rolling.inertia_ratio) * radius * (grip - used) / contact.impulse[0]
            contact.roll_limit = min(contact.roll_radius, bearable)
        any_rolls = any_rolls or contact.rolls == 1
    return any_rolls


@kernel
def _is_eccentric(world, contact):
    """Whether a normal impulse also turns a body."""
    if body_at(world, contact.first).kind != SPHERE:
        return True
    return contact.second >= 0 and body_at(world, contact.second).kind != SPHERE


@kernel
def _limit_energy(world, first, last):
    """Scale the impulses J to what gains no kinetic energy: s J·u⁻ + s² J·(u⁺ - u⁻)/2 ≤ 0."""
    at_end = _work(world, first, last)
    apply_impulses(world, first, last, -1.0)
    at_start = _work(world, first, last)
    curvature = 0.5 * (at_end - at_start)
    share = 1.0
    if at_start + curvature > 0.0 and curvature > 0.0:
        share = max(0.0, -at_start / curvature)
    apply_impulses(world, first, last, share)


@kernel
def _work(world, first, last):
    """J·u with the present speeds u, in J."""
    work = 0.0
    for c in range(first, last):
        contact = contact_at(world, c)
        if contact.active == 1:
            for axis in range(3):
                work += contact.impulse[axis] * speed_along(world, contact, axis)
            work += dot(load(contact.torque), relative_spin(world, contact))
    return work
