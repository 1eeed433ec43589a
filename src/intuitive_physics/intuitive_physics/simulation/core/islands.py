"""Islands: bodies that may meet before a time, directly or through others, and their motion.

Islands are looked for over spans of 32, 8, 2 steps and one. Whatever is an island of its own over a
span is carried to its end at once, and so is an island of spheres, from event to event; other
islands of several bodies are divided again over shorter spans, and what still may meet in the next
step is stepped together. So each body has a clock of its own, and none can meet another that is not
as far.

How far bodies can go is bounded by energy: those of an island can pass theirs on to one another, so
the speed of each is at most √(2 E / m), with the island's kinetic energy E. Gravity lets √E grow by
g t √(M / 2) at most, with the island's mass M, and so that speed by g t √(M / m).
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import dot, load, norm, sub
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.core.lone_body import step_lone_body
from intuitive_physics.simulation.rigid_bodies.outputs import write_rest
from intuitive_physics.simulation.rigid_bodies.poses import angular_momentum
from intuitive_physics.simulation.rigid_bodies.world import (
    LEVELS,
    body_at,
    followed_at,
    is_finite,
    member_at,
    set_followed,
    set_member,
)
from intuitive_physics.simulation.rollout import NOT_FINITE, OK
from intuitive_physics.simulation.spheres.events import follow
from intuitive_physics.simulation.stepped.collision import MARGIN
from intuitive_physics.simulation.stepped.parts import step_island
from intuitive_physics.simulation.world_batch import CAPSULE
from intuitive_physics.simulation.world_record import stop_if_asked

SPANS = (32, 8, 2, 1)
"""Steps over which islands are looked for, level by level; each is a multiple of the next."""


@kernel
def carry_bodies(world, total, step, threshold):
    """Simulate all moving bodies for `total` steps, or until all of them sleep."""
    moving = world.moving
    for i in range(moving):
        body_at(world, i).done = 0
    now = 0
    while now < total and world.status == OK:
        stop_if_asked(world)
        if now % SPANS[0] == 0 and _all_sleep(world, moving):
            return
        advance, level = 0, 0
        while advance == 0 and level < LEVELS:
            span = SPANS[level]
            if now % span == 0:
                count = min(span, total - now)
                _find_islands(world, moving, level, now, count * step)
                if _carry_islands(world, moving, level, now, count, step, threshold):
                    advance = count
            level += 1
        if advance == 0:
            advance = 1
            _step_islands(world, moving, now, step, threshold)
        _check_finite(world, moving)
        now += advance


@kernel
def _all_sleep(world, moving):
    asleep = True
    for i in range(moving):
        asleep = asleep and body_at(world, i).asleep == 1
    return asleep


@kernel
def _check_finite(world, moving):
    for i in range(moving):
        if not is_finite(body_at(world, i)):
            world.status = NOT_FINITE


@kernel
def _find_islands(world, moving, level, now, duration):
    """Give all bodies that may meet within `duration` (s) one number, that of the first of them.

    Bodies that are carried beyond step `now` are left out, and so are pairs of different islands of
    the level before, and those that sleep and that nothing wakes.
    """
    count = 0
    for i in range(moving):
        body = body_at(world, i)
        if body.done <= now:
            body.island[level], body.alone = i, 1
            body.fastest, body.pull = _fastest(body), world.gravity_size
            set_member(world, count, i)
            count += 1
    while _join_near(world, count, level, duration):
        for a in range(count):
            root = member_at(world, a)
            if body_at(world, root).island[level] == root and body_at(world, root).alone == 0:
                _bound_speeds(world, a, count, level)


@kernel
def _join_near(world, count, level, duration):
    """Join islands of the first `count` members that may meet; return whether there were any."""
    joined = False
    for a in range(count):
        one = body_at(world, member_at(world, a))
        for b in range(a):
            other = body_at(world, member_at(world, b))
            if one.island[level] == other.island[level]:
                continue
            if level > 0 and one.island[level - 1] != other.island[level - 1]:
                continue
            if (_stirs(one) or _stirs(other)) and _may_meet(one, other, duration):
                joined = True
                old = max(one.island[level], other.island[level])
                new = min(one.island[level], other.island[level])
                for k in range(count):
                    body = body_at(world, member_at(world, k))
                    if body.island[level] == old:
                        body.island[level] = new
                one.alone = other.alone = 0
    return joined


@fast_inlined
def _stirs(body):
    """Whether a body is awake or may be woken: an island of several has one that is awake."""
    return body.asleep == 0 or body.alone == 0


@fast_inlined
def _may_meet(one, other, duration):
    """Whether two bodies may meet within `duration` (s), whatever they hit on their way."""
    way = duration * (one.fastest + other.fastest + 0.5 * duration * (one.pull + other.pull))
    reach = one.reach + other.reach + MARGIN + way
    apart = sub(load(one.position), load(other.position))
    return dot(apart, apart) < reach * reach


@fast_inlined
def _may_reach(body, box, duration):
    """Whether a body may meet a static box within `duration` (s), whatever else it hits."""
    fastest = max(body.fastest, _fastest(body))
    way = duration * (fastest + 0.5 * duration * body.pull)
    reach = body.reach + box.reach + MARGIN + way
    apart = sub(load(body.position), load(box.position))
    return dot(apart, apart) < reach * reach


@fast_inlined
def _fastest(body):
    """A bound (m/s) of the speed that a body by itself has, and of what its spin can turn into."""
    return norm(load(body.velocity)) + body.reach * norm(load(body.spin))


@kernel
def _bound_speeds(world, first, count, level):
    """Bound the speeds of an island's bodies, which may pass on all their energy to one of them.

    They are among the members from `first` to `count` (exclusive), and the first is one of them.
    """
    root = member_at(world, first)
    energy, mass = 0.0, 0.0
    for a in range(first, count):
        body = body_at(world, member_at(world, a))
        if body.island[level] == root:
            velocity = load(body.velocity)
            energy += 0.5 * dot(velocity, velocity) / body.inverse_mass
            energy += 0.5 * dot(load(body.spin), angular_momentum(body))
            mass += 1.0 / body.inverse_mass
    for a in range(first, count):
        body = body_at(world, member_at(world, a))
        if body.island[level] == root:
            body.fastest = sqrt(2.0 * energy * body.inverse_mass)
            if body.off_centre == 1:
                x, y, z = load(body.own_inverse_inertia)
                turning = sqrt(2.0 * energy * max(x, y, z))
                body.fastest += turning * norm(load(body.centre_offset))
            body.pull = world.gravity_size * sqrt(mass * body.inverse_mass)


@kernel
def _carry_islands(world, moving, level, now, count, step, threshold):
    """Carry what is an island of its own, or one of spheres, over `count` steps.

    Returns whether that is all.
    """
    everything = True
    for i in range(moving):
        body = body_at(world, i)
        if body.done > now:
            everything = everything and body.done >= now + count
        elif body.alone == 1 and (body.asleep == 1 or body.exact == 0):
            body.done = now + count
            if body.asleep == 0:
                _carry_alone(world, moving, i, now, count, step, threshold)
        elif body.island[level] == i and _gather_spheres(world, moving, i, level, now):
            for a in range(world.followed_count):
                body_at(world, followed_at(world, a)).done = now + count
            follow(world, now * step, (now + count) * step)
        else:
            everything = False
    return everything


@kernel
def _gather_spheres(world, moving, root, level, now):
    """Let the bodies of an island be followed, if all are spheres in closed form; whether so."""
    count = 0
    for i in range(root, moving):
        body = body_at(world, i)
        if body.island[level] == root and body.done <= now:
            if body.exact == 0:
                return False
            set_followed(world, count, i)
            count += 1
    world.followed_count = count
    return True


@kernel
def _carry_alone(world, moving, i, first, count, step, threshold):
    """Carry body i, near which no other moves, over `count` steps from step `first` on."""
    body = body_at(world, i)
    done, advance = 0, count
    while done < count and world.status == OK and body.asleep == 0:
        stop_if_asked(world)
        start = (first + done) * step
        advance = min(advance, count - done) if _may_advance_many(world, body) else 1
        if advance == 1:
            _step_alone(world, moving, i, start, step, threshold)
            done += 1
            advance = 2
        elif _advance_many(world, moving, i, start, step, advance):
            done += advance
            advance *= 2
        else:
            advance //= 2


@fast_inlined
def _may_advance_many(world, body):
    """Whether it is worth asking: contact forces stay as they are on a capsule that rolls."""
    if body.drag != 0.0 or body.magnus != 0.0:
        return False
    if body.pressed == 0:
        return body.round == 1
    return body.kind == CAPSULE and world.closed_forms == 1


@kernel
def _advance_many(world, moving, i, start, step, steps):
    """Carry a body over several steps at once, if they are alike; return whether they are."""
    for j in range(moving, world.body_count):
        if _may_reach(body_at(world, i), body_at(world, j), step * steps):
            return False
    return step_lone_body(world, i, start, step, steps)


@kernel
def _step_alone(world, moving, i, start, step, threshold):
    """Step body i, near which no other moves."""
    set_member(world, 0, i)
    members = _add_static(world, moving, 1, step)
    if members == 1 and step_lone_body(world, i, start, step, 1):
        body_at(world, i).asleep = _rested(body_at(world, i))
    else:
        step_island(world, 1, members, start, step, threshold)


@kernel
def _step_islands(world, moving, now, step, threshold):
    """Step all islands of several bodies."""
    level, start = LEVELS - 1, now * step
    for root in range(moving):
        body = body_at(world, root)
        if body.done > now or body.island[level] != root:
            continue
        count = 0
        for i in range(root, moving):
            if body_at(world, i).island[level] == root and body_at(world, i).done <= now:
                set_member(world, count, i)
                count += 1
                body_at(world, i).followed = 0
                if body_at(world, i).asleep == 1:
                    write_rest(world, i, start)
        members = _add_static(world, moving, count, step)
        step_island(world, count, members, start, step, threshold)


@kernel
def _add_static(world, moving, count, step):
    """Add static boxes near the first `count` members; return how many members there are then."""
    members = count
    for j in range(moving, world.body_count):
        for a in range(count):
            if _may_reach(body_at(world, member_at(world, a)), body_at(world, j), step):
                set_member(world, members, j)
                members += 1
                break
    return members


@fast_inlined
def _rested(body):
    """Whether a lone body has stood still on a plane all through its step."""
    speed = _fastest(body) + norm(load(body.start_velocity)) + norm(load(body.start_spin))
    return body.pressed == 1 and speed == 0.0
