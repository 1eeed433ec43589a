"""A body that meets nothing, or a sphere or a capsule in rolling contact that stays on one plane.

Most of all steps are theirs. They do what the general way (`parts`) does with few contacts or none;
but on a plane `rolling_contact` has the impulses that `solver` searches in closed form, and where
they stay the same, several steps are one multi-step advance.
"""

from __future__ import annotations

from intuitive_physics.geometry.vectors import dot, load, norm, scaled, store
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.poses import rotate, support
from intuitive_physics.simulation.rigid_bodies.world import body_at, plane_at
from intuitive_physics.simulation.stepped.collision import MARGIN, OVERLAP
from intuitive_physics.simulation.stepped.motion import (
    begin,
    finish,
    place,
    plan_flight,
    plan_pressed,
    write_outputs,
)
from intuitive_physics.simulation.stepped.rolling_contact import (
    capsule_after,
    capsule_lies_on,
    sphere_after,
)
from intuitive_physics.simulation.world_batch import CAPSULE, SPHERE

FLIES, MEETS_MORE = -1, -2
"""In place of the index of the one plane that a body touches."""


@kernel
def step_lone_body(world, i, start, step, steps):
    """Carry body i, near which no other body is, from time `start` (s) on over `steps` steps.

    Returns
    -------
    False, with nothing changed, where more may happen than flight or a stay on a plane; or where
    several steps would not be as one.
    """
    body, duration = body_at(world, i), step * steps
    p = _plane_below(world, body, duration)
    if p == MEETS_MORE or body.drag != 0.0 or body.magnus != 0.0:
        return False
    if p == FLIES and steps > 1 and body.round == 0:
        return False
    begin(body)
    if p == FLIES:
        plan_flight(world, body, duration)
    else:
        holds, velocity, spin = _after(world, body, plane_at(world, p), step, steps)
        if not holds:
            return False
        store(body.velocity, velocity)
        store(body.spin, spin)
        body.pressed = body.steady = 1
        plan_pressed(body, duration)
    body.warm_starts = 0
    write_outputs(world, i, start, duration)
    place(body, duration)
    finish(body, duration)
    if body.kind == SPHERE and world.orientations != 0:
        rotate(body, body.start_orientation, scaled(load(body.turning), duration))
    return True


@kernel
def _plane_below(world, body, duration):
    """Index of the plane a body lies on, where it can reach no other meanwhile, or FLIES."""
    position, velocity = load(body.position), load(body.velocity)
    gravity = load(world.gravity)
    way = duration * (norm(velocity) + duration * world.gravity_size) + MARGIN
    touched, flies_free, stays_free = FLIES, True, True
    for p in range(world.plane_count):
        plane = plane_at(world, p)
        n = load(plane.normal)
        height = dot(n, position) - plane.offset
        gap = height - body.reach
        if gap > way:
            continue
        if plane.corners > 0:
            if height > -body.reach - way:
                return MEETS_MORE
            continue
        turning = 0.0
        if body.kind != SPHERE and gap <= MARGIN:
            gap = height - support(body, n)
            turning = _turning_way(body, duration)
        if gap > MARGIN:
            stays_free = False
            closing = dot(n, velocity) + 0.5 * duration * min(0.0, dot(n, gravity))
            flies_free = flies_free and gap + duration * min(0.0, closing) > turning
        elif touched == FLIES and _lies_on(body, plane, gap):
            touched = p
        else:
            return MEETS_MORE
    free = flies_free if touched == FLIES else stays_free
    return touched if free else MEETS_MORE


@fast_inlined
def _turning_way(body, duration):
    """A bound (m) on how far turning moves any point of a body that flies.

    By Euler's equations |dω/dt| ≤ |ω|², so |ω| stays below |ω₀| / (1 - |ω₀| t).
    """
    angle = duration * norm(load(body.spin))
    if angle > 0.5:
        return 2.0 * body.reach
    return body.reach * angle / (1.0 - angle)


@fast_inlined
def _lies_on(body, plane, gap):
    return gap >= -OVERLAP if body.kind == SPHERE else capsule_lies_on(body, plane)


@fast_inlined
def _after(world, body, plane, step, steps):
    """Whether the body stays in contact with the plane, and its velocity and spin afterwards."""
    if body.kind == CAPSULE:
        return capsule_after(world, body, plane, step, steps)
    return sphere_after(world, body, plane, step, steps)
