"""Which bodies may meet, and carrying them on together.

Bodies that may meet within a step are one island. While no two may, each goes its own way over
several steps, and then they are looked at again.
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import load, norm, sub
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.stepped.collision import MARGIN, are_near
from intuitive_physics.simulation.stepped.leaps import may_leap
from intuitive_physics.simulation.stepped.lone_body import step_lone_body
from intuitive_physics.simulation.stepped.motion import write_rest
from intuitive_physics.simulation.stepped.parts import step_island
from intuitive_physics.simulation.stepped.sleep import put_to_sleep
from intuitive_physics.simulation.stepped.world import body_at, member_at

MOST_STEPS = 32
"""In which bodies go their own ways."""


@kernel
def mark_islands(world, moving, step):
    """Give all bodies that may meet within a step, directly or through others, one number.

    Returns
    -------
    For how many steps the islands hold: more than one only if each body is one of its own.
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
    return _steps_apart(world, moving, step) if alone else 1


@kernel
def _steps_apart(world, moving, step):
    """For how many steps no two bodies can meet, whatever planes and static boxes they hit."""
    least = MOST_STEPS * step
    for i in range(moving):
        one = body_at(world, i)
        for j in range(i):
            other = body_at(world, j)
            if one.asleep == 0 or other.asleep == 0:
                least = min(least, _time_apart(one, other, world.gravity_size))
                if least < 2.0 * step:
                    return 1
    return int(least / step)


@fast_inlined
def _time_apart(one, other, gravity):
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
    done, leap = 0, count
    while done < count:
        start = (first + done) * step
        leap = min(leap, count - done) if may_leap(body) else 1
        if leap == 1:
            if not _step_one(world, moving, root, start, step, threshold):
                write_rest(world, root, (first + count) * step)
                return False
            done += 1
            leap = 2
        elif _leap(world, moving, root, start, step, leap):
            done += leap
            leap *= 2
        else:
            leap //= 2
    return True


@kernel
def _leap(world, moving, root, start, step, steps):
    """Carry a body over so many steps at once, if they are alike; return whether they are."""
    body, duration = body_at(world, root), step * steps
    if _is_by_a_box(world, moving, body, duration):
        return False
    if not step_lone_body(world, root, start, step, steps):
        return False
    body.quiet_steps = 0
    return True


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
            body_at(world, count).member = i
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
                body_at(world, members).member = j
                members += 1
                break
    if members > 1 or not step_lone_body(world, root, start, step, 1):
        step_island(world, count, members, start, step, threshold)
    put_to_sleep(world, count)
    return True
