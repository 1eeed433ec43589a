"""When, within a part of a step, something first closes: conservative advancement.

At any time, the separation of two bodies along a direction n that stays is a lower bound of their
later distance. Along n the corners of both go at known speeds and bend by at most their
accelerations and ω² r, so that a time is known before which they cannot meet. From there the
search goes on with the direction of then (Mirtich, 1996). Where two pass each other by at a small
distance such advances are short: then the gap is looked at often enough that between two looks it
cannot fall by more than `SINK` and rise again. So no contact that gets deeper is missed.
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import add_scaled, cross, dot, load, norm, scaled, sub
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.distance import separation
from intuitive_physics.simulation.rigid_bodies.planes import separation_from_plane
from intuitive_physics.simulation.rigid_bodies.poses import centre_of_mass
from intuitive_physics.simulation.rigid_bodies.world import body_at, column, member_at, plane_at
from intuitive_physics.simulation.rollout import TOO_FAST
from intuitive_physics.simulation.stepped.collision import MARGIN, OVERLAP
from intuitive_physics.simulation.stepped.impacts import IMPACT_GAP
from intuitive_physics.simulation.stepped.motion import place
from intuitive_physics.simulation.world_batch import SPHERE

CLOSED = 1e-7
"""m. A gap this small is none."""

SINK = OVERLAP
"""m. How much deeper what presses may get until its contact forces are sought again."""

ADVANCES = 4096
"""Most advances of a pair in a part of a step; one that needs more stops the world, TOO_FAST."""

ITERATIONS = 40
"""Most steps of the search for a root between two advances."""

TANGENTS = 4
"""Tangents and chords by which the time of one advance is found, to some parts in a thousand."""


@kernel
def first_closing(world, moving, members, duration, threshold):
    """Time (s) after the part's start when two bodies that were apart first meet, or its end.

    It is also the time when two that touch have got deeper by `SINK`. What touches and closes
    slower than `threshold` (m/s) presses. The moving bodies' motion is planned; they are left
    anywhere on it.
    """
    first = duration
    for a in range(moving):
        i = member_at(world, a)
        body = body_at(world, i)
        way = _way(body, first)
        for p in range(world.plane_count):
            plane = plane_at(world, p)
            height = dot(load(plane.normal), load(body.start_position)) - plane.offset
            if height > body.reach + way:
                continue
            if body.kind == SPHERE and plane.corners == 0:
                first = _sphere_on_plane(body, plane, first, threshold)
            else:
                first = _of_pair(world, i, -1 - p, first, threshold)
        for b in range(a + 1, members):
            first = _of_pair(world, i, member_at(world, b), first, threshold)
    return first


@kernel
def _sphere_on_plane(body, plane, first, threshold):
    """Root of gap + v t + a t²/2, the later one for a sphere that has just rebounded.

    What presses may get deeper by `SINK` first.
    """
    n = load(plane.normal)
    gap = dot(n, load(body.start_position)) - plane.offset - body.radius
    speed = dot(n, load(body.path_velocity))
    acceleration = dot(n, load(body.path_acceleration))
    room = max(gap, 0.0)
    if speed <= threshold and _is_held(gap, speed, threshold):
        room += SINK
    if room + first * min(0.0, speed + 0.5 * first * min(0.0, acceleration)) > 0.0:
        return first
    under_root = speed * speed - 2.0 * acceleration * room
    if under_root < 0.0:
        return first
    root = sqrt(under_root)
    if speed > 0.0:
        if acceleration >= 0.0:
            return first
        return min(first, -(speed + root) / acceleration)
    if root <= speed:
        return first
    return min(first, 2.0 * room / (root - speed))


@fast_inlined
def _is_held(gap, speed, threshold):
    """Whether forces have been sought that keep a gap from closing, where it opens so fast."""
    return gap <= IMPACT_GAP or (gap <= MARGIN and speed > -threshold)


@kernel
def _of_pair(world, i, j, first, threshold):
    """The time for body i and body j, or plane -1 - j, which are advanced until they meet."""
    if j >= 0 and not _may_meet(world, i, j, first):
        return first
    _place_pair(world, i, j, 0.0)
    gap, n = _separation(world, i, j)
    held = gap <= MARGIN and _is_held(gap, _lower_bound(world, i, j, n, 0.0, 0.0)[1], threshold)
    level = min(gap, 0.0) - SINK if held else 0.0
    shortest, t = 0.0, 0.0
    for _ in range(ADVANCES):
        safe = _safe_time(world, i, j, n, gap - level, t, first)
        if safe >= first:
            return first
        if gap - level <= CLOSED:
            return t
        if shortest == 0.0:
            shortest = _shortest_advance(world, i, j, first)
        before, at_before = t, gap - level
        t = min(max(safe, t + shortest), first)
        _place_pair(world, i, j, t)
        gap, n = _separation(world, i, j)
        if gap < level:
            return _root(world, i, j, level, before, at_before, t, gap - level)
        if t == first:
            return first
        if held and gap > MARGIN:
            held, level = False, 0.0
    world.status = TOO_FAST
    return first


@kernel
def _shortest_advance(world, i, j, first):
    """A time (s) in which a gap that is no shorter at its ends is no more than `SINK` shorter.

    Its second derivative is at most ω² r + 2 ω v + a, and v² / r where the direction of closest
    points turns, as round bodies pass each other.
    """
    one = body_at(world, i)
    velocity, acceleration = load(one.path_velocity), load(one.path_acceleration)
    turning, radius = norm(load(one.turning)), one.radius
    bending = turning * turning * one.reach
    if j >= 0:
        other = body_at(world, j)
        radius += other.radius
        if other.inverse_mass > 0.0:
            velocity = sub(velocity, load(other.path_velocity))
            acceleration = sub(acceleration, load(other.path_acceleration))
            further = norm(load(other.turning))
            turning += further
            bending += further * further * other.reach
    speed = norm(velocity) + first * norm(acceleration)
    bending += 2.0 * turning * speed + norm(acceleration)
    if radius > 0.0:
        bending += speed * speed / radius
    return sqrt(8.0 * SINK / bending) if bending > 0.0 else first


@kernel
def _root(world, i, j, level, low, at_low, high, at_high):
    """When a gap is at `level` (m) between two times (s) at which it is above and below."""
    side = 0
    for _ in range(ITERATIONS):
        t = (low * at_high - high * at_low) / (at_high - at_low)
        _place_pair(world, i, j, t)
        gap = _separation(world, i, j)[0] - level
        if abs(gap) <= CLOSED:
            return t
        # Illinois: an end that stays twice counts half.
        if gap < 0.0:
            at_low = 0.5 * at_low if side == -1 else at_low
            high, at_high, side = t, gap, -1
        else:
            at_high = 0.5 * at_high if side == 1 else at_high
            low, at_low, side = t, gap, 1
    return low


@kernel
def _may_meet(world, i, j, first):
    """Whether the balls in which two bodies turn may meet."""
    one, other = body_at(world, i), body_at(world, j)
    way, start = _way(one, first), load(one.start_position)
    there = load(other.position)
    if other.inverse_mass > 0.0:
        way += _way(other, first)
        there = load(other.start_position)
    return norm(sub(start, there)) <= one.reach + other.reach + way


@fast_inlined
def _place_pair(world, i, j, t):
    place(body_at(world, i), t)
    if j >= 0 and body_at(world, j).inverse_mass > 0.0:
        place(body_at(world, j), t)


@fast_inlined
def _separation(world, i, j):
    return separation(world, i, j) if j >= 0 else separation_from_plane(world, i, -1 - j)


@kernel
def _safe_time(world, i, j, n, gap, t, end):
    """A time from t to `end` (s) up to which a gap along n (m), now `gap`, stays above zero.

    The bound of the gap is concave in time: so it lies above its chords, and below its tangents,
    between which its root is enclosed.
    """
    low, at_low, high = 0.0, gap, end - t
    change, slope = _lower_bound(world, i, j, n, t, high)
    at_high = gap + change
    if at_high >= 0.0:
        return end
    for _ in range(TANGENTS):
        low += (high - low) * at_low / (at_low - at_high)
        tangent = high - at_high / slope if slope < 0.0 else low
        at_low = gap + _lower_bound(world, i, j, n, t, low)[0]
        if at_low <= CLOSED or not tangent > low:
            break
        high = tangent
        change, slope = _lower_bound(world, i, j, n, t, high)
        at_high = gap + change
        if at_high >= 0.0:
            return t + high
    return t + low


@kernel
def _lower_bound(world, i, j, n, t, tau):
    """A bound of the change of a gap along n from time t to t + tau (s), and its slope (m/s).

    The bodies are where they are at time t.
    """
    one = body_at(world, i)
    velocity = add_scaled(load(one.path_velocity), load(one.path_acceleration), t)
    acceleration = load(one.path_acceleration)
    bending, change, slope = _swing(one, n, 1.0, tau)
    if j >= 0 and body_at(world, j).inverse_mass > 0.0:
        other = body_at(world, j)
        there = add_scaled(load(other.path_velocity), load(other.path_acceleration), t)
        velocity = sub(velocity, there)
        acceleration = sub(acceleration, load(other.path_acceleration))
        further, more, steeper = _swing(other, n, -1.0, tau)
        bending, change, slope = bending + further, change + more, slope + steeper
    speed = dot(velocity, n)
    # A gap that opens ever faster is bounded by its tangent: the bound has to be concave.
    curvature = min(dot(acceleration, n) - bending, 0.0)
    change += tau * (speed + 0.5 * tau * curvature)
    return change, slope + speed + tau * curvature


@fast_inlined
def _swing(body, n, sense, tau):
    """How turning moves the nearest of a body's points along n, at constant speeds of its corners.

    The sense is 1 for the body that n points to and -1 for the other one. Returns the most by which
    these bend along n, |n × ω| |ω| r (m/s²), the change (m) after tau and its slope.
    Along n all corners of a core lie at ± a_0 ± a_1 ± a_2 and go at ± b_0 ± b_1 ± b_2, with one
    choice of signs for both: the nearest is at -Σ |a_k + b_k tau|.
    """
    turning = load(body.turning)
    if body.kind == SPHERE or dot(turning, turning) == 0.0:
        return 0.0, 0.0, 0.0
    side = cross(n, turning)
    change, slope = 0.0, 0.0
    for k in range(3):
        along = column(body.rotation, k)
        a = body.half_extents[k] * dot(n, along)
        b = body.half_extents[k] * dot(side, along)
        after = a + b * tau
        change += abs(a) - abs(after)
        slope -= b if after > 0.0 else -b if after < 0.0 else abs(b)
    if body.off_centre == 1:
        drift = sense * dot(side, sub(load(body.position), centre_of_mass(body)))
        change += drift * tau
        slope += drift
    return norm(side) * norm(turning) * body.reach, change, slope


@fast_inlined
def _way(body, t):
    """A bound (m) on how far any point of a body moves."""
    return _moved(body, t) + t * body.reach * norm(load(body.turning))


@fast_inlined
def _moved(body, t):
    """How far (m) the centre of mass of a body moves."""
    return norm(_path(body, t))


@fast_inlined
def _path(body, t):
    mean = add_scaled(load(body.path_velocity), load(body.path_acceleration), 0.5 * t)
    return scaled(mean, t)
