"""A step of a body that meets nothing, or of a sphere or a lying capsule that stays on one plane.

These are most of all steps. They do what the general way (`parts`) does with few contacts or none;
but for a sphere, whose normal passes through its centre, the impulses that `solver` searches can
be written down, as they can for a capsule that rolls (`lying_capsule`).
"""

from __future__ import annotations

from intuitive_physics.simulation.kernels import fast_inlined, kernel
from intuitive_physics.simulation.stepped.collision import MARGIN, OVERLAP
from intuitive_physics.simulation.stepped.contacts import STEADY, STICK_SPEED
from intuitive_physics.simulation.stepped.lying_capsule import lies_on, roll_lying
from intuitive_physics.simulation.stepped.motion import (
    begin,
    finish,
    place,
    plan_flight,
    plan_pressed,
    write_outputs,
)
from intuitive_physics.simulation.stepped.poses import rotate
from intuitive_physics.simulation.stepped.world import (
    DYNAMIC,
    ROLLING,
    STATIC,
    body_at,
    coefficient,
    plane_at,
)
from intuitive_physics.simulation.vectors import (
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    store,
    sub,
    tangential,
)
from intuitive_physics.simulation.world_batch import CAPSULE, SPHERE

FLIES, MEETS_MORE = -1, -2


@kernel
def step_lone_body(world, i, start, duration):
    """Step body i, near which no other body is, from time `start` (s) on.

    Returns
    -------
    False, with nothing changed, where more may happen than flight or a stay on a plane.
    """
    body = body_at(world, i)
    p = _plane_below(world, body, duration)
    if p == MEETS_MORE or body.drag != 0.0 or body.magnus != 0.0:
        return False
    begin(body)
    if p == FLIES:
        plan_flight(world, body, duration)
    elif _press(world, body, plane_at(world, p), duration):
        body.pressed = body.steady = 1
        plan_pressed(body, duration)
    else:
        return False
    body.kept = 0
    write_outputs(world, i, start, duration)
    place(body, duration)
    finish(body, duration)
    if body.kind == SPHERE and world.orientations != 0:
        rotate(body, body.start_orientation, scaled(load(body.turning), duration))
    return True


@kernel
def _plane_below(world, body, duration):
    """Index of the plane a body lies on, where it can reach no other in a step, or FLIES."""
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
        elif gap > MARGIN:
            stays_free = False
            closing = dot(n, velocity) + 0.5 * duration * min(0.0, dot(n, gravity))
            flies_free = flies_free and gap + duration * min(0.0, closing) > 0.0
        elif touched == FLIES and _lies_on(body, plane, gap):
            touched = p
        else:
            return MEETS_MORE
    free = flies_free if touched == FLIES else stays_free
    return touched if free else MEETS_MORE


@fast_inlined
def _lies_on(body, plane, gap):
    return gap >= -OVERLAP if body.kind == SPHERE else lies_on(body, plane)


@kernel
def _press(world, body, plane, duration):
    """Give the body the velocities that it has after a step on a plane; whether it stays."""
    if body.kind == CAPSULE:
        return roll_lying(world, body, plane, duration)
    return _press_sphere(world, body, plane, duration)


@kernel
def _press_sphere(world, body, plane, duration):
    n = load(plane.normal)
    velocity, spin = load(body.velocity), load(body.spin)
    gap = dot(n, load(body.position)) - plane.offset - body.radius
    speed = dot(n, velocity)
    if abs(speed) > STEADY * duration * world.gravity_size:
        return False
    falling = add_scaled(velocity, load(world.gravity), duration)
    leaving = -max(gap, 0.0) / duration
    normal_impulse = (leaving - dot(n, falling)) / body.inverse_mass
    if normal_impulse <= 0.0:
        return False
    sliding = tangential(falling, n)
    slip = norm(_slip(body, n, tangential(velocity, n), spin))
    a, b = body.material, plane.material
    if slip < STICK_SPEED:
        arm = coefficient(world, ROLLING, a, b) * body.radius
        after, turning = _rolled(body, n, sliding, spin, arm * normal_impulse)
        grip = norm(sub(after, sliding))
        if grip > coefficient(world, STATIC, a, b) * normal_impulse * body.inverse_mass:
            return False
    else:
        grip = coefficient(world, DYNAMIC, a, b) * normal_impulse
        after, turning = _slid(body, n, sliding, spin, grip)
    store(body.velocity, add_scaled(after, n, leaving))
    store(body.spin, turning)
    return True


@fast_inlined
def _slip(body, n, sliding, spin):
    """Velocity of the sphere's material at the plane."""
    return add_scaled(sliding, cross(n, spin), body.radius)


@kernel
def _rolled(body, n, sliding, spin, limit):
    """Velocity along the plane and spin once friction has ended the slip.

    It keeps the angular momentum about the contact, (I + m r²) ω_t = I ω_t' + m r n × v', which
    only rolling friction lowers, by at most `limit` (N m s); as it does the spin about n.
    """
    inertia, mass, r = body.inertia[0], 1.0 / body.inverse_mass, body.radius
    about_contact = inertia + mass * r * r
    momentum = add_scaled(scaled(tangential(spin, n), inertia), cross(n, sliding), mass * r)
    size = norm(momentum)
    left = 1.0 - limit / size if size > limit else 0.0
    rolling = scaled(momentum, left / about_contact)
    pivot, slowing = dot(spin, n), limit / inertia
    pivot -= min(max(pivot, -slowing), slowing)
    return scaled(cross(rolling, n), r), add_scaled(rolling, n, pivot)


@kernel
def _slid(body, n, sliding, spin, limit):
    """Velocity along the plane and spin after friction of at most `limit` (N s)."""
    r, inverse_inertia = body.radius, body.own_inverse_inertia[0]
    slip = _slip(body, n, sliding, spin)
    wanted = norm(slip) / (body.inverse_mass + r * r * inverse_inertia)
    share = min(1.0, limit / wanted) if wanted > 0.0 else 0.0
    impulse = scaled(slip, -share / (body.inverse_mass + r * r * inverse_inertia))
    turned = add_scaled(spin, cross(impulse, n), r * inverse_inertia)
    return add_scaled(sliding, impulse, body.inverse_mass), turned
