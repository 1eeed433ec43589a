"""Transition: the closed-form phases of a sphere on one supporting plane.

With g_n the part of gravity that presses and g_t the part along the plane (both m/s²):

- sliding, slip s = v_t - r ω × n: acceleration g_t - μ_d g_n ŝ, so that
  ds/dt = g_t - 7/2 μ_d g_n ŝ;
- rolling, s = 0: acceleration 5/7 (g_t - μ_r g_n v̂), from a rolling torque of μ_r r N, as long as
  2/7 |g_t| ≤ μ_s g_n, so that static friction holds the contact;
- resting: nothing, as long as |g_t| ≤ μ_r g_n.

The spin about the normal decays under the same torque, whatever the phase. Rolling friction does
not act on a contact that slips. On a level plane all directions are constant and the phases exact;
on an incline with a direction that turns, they are cut into short pieces (second order in their
length).
"""

from __future__ import annotations

from math import inf, sqrt

from numba import njit

from intuitive_physics.simulation.event_driven.impacts import plane_slip
from intuitive_physics.simulation.event_driven.world import (
    DYNAMIC,
    ROLLING,
    STATIC,
    plane_coefficient,
)
from intuitive_physics.simulation.vectors import (
    add,
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    store,
    tangential,
)

STILL = 1e-7
"""m/s. Slip, speed or r ω below this is none: rounding leaves about 1e-15."""

CURVED_PIECE = 2e-3
"""s. Length of the pieces of a phase whose direction turns."""

SHORTEST_PIECE = 1e-6
"""s. A slip or speed that turns while it is braked is none when it would last no longer."""

PRESSES = 1e-9
"""m/s². An acceleration into a plane below this presses nothing: rounding leaves about 1e-15."""


@njit(cache=True)
def plan_alone(world, i):
    """Set the accelerations of object i and until when they hold, if one plane at most holds it.

    Returns False, and leaves them undefined, where several planes press.
    """
    body = world.objects[i]
    gravity = load(world.gravity)
    support = -1
    for p in range(world.planes.size):
        if world.touches_plane[i, p] and dot(gravity, load(world.planes[p].normal)) < -PRESSES:
            if support >= 0:
                return False
            support = p
    if support < 0:
        store(body.acceleration, gravity)
        store(body.spin_acceleration, (0.0, 0.0, 0.0))
        body.phase_end = inf
        return True
    _plan_on_plane(world, i, support, gravity)
    acceleration = load(body.acceleration)
    for p in range(world.planes.size):
        if world.touches_plane[i, p] and dot(acceleration, load(world.planes[p].normal)) < -PRESSES:
            return False
    return True


@njit(cache=True)
def _plan_on_plane(world, i, p, gravity):
    body = world.objects[i]
    n = load(world.planes[p].normal)
    pressing = -dot(gravity, n)
    along = tangential(gravity, n)
    grip = plane_coefficient(world, STATIC, i, p) * pressing
    braking = plane_coefficient(world, DYNAMIC, i, p) * pressing
    resistance = plane_coefficient(world, ROLLING, i, p) * pressing
    body.phase_end = inf
    pivoting = _plan_pivot(body, n, 2.5 * resistance)
    slip = plane_slip(body, n)
    if norm(slip) > _still(along, 3.5 * braking):
        _plan_sliding(body, n, along, braking, slip, pivoting)
    elif 2.0 / 7.0 * norm(along) > grip:
        about_to_slip = scaled(along, STILL / norm(along))
        _plan_sliding(body, n, along, braking, about_to_slip, pivoting)
    else:
        _plan_rolling(body, n, along, grip, resistance, pivoting)


@njit(cache=True)
def _plan_rolling(body, n, along, grip, resistance, pivoting):
    rolling = tangential(load(body.velocity), n)
    heading = rolling
    if norm(rolling) <= _still(along, resistance):
        rolling, heading = (0.0, 0.0, 0.0), along
    resistance = min(resistance, _bearable_resistance(along, heading, grip))
    acceleration = (0.0, 0.0, 0.0)
    duration = inf
    if norm(rolling) > 0.0 or norm(along) > resistance:
        drive = scaled(along, 5.0 / 7.0)
        direction, duration = _braking(rolling, heading, drive, 5.0 / 7.0 * resistance)
        acceleration = add_scaled(drive, direction, -5.0 / 7.0 * resistance)
    body.phase_end = min(body.phase_end, body.time + duration)
    pivot = scaled(n, dot(load(body.spin), n))
    store(body.velocity, rolling)
    store(body.spin, add_scaled(pivot, cross(n, rolling), 1.0 / body.radius))
    store(body.acceleration, acceleration)
    turning = add_scaled(pivoting, cross(n, acceleration), 1.0 / body.radius)
    store(body.spin_acceleration, turning)


@njit(cache=True)
def _bearable_resistance(along, heading, grip):
    """The resistance k at which the friction that rolling needs reaches what the contact grips.

    That friction is -(2/7 g_t + 5/7 k û): a contact that grips too little for the whole rolling
    torque passes on only the part it can.
    """
    length = norm(heading)
    if length == 0.0:
        return 1.4 * grip
    drive = scaled(along, 2.0 / 7.0)
    b = dot(drive, heading) / length
    return 1.4 * (sqrt(max(b * b + grip * grip - dot(drive, drive), 0.0)) - b)


@njit(cache=True)
def _plan_pivot(body, n, resistance):
    """Return the deceleration of the spin about n, ending the phase when that spin is gone."""
    spin = load(body.spin)
    pivot = dot(spin, n)
    rim_speed = abs(pivot) * body.radius
    if rim_speed <= STILL:
        store(body.spin, add_scaled(spin, n, -pivot))
        return 0.0, 0.0, 0.0
    if resistance <= 0.0:
        return 0.0, 0.0, 0.0
    body.phase_end = body.time + rim_speed / resistance
    sense = -1.0 if pivot > 0.0 else 1.0
    return scaled(n, sense * resistance / body.radius)


@njit(cache=True)
def _plan_sliding(body, n, along, braking, slip, pivoting):
    direction, duration = _braking(slip, slip, along, 3.5 * braking)
    friction = scaled(direction, -braking)
    body.phase_end = min(body.phase_end, body.time + duration)
    store(body.acceleration, add(along, friction))
    turning = add_scaled(pivoting, cross(n, friction), -2.5 / body.radius)
    store(body.spin_acceleration, turning)


@njit(cache=True)
def _still(drive, brake):
    """Speed below which du/dt = drive - brake û has come to its end."""
    pull = norm(drive)
    return STILL if pull == 0.0 else max(STILL, SHORTEST_PIECE * (pull + brake))


@njit(cache=True)
def _braking(u, heading, drive, brake):
    """Direction and duration of du/dt = drive - brake û, for as long as û may be held constant.

    `heading` stands for u where u is zero: the way it is about to go.
    """
    length = norm(heading)
    if length == 0.0:
        return (0.0, 0.0, 0.0), inf
    direction = scaled(heading, 1.0 / length)
    speed = norm(u)
    push = dot(drive, direction)
    sideways = norm(add_scaled(drive, direction, -push))
    if sideways <= 1e-12 * (1.0 + abs(push)):
        if brake <= push or speed == 0.0:
            return direction, inf
        return direction, speed / (brake - push)
    duration = min(CURVED_PIECE, max(0.1 * speed / (brake + norm(drive)), SHORTEST_PIECE))
    middle = add_scaled(add_scaled(u, drive, 0.5 * duration), direction, -0.5 * duration * brake)
    length = norm(middle)
    if length > 0.0:
        direction = scaled(middle, 1.0 / length)
    return direction, duration
