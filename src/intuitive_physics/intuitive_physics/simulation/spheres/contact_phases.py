"""Transition: the closed-form phases of a sphere on one supporting solid.

With κ = I / (m r²), 2/5 for a solid sphere and 2/3 for a thin shell, g_n the part of gravity that
presses and g_t the part along the surface (both m/s²):

- sliding, slip s = v_t - r ω × n: acceleration g_t - μ_d g_n ŝ, so that
  ds/dt = g_t - (1 + 1/κ) μ_d g_n ŝ;
- rolling, s = 0: acceleration (g_t - μ_r g_n v̂) / (1 + κ), from a rolling torque of μ_r r N, as
  long as κ / (1 + κ) |g_t| ≤ μ_s g_n, so that static friction holds the contact;
- resting: nothing, as long as |g_t| ≤ μ_r g_n.

The spin about the normal decays under the same torque, whatever the phase. Rolling friction does
not act on a contact that slips. On a level plane all directions are constant and the phases exact;
on an incline with a direction that turns, they are cut into short pieces (second order in their
length).

On an edge or a corner the normal turns with the part v_p of the velocity that is not along the
edge. Then g_n is less by v_p²/r, which keeps the centre on its arc, and the contact ends where
nothing of it is left. What drives the slip is g_t less ω_n n × v_p, because ω × n turns too. Such
phases are cut into short pieces as well.
"""

from __future__ import annotations

from math import inf, sqrt

from numba import int64

from intuitive_physics.geometry.vectors import (
    add,
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
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.solids import (
    FACE,
    HALF_SPACE,
    SIDE,
    feature_at,
    solid_at,
)
from intuitive_physics.simulation.rigid_bodies.world import body_at
from intuitive_physics.simulation.spheres.contact_geometry import (
    ON_EDGE,
    ON_FACE,
    arc_pull,
    arc_velocity,
    nearest,
)
from intuitive_physics.simulation.spheres.impacts import contact_slip
from intuitive_physics.simulation.spheres.roots import first_fall_quadratic
from intuitive_physics.simulation.spheres.touching import forget_touched, lift, solid_coefficient
from intuitive_physics.simulation.world_record import DYNAMIC, ROLLING, STATIC

STILL = 1e-7
"""m/s. Slip, speed or r ω below this is none: rounding leaves about 1e-15."""

CURVED_PIECE = 2e-3
"""s. Length of the pieces of a phase whose direction turns."""

SHORTEST_PIECE = 1e-6
"""s. A slip or speed that turns while it is braked is none when it would last no longer."""

PRESSES = 1e-9
"""m/s². An acceleration into a solid below this presses nothing: rounding leaves about 1e-15."""

BRIM = 1e-9
"""m. A contact nearer than this to the end of its face is on the edge."""

TURNING_PIECE = 1e-3
"""s. Pieces of a motion round an edge or corner are no longer …"""

TURNING_ANGLE = 4e-3
"""rad. … and go no further than this."""

SHORTEST_TURNING_PIECE = 2e-5
"""s. Nor are they shorter where slip is about to end, which a turning normal brings back."""

TURNING_STILL = 1e-3
"""m/s. Slip or r ω below this on an edge or corner is none, as in `clusters`."""

PARTED = 1e-12
"""m. Gap to what has just been left, so that rounding does not find it again at once."""

SAME_NORMAL = 1.0 - 1e-12
"""Solids side by side whose normals have at least this cosine support like one."""


@kernel
def contact_with(world, body, s):
    """Contact of a body with solid s as `nearest` has it; one at the end of a face is on an edge.

    What moves over the end of a face is so passed on to the edge.
    """
    solid = solid_at(world, s)
    gap, n, axis, part = nearest(world, solid, load(body.position), body.radius)
    if part == ON_FACE and solid.kind != HALF_SPACE:
        axis, part = _edge_at_brim(world, body, solid, n)
    return gap, n, axis, part


@kernel
def _edge_at_brim(world, body, solid, n):
    """The axis and part of a contact on a face of normal n, which may end there."""
    x, v = load(body.position), load(body.velocity)
    for f in range(solid.first_feature, solid.last_feature):
        side = feature_at(world, f)
        outward = load(side.direction)
        if (side.kind == SIDE or side.kind == FACE) and abs(dot(outward, n)) < 0.5:
            beyond = dot(x, outward) - side.offset
            if beyond > -BRIM and dot(v, outward) >= 0.0:
                return cross(n, outward), ON_EDGE
    return (0.0, 0.0, 0.0), ON_FACE


@kernel
def plan_alone(world, i):
    """Set the accelerations of sphere i and until when they hold, if one solid at most holds it.

    Returns whether they are set; where several solids press they are undefined.
    """
    body = body_at(world, i)
    gravity = load(world.gravity)
    body.phase_end = inf
    body.rounds_edge = 0
    if body.touched_count == 0:
        store(body.acceleration, gravity)
        store(body.spin_acceleration, (0.0, 0.0, 0.0))
        return True
    support, upward, on_face = int64(-1), (0.0, 0.0, 0.0), False
    for k in range(body.touched_count):
        _, n, axis, part = contact_with(world, body, body.touched[k])
        if dot(gravity, n) + arc_pull(load(body.velocity), axis, part, body.radius) < -PRESSES:
            if support >= 0 and dot(upward, n) < SAME_NORMAL:
                return False
            if support < 0 or not on_face:
                support, upward, on_face = body.touched[k], n, part == ON_FACE
    store(body.acceleration, gravity)
    store(body.spin_acceleration, (0.0, 0.0, 0.0))
    if support >= 0:
        _plan_on_solid(world, i, support)
    if _presses_on_others(world, body, support, upward):
        return False
    _leave_edges(world, body, support)
    return True


@kernel
def _presses_on_others(world, body, support, upward):
    """Whether a planned motion presses against more than its support."""
    for k in range(body.touched_count):
        s = body.touched[k]
        if s != support:
            _, n, axis, part = contact_with(world, body, s)
            beside = support >= 0 and dot(upward, n) >= SAME_NORMAL
            if not beside and _parting(body, n, axis, part) < -PRESSES:
                return True
    return False


@kernel
def _leave_edges(world, body, support):
    """End the contacts with edges and corners, other than the support, that the motion leaves."""
    for k in range(body.touched_count - 1, -1, -1):
        s = body.touched[k]
        if s != support:
            gap, n, axis, part = contact_with(world, body, s)
            if part != ON_FACE and _parting(body, n, axis, part) > PRESSES:
                lift(body, n, gap - PARTED)
                store(body.velocity, tangential(load(body.velocity), n))
                forget_touched(body, k)


@kernel
def _parting(body, n, axis, part):
    """Acceleration (m/s²) at which a planned motion leaves a contact, below zero if it presses."""
    pull = arc_pull(load(body.velocity), axis, part, body.radius)
    return dot(load(body.acceleration), n) + pull


@kernel
def _plan_on_solid(world, i, s):
    body = body_at(world, i)
    _, n, axis, part = contact_with(world, body, s)
    pressing = _plan_on_contact(world, i, s, n, axis, part)
    if part != ON_FACE:
        _plan_turning(world, i, s, pressing)
    elif solid_at(world, s).kind != HALF_SPACE:
        body.phase_end = min(body.phase_end, body.time + _time_on_face(world, body, s, n))


@kernel
def _time_on_face(world, body, s, n):
    """How long (s) the contact of a planned motion stays on the face of normal n."""
    x, v, a = load(body.position), load(body.velocity), load(body.acceleration)
    solid = solid_at(world, s)
    least = inf
    for f in range(solid.first_feature, solid.last_feature):
        side = feature_at(world, f)
        outward = load(side.direction)
        if (side.kind == SIDE or side.kind == FACE) and abs(dot(outward, n)) < 0.5:
            inside = max(0.0, side.offset - dot(x, outward))
            tau = first_fall_quadratic(inside, -dot(v, outward), -dot(a, outward))
            least = min(least, tau)
    return least


@kernel
def _plan_turning(world, i, s, pressing):
    """Replace planned accelerations on an edge or corner by those in the middle of a short piece.

    The midpoint rule: second order in the length of the piece. Afterwards the sphere is put back
    on its arc. A piece ends where what presses (m/s²), linear in time, will be gone.
    """
    body = body_at(world, i)
    v, a = load(body.velocity), load(body.acceleration)
    if norm(v) == 0.0 and norm(a) == 0.0:
        return
    body.rounds_edge = 1
    h = min(TURNING_PIECE, body.phase_end - body.time)
    h = max(h, SHORTEST_TURNING_PIECE)
    h = min(h, TURNING_ANGLE * body.radius / max(norm(v), STILL))
    alpha = load(body.spin_acceleration)
    in_middle = _plan_middle(world, i, s, h, a, alpha)
    lost = 2.0 * (pressing - in_middle)
    if lost > pressing and h > SHORTEST_PIECE:
        h = max(SHORTEST_PIECE, h * pressing / lost)
        _plan_middle(world, i, s, h, a, alpha)
    a = load(body.acceleration)
    end = add_scaled(add_scaled(load(body.position), v, h), a, 0.5 * h * h)
    _, n, _, _ = nearest(world, solid_at(world, s), end, body.radius)
    store(body.end_velocity, tangential(add_scaled(v, a, h), n))
    body.phase_end = body.time + h


@kernel
def _plan_middle(world, i, s, h, a, alpha):
    """Plan as in the middle of h seconds under the accelerations a and α; return what presses."""
    body = body_at(world, i)
    x, v, spin = load(body.position), load(body.velocity), load(body.spin)
    half = 0.5 * h
    middle = add_scaled(add_scaled(x, v, half), a, 0.5 * half * half)
    gap, n, axis, part = nearest(world, solid_at(world, s), middle, body.radius)
    store(body.position, add_scaled(middle, n, -gap))
    store(body.velocity, tangential(add_scaled(v, a, half), n))
    store(body.spin, add_scaled(spin, alpha, half))
    pressing = _plan_on_contact(world, i, s, n, axis, part)
    store(body.position, x)
    store(body.velocity, v)
    store(body.spin, spin)
    return pressing


@kernel
def _plan_on_contact(world, i, s, n, axis, part):
    """Set the accelerations of sphere i on a contact with solid s; return what presses, m/s²."""
    body = body_at(world, i)
    gravity = load(world.gravity)
    across = arc_velocity(load(body.velocity), axis, part)
    falling = dot(gravity, n)
    pressing = max(0.0, -falling - dot(across, across) / body.radius)
    twist = scaled(cross(n, across), dot(load(body.spin), n))
    along = sub(add_scaled(gravity, n, -falling), twist)
    grip = solid_coefficient(world, STATIC, i, s) * pressing
    braking = solid_coefficient(world, DYNAMIC, i, s) * pressing
    resistance = solid_coefficient(world, ROLLING, i, s) * pressing
    body.phase_end = inf
    still = STILL if part == ON_FACE else TURNING_STILL
    pivoting = _plan_pivot(body, n, body.spin_gain * resistance, still)
    slip = contact_slip(body, n)
    if norm(slip) > max(_still(along, body.slip_gain * braking), still):
        _plan_sliding(body, n, along, braking, slip, pivoting)
    elif (1.0 - body.rolling_share) * norm(along) > grip:
        about_to_slip = scaled(along, STILL / norm(along))
        _plan_sliding(body, n, along, braking, about_to_slip, pivoting)
    else:
        _plan_rolling(body, n, along, grip, resistance, pivoting)
    if part != ON_FACE and (norm(load(body.velocity)) > 0.0 or norm(load(body.acceleration)) > 0.0):
        turning = add_scaled(twist, n, falling + pressing)
        store(body.acceleration, add(load(body.acceleration), turning))
    return pressing


@kernel
def _plan_rolling(body, n, along, grip, resistance, pivoting):
    rolling = tangential(load(body.velocity), n)
    heading = rolling
    if norm(rolling) <= _still(along, resistance):
        rolling, heading = (0.0, 0.0, 0.0), along
    share = body.rolling_share
    resistance = min(resistance, _bearable_resistance(share, along, heading, grip))
    acceleration = (0.0, 0.0, 0.0)
    duration = inf
    if norm(rolling) > 0.0 or norm(along) > resistance:
        drive = scaled(along, share)
        direction, duration = _braking(rolling, heading, drive, share * resistance)
        acceleration = add_scaled(drive, direction, -share * resistance)
    body.phase_end = min(body.phase_end, body.time + duration)
    pivot = scaled(n, dot(load(body.spin), n))
    store(body.velocity, rolling)
    store(body.spin, add_scaled(pivot, cross(n, rolling), 1.0 / body.radius))
    store(body.acceleration, acceleration)
    turning = add_scaled(pivoting, cross(n, acceleration), 1.0 / body.radius)
    store(body.spin_acceleration, turning)


@kernel
def _bearable_resistance(share, along, heading, grip):
    """The resistance k at which the friction that rolling needs reaches what the contact grips.

    That friction is -((1 - q) g_t + q k û) with the share q = 1 / (1 + κ): a contact that grips too
    little for the whole rolling torque passes on only the part it can.
    """
    length = norm(heading)
    if length == 0.0:
        return grip / share
    drive = scaled(along, 1.0 - share)
    b = dot(drive, heading) / length
    return (sqrt(max(b * b + grip * grip - dot(drive, drive), 0.0)) - b) / share


@kernel
def _plan_pivot(body, n, resistance, still):
    """Return the deceleration of the spin about n, ending the phase when that spin is gone.

    It is none where the rim goes slower than `still` (m/s).
    """
    spin = load(body.spin)
    pivot = dot(spin, n)
    rim_speed = abs(pivot) * body.radius
    if rim_speed <= still:
        store(body.spin, add_scaled(spin, n, -pivot))
        return 0.0, 0.0, 0.0
    if resistance <= 0.0:
        return 0.0, 0.0, 0.0
    body.phase_end = body.time + rim_speed / resistance
    sense = -1.0 if pivot > 0.0 else 1.0
    return scaled(n, sense * resistance / body.radius)


@kernel
def _plan_sliding(body, n, along, braking, slip, pivoting):
    direction, duration = _braking(slip, slip, along, body.slip_gain * braking)
    friction = scaled(direction, -braking)
    body.phase_end = min(body.phase_end, body.time + duration)
    store(body.acceleration, add(along, friction))
    turning = add_scaled(pivoting, cross(n, friction), -body.spin_gain / body.radius)
    store(body.spin_acceleration, turning)


@kernel
def _still(drive, brake):
    """Speed below which du/dt = drive - brake û has come to its end."""
    pull = norm(drive)
    return STILL if pull == 0.0 else max(STILL, SHORTEST_PIECE * (pull + brake))


@kernel
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
