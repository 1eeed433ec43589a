"""A step, or several at once, of a capsule that rolls on one plane with nothing else near.

It touches the plane at both ends of its axis. Where neither slips, the impulses that `solver`
searches can be written down: static friction ends all motion along the axis a and about the normal
n; about b = n × a the ends close their gaps; and about a the angular momentum about the line of
contact is kept, which only rolling friction lowers.
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
from intuitive_physics.simulation.stepped.collision import MARGIN, OVERLAP
from intuitive_physics.simulation.stepped.contacts import STEADY, STICK_SPEED
from intuitive_physics.simulation.stepped.leaps import SETTLED, is_level
from intuitive_physics.simulation.stepped.sleep import is_still
from intuitive_physics.simulation.stepped.world import column
from intuitive_physics.simulation.world_batch import CAPSULE
from intuitive_physics.simulation.world_record import ROLLING, STATIC, coefficient


@kernel
def lies_on(body, plane):
    """Whether a body is a capsule of which both ends touch a plane."""
    if body.kind != CAPSULE or body.lopsided == 1 or body.inertia[0] != body.inertia[1]:
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
def roll_lying(world, body, plane, step, steps):
    """Give the capsule the velocities that it has so many steps later; False where it may do else.

    Over more than one step its forces must be the same in each.
    """
    duration = step * steps
    n, axis = load(plane.normal), column(body.rotation, 2)
    side = cross(n, axis)
    side = scaled(side, 1.0 / norm(side))
    if not _keeps(world, body, n, axis, side, step, steps):
        return False
    r, half, spin = body.radius, body.half_extents[2], load(body.spin)
    falling = add_scaled(load(body.velocity), load(world.gravity), duration)
    mass, across, about = 1.0 / body.inverse_mass, body.inertia[0], body.inertia[2]

    lower, higher = _gaps(body, plane)
    if steps > 1 and not (max(lower, higher) <= SETTLED and is_level(world, n)):
        return False
    closing, other = -max(lower, 0.0) / duration, -max(higher, 0.0) / duration
    leaving, tilting = 0.5 * (closing + other), 0.5 * (closing - other) / half
    pressing = mass * (leaving - dot(n, falling))
    holding = -mass * dot(cross(side, n), falling)
    # What presses one end more than the other: tilting, and friction along the axis below it.
    uneven = (across * (tilting - dot(side, spin)) + r * holding) / half
    least = 0.5 * (pressing - abs(uneven))
    if least <= 0.0:
        return False

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
        return False
    after = add_scaled(scaled(n, leaving), side, forward)
    turning_after = add_scaled(scaled(axis, rolling), side, tilting)
    if steps > 1 and is_still(body, after, turning_after):
        return False
    store(body.velocity, after)
    store(body.spin, turning_after)
    return True


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
