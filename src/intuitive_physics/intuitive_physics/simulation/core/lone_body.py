"""A body with nothing near but one plane: in flight, or in contact with it, in closed form.

A capsule touches the plane at both ends of its axis. Where neither slips, the impulses that
`solver` searches can be written down: static friction ends all motion along the axis a and about
the normal n; about b = n × a the ends close their gaps; and about a the angular momentum about the
line of contact is kept, which only rolling friction lowers.

Where the forces stay the same from step to step, several steps are taken as one. So do those on
what rolls on a level plane.
"""

from __future__ import annotations

from intuitive_physics.geometry.vectors import (
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    store,
    tangential,
)
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.poses import rotate, support
from intuitive_physics.simulation.rigid_bodies.world import body_at, column, plane_at
from intuitive_physics.simulation.stepped.collision import MARGIN, OVERLAP
from intuitive_physics.simulation.stepped.contacts import STEADY, STICK_SPEED
from intuitive_physics.simulation.stepped.motion import (
    LARGEST_TURN,
    begin,
    finish,
    place,
    plan_flight,
    plan_pressed,
    turned_by,
    write_outputs,
)
from intuitive_physics.simulation.world_batch import CAPSULE, SPHERE
from intuitive_physics.simulation.world_record import ROLLING, STATIC, coefficient

SETTLED = 1e-9
"""m and m/s. Gaps and speeds that a step has closed or ended are smaller, but for rounding."""

LEVEL = 1e-9
"""Part of gravity along a plane above which a rolling body may change its heading."""


@kernel
def capsule_lies_on(body, plane):
    """Whether a body is a capsule of which both ends touch a plane."""
    if body.kind != CAPSULE or body.off_centre == 1 or body.inertia[0] != body.inertia[1]:
        return False
    lower, higher = _gaps(body, plane)
    return min(lower, higher) >= -OVERLAP and max(lower, higher) <= MARGIN


@fast_inlined
def _gaps(body, plane):
    """Gaps (m) below the ends of the axis, against it and along it."""
    n = load(plane.normal)
    middle = dot(n, load(body.position)) - plane.offset - body.radius
    rise = body.half_extents[2] * dot(n, column(body.rotation, 2))
    return middle - rise, middle + rise


@kernel
def capsule_after(world, body, plane, step, steps):
    """Motion of a capsule that rolls on a plane after one step, or several with the same forces.

    Returns whether both ends stay in contact and neither slips, and, if so, velocity (m/s) and spin
    (rad/s) after the steps.
    """
    duration = step * steps
    velocity, spin = load(body.velocity), load(body.spin)
    n, axis = load(plane.normal), column(body.rotation, 2)
    side = cross(n, axis)
    side = scaled(side, 1.0 / norm(side))
    if not _keeps(world, body, n, axis, side, step, steps):
        return False, velocity, spin
    r, half = body.radius, body.half_extents[2]
    falling = add_scaled(velocity, load(world.gravity), duration)
    mass, across, about = 1.0 / body.inverse_mass, body.inertia[0], body.inertia[2]

    lower, higher = _gaps(body, plane)
    if steps > 1 and not (max(lower, higher) <= SETTLED and is_level(world, n)):
        return False, velocity, spin
    closing, other = -max(lower, 0.0) / duration, -max(higher, 0.0) / duration
    leaving, tilting = 0.5 * (closing + other), 0.5 * (closing - other) / half
    pressing = mass * (leaving - dot(n, falling))
    holding = -mass * dot(cross(side, n), falling)
    # What presses one end more than the other: tilting, and friction along the axis below it.
    uneven = (across * (tilting - dot(side, spin)) + r * holding) / half
    least = 0.5 * (pressing - abs(uneven))
    if least <= 0.0:
        return False, velocity, spin

    a, b = body.material, plane.material
    momentum = about * dot(axis, spin) - mass * r * dot(side, falling)
    size, limit = abs(momentum), coefficient(world, ROLLING, a, b) * r * pressing
    left = 1.0 - limit / size if size > limit else 0.0
    rolling = left * momentum / (about + mass * r * r)
    forward = -r * rolling
    turning = abs(across * dot(cross(axis, side), spin)) / half
    grip = abs(mass * (forward - dot(side, falling))) + turning
    held = 2.0 * coefficient(world, STATIC, a, b) * least
    if holding * holding + grip * grip > held * held:
        return False, velocity, spin
    after = add_scaled(scaled(n, leaving), side, forward)
    turning_after = add_scaled(scaled(axis, rolling), side, tilting)
    if steps > 1 and left == 0.0:
        return False, velocity, spin
    return True, after, turning_after


@fast_inlined
def _keeps(world, body, n, axis, side, step, steps):
    """Whether both ends neither slip nor part nor close."""
    velocity, spin, half = load(body.velocity), load(body.spin), body.half_extents[2]
    sliding = tangential(add_scaled(velocity, cross(n, spin), body.radius), n)
    tilting, pivoting = half * abs(dot(side, spin)), half * abs(dot(cross(axis, side), spin))
    play, slip = STEADY * step * world.gravity_size, STICK_SPEED
    if steps > 1:
        play = slip = SETTLED
    return abs(dot(n, velocity)) + tilting <= play and norm(sliding) + pivoting < slip


@fast_inlined
def is_level(world, n):
    """Whether gravity pulls along a plane's normal n alone."""
    return norm(tangential(load(world.gravity), n)) <= LEVEL * world.gravity_size


FLIES, MEETS_MORE = -1, -2
"""In place of the index of the one plane that a body touches."""


@kernel
def step_lone_body(world, i, start, step, steps):
    """Carry body i, near which no other body is, from time `start` (s) on over `steps` steps.

    Returns False, with nothing changed, where more may happen than flight or a stay on a plane, or
    where several steps would not be as one.
    """
    body, duration = body_at(world, i), step * steps
    p = _plane_below(world, body, duration)
    if p == MEETS_MORE or body.drag != 0.0 or body.magnus != 0.0:
        return False
    if p == FLIES and body.round == 0 and not (steps == 1 and _turns_slowly(body, step)):
        return False
    begin(body)
    if p == FLIES:
        plan_flight(world, body, duration)
    else:
        holds, velocity, spin = capsule_after(world, body, plane_at(world, p), step, steps)
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
        rotate(body, body.start_orientation, turned_by(body, duration))
    return True


@fast_inlined
def _turns_slowly(body, step):
    return norm(load(body.spin)) * step <= LARGEST_TURN


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
            fall = -duration * min(0.0, closing)
            if gap < fall and body.kind != SPHERE:
                gap, turning = height - support(body, n), _turning_way(body, duration)
            flies_free = flies_free and gap > fall + turning
        elif touched == FLIES and world.closed_forms == 1 and capsule_lies_on(body, plane):
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
