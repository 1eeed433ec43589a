"""Islands: bodies that may meet within a step, and their motion.

While no two bodies may meet, each is an independent island for several steps, after which islands
are looked for again. An island that is at rest sleeps until something comes near.
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import load, norm, sub
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.world import body_at, member_at, set_member
from intuitive_physics.simulation.rollout import OK
from intuitive_physics.simulation.stepped.collision import MARGIN, are_near
from intuitive_physics.simulation.stepped.lone_body import step_lone_body
from intuitive_physics.simulation.stepped.motion import write_rest
from intuitive_physics.simulation.stepped.parts import step_island
from intuitive_physics.simulation.world_batch import BOX
from intuitive_physics.simulation.world_record import stop_if_asked

MOST_STEPS = 32
"""Maximum steps of independent islands before they are looked for again."""


@kernel
def mark_islands(world, moving, step):
    """Give all bodies that may meet within a step, directly or through others, one number.

    Returns for how many steps the islands hold: more than one only if each body is one of its own.
    """
    fall = step * step * world.gravity_size
    alone = True
    for i in range(moving):
        body_at(world, i).island = i
    for i in range(moving):
        for j in range(i):
            one, other = body_at(world, i), body_at(world, j)
            if (one.asleep == 1 and other.asleep == 1) or one.island == other.island:
                continue
            if are_near(one, other, step, fall):
                alone = False
                old, new = max(one.island, other.island), min(one.island, other.island)
                for k in range(i + 1):
                    if body_at(world, k).island == old:
                        body_at(world, k).island = new
    return _independent_steps(world, moving, step) if alone else 1


@kernel
def _independent_steps(world, moving, step):
    """For how many steps no two bodies can meet, whatever planes and static boxes they hit."""
    least = MOST_STEPS * step
    for i in range(moving):
        one = body_at(world, i)
        for j in range(i):
            other = body_at(world, j)
            if one.asleep == 0 or other.asleep == 0:
                least = min(least, _independent_time(one, other, world.gravity_size))
                if least < 2.0 * step:
                    return 1
    return int(least / step)


@fast_inlined
def _independent_time(one, other, gravity):
    """A time (s) before which two bodies cannot meet: room = v t + g t².

    Each falls g t²/2 at most, and what it hits turns at most the speed of its rim into a speed.
    """
    apart = norm(sub(load(one.position), load(other.position)))
    room = apart - one.reach - other.reach - MARGIN
    speed = _fastest(one) + _fastest(other)
    return 2.0 * room / (speed + sqrt(speed * speed + 4.0 * gravity * room))


@fast_inlined
def _fastest(body):
    return norm(load(body.velocity)) + body.reach * norm(load(body.spin))


@kernel
def carry_island(world, moving, root, first, count, step, threshold):
    """Carry the island of a root over `count` steps from step `first` on; whether it is awake."""
    body = body_at(world, root)
    done, advance = 0, count
    while done < count and world.status == OK:
        stop_if_asked(world)
        start = (first + done) * step
        advance = min(advance, count - done) if _may_advance_many(body) else 1
        if advance == 1:
            if not _step_one(world, moving, root, start, step, threshold):
                write_rest(world, root, (first + count) * step)
                return False
            done += 1
            advance = 2
        elif _advance_many(world, moving, root, start, step, advance):
            done += advance
            advance *= 2
        else:
            advance //= 2
    return True


@fast_inlined
def _may_advance_many(body):
    """Whether it is worth asking: contact forces on a box change from step to step."""
    if body.asleep == 1 or body.drag != 0.0 or body.magnus != 0.0:
        return False
    if body.pressed == 0:
        return body.round == 1
    return body.kind != BOX


@kernel
def _advance_many(world, moving, root, start, step, steps):
    """Carry a body over several steps at once, if they are alike; return whether they are."""
    body, duration = body_at(world, root), step * steps
    if _is_by_a_box(world, moving, body, duration):
        return False
    return step_lone_body(world, root, start, step, steps)


@kernel
def _is_by_a_box(world, moving, body, duration):
    fall = duration * duration * world.gravity_size
    for j in range(moving, world.body_count):
        if are_near(body, body_at(world, j), duration, fall):
            return True
    return False


@kernel
def _step_one(world, moving, root, start, step, threshold):
    """Step the island of a root, if any of it is awake; return whether."""
    count = 0
    awake = False
    for i in range(root, moving):
        if body_at(world, i).island == root:
            set_member(world, count, i)
            count += 1
            awake = awake or body_at(world, i).asleep == 0
    if not awake:
        for a in range(count):
            write_rest(world, member_at(world, a), start + step)
        return False
    members = count
    fall = step * step * world.gravity_size
    for j in range(moving, world.body_count):
        for a in range(count):
            if are_near(body_at(world, member_at(world, a)), body_at(world, j), step, fall):
                set_member(world, members, j)
                members += 1
                break
    if members == 1 and step_lone_body(world, root, start, step, 1):
        body_at(world, root).asleep = _rested(body_at(world, root))
    else:
        step_island(world, count, members, start, step, threshold)
    return True


@fast_inlined
def _rested(body):
    """Whether a lone body has stood still on a plane all through its step."""
    speed = _fastest(body) + norm(load(body.start_velocity)) + norm(load(body.start_spin))
    return body.pressed == 1 and speed == 0.0
