"""One step of one island: parts that end where something hits something."""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.vectors import add_scaled, load, norm, store
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.outputs import TIME_ROUNDING
from intuitive_physics.simulation.rigid_bodies.poses import rotate
from intuitive_physics.simulation.rigid_bodies.world import body_at, contact_at, member_at
from intuitive_physics.simulation.rollout import NOT_CONVERGED, OK, TOO_FAST, TOO_MANY_EVENTS
from intuitive_physics.simulation.stepped.collision import find_contacts, part_overlaps
from intuitive_physics.simulation.stepped.contacts import (
    STEADY,
    prepare,
    speed_along,
    speed_at,
)
from intuitive_physics.simulation.stepped.impacts import IMPACT_GAP, rebound
from intuitive_physics.simulation.stepped.motion import (
    LARGEST_TURN,
    begin,
    finish,
    free_acceleration,
    keep_turning_energy,
    place,
    plan_flight,
    plan_pressed,
    turned_by,
    write_outputs,
)
from intuitive_physics.simulation.stepped.rest import sleep_if_at_rest
from intuitive_physics.simulation.stepped.solver import (
    STIFF,
    SWEEPS,
    solve,
    store_warm_start,
    warm_start,
)
from intuitive_physics.simulation.stepped.time_of_impact import first_closing
from intuitive_physics.simulation.world_batch import SPHERE

MOST_IMPACTS = 512
"""Most impacts in a step for each body; a world with more stops, TOO_MANY_EVENTS."""

MOST_TURNS = 1000
"""Parts of a step that `LARGEST_TURN` may make; a world in which it makes more stops, TOO_FAST."""

SHORTEST = 1e-3
"""A part shorter than this, as a part of a step, counts as stalled."""

STALLS = 4
"""Stalled parts in a row from which on nothing rebounds: bounces that get shorter and shorter
would find no end."""

PRECISION = 5e-4
"""Change of speed that is worth another sweep, as a part of what falling adds in a step."""

TOLERANCE = 20.0
"""Change, in that precision, that is left where the search finds no end …"""

SLIP_TOLERANCE = 5e-3
"""… and as a part of the fastest speed at a contact: bodies that slide and jam."""

SLOWEST_REBOUND = 1e-5
"""m/s. In a world without gravity, rebounds slower than this are none."""


@kernel
def rebound_threshold(world, step):
    """Speed (m/s) below which a rebound is none: its flight would last less than a step."""
    return max(SLOWEST_REBOUND, 0.5 * step * world.gravity_size)


@kernel
def step_island(world, moving, members, start, duration, threshold):
    """Carry the island's members from time `start` (s) on by `duration` (s).

    Of the first `members` bodies that `member_at` names the first `moving` move.
    """
    done, stalled, events = 0.0, 0, 0
    while done < duration - TIME_ROUNDING:
        left = min(duration - done, _followed_time(world, moving, duration))
        least = threshold if stalled < STALLS else inf
        count = _meet(world, moving, members, least)
        _plan(world, moving, count, left, least)
        if left > 0.5 * duration:
            _store_warm_starts(world, moving, count, left, least)
        after = first_closing(world, moving, members, left, threshold)
        for a in range(moving):
            _move(world, member_at(world, a), start + done, after)
        if after == duration:
            sleep_if_at_rest(world, moving, count, duration)
        done += after
        if after < left:
            events += 1
            stalled = stalled + 1 if after < SHORTEST * duration else 0
            if events > MOST_IMPACTS * moving and world.status == OK:
                world.status = TOO_MANY_EVENTS
        if world.status != OK:
            return


@kernel
def _followed_time(world, moving, duration):
    """How long (s) the turning of the island's bodies can be followed at once."""
    fastest = 0.0
    for a in range(moving):
        body = body_at(world, member_at(world, a))
        if body.round == 0:
            fastest = max(fastest, norm(load(body.spin)))
    if fastest * duration > LARGEST_TURN * MOST_TURNS:
        world.status = TOO_FAST
    return LARGEST_TURN / fastest if fastest > 0.0 else duration


@kernel
def _meet(world, moving, members, threshold):
    """Find the contacts and let those that have closed rebound; return how many there are."""
    count = find_contacts(world, moving, members)
    if count > 0:
        part_overlaps(world, count)
        for c in range(count):
            prepare(world, c)
        if rebound(world, count, threshold) > 0:
            for c in range(count):
                prepare(world, c)
    return count


@kernel
def _move(world, i, start, after):
    """Carry body i over a part that begins at time `start` and lasts `after` (s)."""
    body = body_at(world, i)
    write_outputs(world, i, start, after)
    place(body, after)
    finish(body, after)
    if body.pressed == 1:
        keep_turning_energy(body, after)
    if body.kind == SPHERE and world.orientations != 0:
        # Nothing but the outputs asks for a sphere's orientation.
        rotate(body, body.start_orientation, turned_by(body, after))


@kernel
def _plan(world, moving, count, duration, threshold):
    """Find how the bodies move over the next part: freely, or as their contacts press them."""
    for a in range(moving):
        body = body_at(world, member_at(world, a))
        begin(body)
        body.pressed = body.asleep = 0
        body.steady = 1
    if _activate(world, count, duration, threshold):
        _press(world, moving, count, duration)
    for a in range(moving):
        body = body_at(world, member_at(world, a))
        if body.pressed == 1:
            plan_pressed(body, duration)
        else:
            plan_flight(world, body, duration)


@kernel
def _activate(world, count, duration, threshold):
    """Choose the contacts that may press during the part; whether there are any.

    A contact that parts fast presses only if something else pushes one of its bodies back.
    """
    leaving = 4.0 * max(threshold, duration * world.gravity_size)
    any_active = False
    for c in range(count):
        contact = contact_at(world, c)
        contact.active = 0
        speed = speed_along(world, contact, 0)
        if speed < leaving and (speed > -threshold or contact.gap <= IMPACT_GAP):
            _let_press(world, contact, speed, duration)
            any_active = True
    if any_active:
        for c in range(count):
            contact = contact_at(world, c)
            if contact.active == 0 and _is_pressed(world, contact):
                speed = speed_along(world, contact, 0)
                if speed >= leaving:
                    _let_press(world, contact, speed, duration)
    return any_active


@kernel
def _let_press(world, contact, speed, duration):
    contact.active = 1
    contact.first_speed = speed
    contact.least_speed = -max(contact.gap, 0.0) / duration
    contact.friction = contact.static if contact.sticks == 1 else contact.dynamic
    contact.roll_limit = contact.roll_radius
    contact.rolls = contact.sticks == 1 and contact.roll_radius > 0.0
    plays = abs(speed) > STEADY * duration * world.gravity_size
    _mark(body_at(world, contact.first), plays)
    if contact.second >= 0:
        _mark(body_at(world, contact.second), plays)


@fast_inlined
def _mark(body, plays):
    body.pressed = 1
    if plays:
        body.steady = 0


@fast_inlined
def _is_pressed(world, contact):
    if body_at(world, contact.first).pressed == 1:
        return True
    return contact.second >= 0 and body_at(world, contact.second).pressed == 1


@kernel
def _press(world, moving, count, duration):
    for a in range(moving):
        body = body_at(world, member_at(world, a))
        if body.pressed == 1:
            falling = free_acceleration(world, body, duration)
            store(body.velocity, add_scaled(load(body.velocity), falling, duration))
    fastest, ratio = 0.0, 1.0
    for c in range(count):
        contact = contact_at(world, c)
        if contact.active == 1:
            fastest = max(fastest, norm(speed_at(world, contact)))
            ratio = min(ratio, _mass_ratio(world, contact))
            warm_start(world, c, duration)
    # Between masses m and M a sweep takes m / M of an error away: M / m times its change are left.
    precision = ratio * PRECISION * duration * world.gravity_size + 1e-9
    tolerance = TOLERANCE * precision + ratio * SLIP_TOLERANCE * fastest
    if not solve(world, 0, count, SWEEPS, STIFF, precision, tolerance):
        world.status = NOT_CONVERGED
    _release(world, moving, count)


@fast_inlined
def _mass_ratio(world, contact):
    """Mass of the lighter body of a contact as a part of the heavier one's."""
    if contact.second < 0:
        return 1.0
    one = body_at(world, contact.first).inverse_mass
    other = body_at(world, contact.second).inverse_mass
    return min(one, other) / max(one, other) if other > 0.0 else 1.0


@kernel
def _release(world, moving, count):
    """Let bodies fly that no contact has pushed after all."""
    for a in range(moving):
        body_at(world, member_at(world, a)).pressed = 0
    for c in range(count):
        contact = contact_at(world, c)
        if contact.active == 1 and contact.impulse[0] > 0.0:
            body_at(world, contact.first).pressed = 1
            if contact.second >= 0:
                body_at(world, contact.second).pressed = 1
    for a in range(moving):
        body = body_at(world, member_at(world, a))
        if body.pressed == 0:
            store(body.velocity, load(body.start_velocity))
            store(body.spin, load(body.start_spin))


@kernel
def _store_warm_starts(world, moving, count, duration, threshold):
    """Store the forces of contacts that press, not the blows of those that closed."""
    for a in range(moving):
        body_at(world, member_at(world, a)).warm_starts = 0
    for c in range(count):
        contact = contact_at(world, c)
        if contact.active == 1 and abs(contact.first_speed) < threshold:
            store_warm_start(world, c, duration)
