"""Spheres without air among what never moves, from event to event: exact, at a cost of the bounces.

Free flight, sliding and rolling on a plane are parabolas; impacts are roots of polynomials. See
`contact_phases`, `impacts` and `clusters` for the laws.
"""

from __future__ import annotations

from math import inf

from numba import int64

from intuitive_physics.geometry.vectors import load, norm
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.outputs import write_rest
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    followed_at,
    is_finite,
    member_at,
    pair_of,
)
from intuitive_physics.simulation.rollout import NOT_FINITE, OK, TOO_MANY_EVENTS
from intuitive_physics.simulation.spheres.clusters import gather
from intuitive_physics.simulation.spheres.detection import (
    predict_solid_impacts,
    predict_sphere_impacts,
)
from intuitive_physics.simulation.spheres.impacts import hit_solid, hit_sphere
from intuitive_physics.simulation.spheres.motion import carry, write_outputs
from intuitive_physics.simulation.spheres.transitions import (
    end_jam,
    find_touching,
    part_start,
    replan,
)
from intuitive_physics.simulation.world_record import stop_if_asked

INSTANT = 1e-7
"""s. Events nearer than this are at the same time …"""

JAM = 30
"""… and more of them than this are a jam."""

TOUCHES = 1e-9
"""m. Spheres nearer than this at the start are in contact."""

TAKES_OVER = 2e-5
"""m. Gap or overlap of a contact that a step has left."""


@kernel
def follow_from_start(world, end):
    """Carry all spheres of a world from its beginning to time `end` (s)."""
    part_start(world)
    for a in range(world.followed_count):
        i = followed_at(world, a)
        body = body_at(world, i)
        body.followed = 1
        body.pair_time, body.pair_with = inf, -1
        find_touching(world, i, TOUCHES)
    world.end = end
    _replan_all(world)
    _follow(world, end)


@kernel
def follow(world, start, end):
    """Carry the followed spheres from time `start` to `end` (s)."""
    world.end = end
    for a in range(world.followed_count):
        i = followed_at(world, a)
        body = body_at(world, i)
        if body.asleep == 1:
            write_rest(world, i, start)
        body.time = start
    for a in range(world.followed_count):
        if body_at(world, followed_at(world, a)).followed == 0:
            _take_over(world, followed_at(world, a))
    _plan_to_go_on(world)
    _follow(world, end)
    for a in range(world.followed_count):
        body = body_at(world, followed_at(world, a))
        speed = norm(load(body.velocity)) + norm(load(body.spin))
        body.asleep = speed + norm(load(body.acceleration)) == 0.0


@kernel
def _take_over(world, i):
    """Follow sphere i, which has been stepped: what of its contacts lasts is found roughly."""
    body = body_at(world, i)
    body.touched_count = 0
    body.followed = body.clustered = 1
    body.phase_end = body.time
    for j in range(world.moving):
        if j != i:
            pair_of(world, i, j).touches = 0
    find_touching(world, i, TAKES_OVER)


@kernel
def _plan_to_go_on(world):
    """Plan spheres that have been taken over; phases of the others go on, to events beyond before.

    What a sphere may meet is known up to the end of the span before, and there may be others now.
    """
    for a in range(world.followed_count):
        i = followed_at(world, a)
        if body_at(world, i).phase_end <= body_at(world, i).time:
            replan(world, i, gather(world, i))
    for a in range(world.followed_count):
        predict_solid_impacts(world, followed_at(world, a))
    for a in range(world.followed_count):
        predict_sphere_impacts(world, followed_at(world, a))


@kernel
def _follow(world, end):
    """Carry the followed spheres, whose next events are known, to time `end` (s)."""
    instant, at_once = -1.0, 0
    while world.status == OK:
        stop_if_asked(world)
        t, i, j = _next_event(world)
        if t > end or world.status != OK:
            break
        world.events += 1
        at_once = at_once + 1 if t - instant < INSTANT else 0
        instant = t
        if world.events > world.most_events:
            world.status = TOO_MANY_EVENTS
        elif at_once > JAM:
            at_once = 0
            _advance_all(world, t)
            end_jam(world, i)
            _replan_all(world)
        else:
            _resolve(world, t, i, j)
    if world.status == OK:
        _advance_all(world, end)
        for a in range(world.followed_count):
            if not is_finite(body_at(world, followed_at(world, a))):
                world.status = NOT_FINITE


@kernel
def _resolve(world, t, i, j):
    """Let the event of sphere i at time t happen, and of sphere j unless that is -1."""
    _advance(world, i, t)
    if j >= 0:
        _advance(world, j, t)
        pair_of(world, i, j).impact_time = inf
        hit_sphere(world, i, j)
        _replan(world, j)
    elif body_at(world, i).impact_time <= t:
        hit_solid(world, i, body_at(world, i).impact_solid)
    if not is_finite(body_at(world, i)):
        world.status = NOT_FINITE
    else:
        _replan(world, i)


@kernel
def _replan(world, i):
    """Plan sphere i and all that touch it again, after these have been brought to its time."""
    count = gather(world, i)
    for k in range(1, count):
        _advance(world, member_at(world, k), body_at(world, i).time)
    replan(world, i, count)


@kernel
def _replan_all(world):
    for a in range(world.followed_count):
        i = followed_at(world, a)
        replan(world, i, gather(world, i))


@kernel
def _advance(world, i, t):
    """Bring sphere i to time t, writing all its outputs up to and including t."""
    write_outputs(world, i, t)
    carry(body_at(world, i), t, world.orientations != 0)


@kernel
def _advance_all(world, t):
    for a in range(world.followed_count):
        _advance(world, followed_at(world, a), t)


@kernel
def _next_event(world):
    """Time of the next event, its sphere, and the other sphere or -1."""
    first, i, j = inf, int64(0), int64(-1)
    for b in range(world.followed_count):
        k = followed_at(world, b)
        body = body_at(world, k)
        t = min(body.phase_end, body.impact_time)
        if t < first:
            first, i, j = t, k, int64(-1)
        if body.pair_time < first:
            first, i, j = body.pair_time, body.pair_with, k
    return first, i, j
