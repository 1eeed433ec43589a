"""Spheres and capsules in contact with one plane, and nothing else near: motion in closed form.

The normal of a sphere passes through its centre, so that the impulses that `solver` searches can be
written down, in rolling and in sliding contact.

A capsule touches the plane at both ends of its axis. Where neither slips, they can be written down
as well: static friction ends all motion along the axis a and about the normal n; about b = n × a
the ends close their gaps; and about a the angular momentum about the line of contact is kept, which
only rolling friction lowers.

Where the forces stay the same from step to step, several steps are taken as one. So do those on
what rolls or slides on a level plane.
"""

from __future__ import annotations

from intuitive_physics.geometry.vectors import (
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    sub,
    tangential,
)
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.world import column
from intuitive_physics.simulation.stepped.collision import MARGIN, OVERLAP
from intuitive_physics.simulation.stepped.contacts import STEADY, STICK_SPEED
from intuitive_physics.simulation.stepped.motion import is_still
from intuitive_physics.simulation.world_batch import CAPSULE
from intuitive_physics.simulation.world_record import DYNAMIC, ROLLING, STATIC, coefficient

SETTLED = 1e-9
"""m and m/s. Gaps and speeds that a step has closed or ended are smaller, but for rounding."""

LEVEL = 1e-9
"""Of gravity. On a plane along which it pulls more, what rolls may change its heading."""


@kernel
def sphere_after(world, body, plane, step, steps):
    """Motion of a sphere on a plane after one step, or several whose forces are the same.

    Returns
    -------
    holds : whether the contact lasts and its mode is the same in all steps
    velocity, spin : m/s and rad/s after the steps, if it does
    """
    n, duration = load(plane.normal), step * steps
    velocity, spin = load(body.velocity), load(body.spin)
    gap = dot(n, load(body.position)) - plane.offset - body.radius
    speed = dot(n, velocity)
    if abs(speed) > STEADY * step * world.gravity_size:
        return False, velocity, spin
    if steps > 1 and not (max(abs(speed), gap) <= SETTLED and is_level(world, n)):
        return False, velocity, spin
    falling = add_scaled(velocity, load(world.gravity), duration)
    leaving = -max(gap, 0.0) / duration
    normal_impulse = (leaving - dot(n, falling)) / body.inverse_mass
    if normal_impulse <= 0.0:
        return False, velocity, spin
    sliding = tangential(falling, n)
    slip = norm(_slip(body, n, tangential(velocity, n), spin))
    a, b = body.material, plane.material
    if slip < STICK_SPEED:
        arm = coefficient(world, ROLLING, a, b) * body.radius
        after, turning = _rolled(body, n, sliding, spin, arm * normal_impulse)
        grip = norm(sub(after, sliding))
        if grip > coefficient(world, STATIC, a, b) * normal_impulse * body.inverse_mass:
            return False, velocity, spin
        if steps > 1 and (slip > SETTLED or _stops(body, n, spin, after, turning)):
            return False, velocity, spin
    else:
        grip = coefficient(world, DYNAMIC, a, b) * normal_impulse
        after, turning = _slid(body, n, sliding, spin, grip)
        if steps > 1 and norm(_slip(body, n, after, turning)) < STICK_SPEED:
            return False, velocity, spin
    return True, add_scaled(after, n, leaving), turning


@fast_inlined
def _stops(body, n, spin, after, turning):
    """Whether rolling, or turning about the normal, comes to its end within the steps."""
    if is_still(body, after, turning):
        return True
    return dot(turning, n) == 0.0 and dot(spin, n) != 0.0


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

    Returns
    -------
    holds : whether both ends stay in contact and neither slips
    velocity, spin : m/s and rad/s after the steps, if it does
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
    if steps > 1 and is_still(body, after, turning_after):
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
