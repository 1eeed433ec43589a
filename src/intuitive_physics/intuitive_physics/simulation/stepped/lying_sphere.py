"""A step, or several at once, of a sphere that lies on one plane, with nothing else near.

Its normal passes through its centre, so that the impulses that `solver` searches can be written
down, rolling and sliding.
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
    sub,
    tangential,
)
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.stepped.contacts import STEADY, STICK_SPEED
from intuitive_physics.simulation.stepped.leaps import SETTLED, is_level
from intuitive_physics.simulation.stepped.sleep import is_still
from intuitive_physics.simulation.world_record import DYNAMIC, ROLLING, STATIC, coefficient


@kernel
def press_sphere(world, body, plane, step, steps):
    """Give the sphere the velocities that it has so many steps later; False where it may do else.

    Over more than one step its forces must be the same in each.
    """
    n, duration = load(plane.normal), step * steps
    velocity, spin = load(body.velocity), load(body.spin)
    gap = dot(n, load(body.position)) - plane.offset - body.radius
    speed = dot(n, velocity)
    if abs(speed) > STEADY * step * world.gravity_size:
        return False
    if steps > 1 and not (max(abs(speed), gap) <= SETTLED and is_level(world, n)):
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
        if steps > 1 and (slip > SETTLED or _stops(body, n, spin, after, turning)):
            return False
    else:
        grip = coefficient(world, DYNAMIC, a, b) * normal_impulse
        after, turning = _slid(body, n, sliding, spin, grip)
        if steps > 1 and norm(_slip(body, n, after, turning)) < STICK_SPEED:
            return False
    store(body.velocity, add_scaled(after, n, leaving))
    store(body.spin, turning)
    return True


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
