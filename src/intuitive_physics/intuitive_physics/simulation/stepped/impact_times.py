"""When, within a part of a step, bodies first hit something hard enough to rebound."""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import dot, load, norm, sub
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.manifolds import GAP_ONLY, meet_plane
from intuitive_physics.simulation.rigid_bodies.pairs import meet
from intuitive_physics.simulation.rigid_bodies.poses import support
from intuitive_physics.simulation.rigid_bodies.world import body_at, column, member_at, plane_at
from intuitive_physics.simulation.rollout import TOO_FAST
from intuitive_physics.simulation.stepped.impacts import IMPACT_GAP
from intuitive_physics.simulation.stepped.motion import place
from intuitive_physics.simulation.world_batch import SPHERE

CLOSED = 1e-8
"""m. A gap this small is none."""

ITERATIONS = 40
"""Most steps of the search for a root of the gap."""

SAMPLES = 512
"""Most samples of a pair's gap over a part of a step, one for each half of its thinness that its
points move. A pair whose centres move farther than that stops the world, TOO_FAST: the two might
pass through each other between samples. Turning alone cannot bring them through."""

TOUCHING_SAMPLES = 8
"""Least samples of the gap of a pair that touches already and turns."""

BARELY_APART = 1e-9
"""m. How far a pair that touches is taken to be above what counts as closing again."""

FAR = 1e9
"""m. Margin that keeps a manifold from leaving out anything when only its gap is wanted."""


@kernel
def first_impact(world, moving, members, duration, threshold):
    """Time (s) after the part's start of its first impact faster than `threshold`, or its end.

    The moving bodies' motion is planned; they are left anywhere on it.
    """
    first = duration
    for a in range(moving):
        i = member_at(world, a)
        body = body_at(world, i)
        if body.kind != SPHERE:
            place(body, first)
        for p in range(world.plane_count):
            plane = plane_at(world, p)
            if plane.corners == 0:
                if body.kind == SPHERE:
                    first = _sphere_on_plane(body, plane, first, threshold)
                elif _is_through(body, load(plane.normal), plane.offset):
                    first = _corner_on_plane(body, plane, first, threshold)
                    place(body, first)
        for p in range(world.plane_count):
            if plane_at(world, p).corners > 0:
                first = _sampled(world, i, -1 - p, first, threshold)
        for b in range(a + 1, members):
            first = _sampled(world, i, member_at(world, b), first, threshold)
    return first


@kernel
def _sphere_on_plane(body, plane, first, threshold):
    """Root of gap + v t + a t²/2, the later one for a sphere that has just rebounded."""
    n = load(plane.normal)
    gap = dot(n, load(body.start_position)) - plane.offset - body.radius
    speed = dot(n, load(body.path_velocity))
    acceleration = dot(n, load(body.path_acceleration))
    if gap + first * min(0.0, speed + 0.5 * first * min(0.0, acceleration)) > 0.0:
        return first
    if gap <= IMPACT_GAP and speed <= threshold:
        return first
    under_root = speed * speed - 2.0 * acceleration * max(gap, 0.0)
    if under_root < threshold * threshold:
        return first
    root = sqrt(under_root)
    if speed > 0.0:
        if acceleration >= 0.0:
            return first
        return min(first, -(speed + root) / acceleration)
    return min(first, 2.0 * max(gap, 0.0) / (root - speed))


@fast_inlined
def _is_through(body, n, offset):
    """Whether the nearest point of a body lies behind a plane."""
    height = dot(n, load(body.position)) - offset
    if height > body.reach:
        return False
    return height < support(body, n) - CLOSED


@fast_inlined
def _corner_gap(body, n, offset, corner):
    """Distance of a corner of the rounded core from a plane; a capsule has each end four times."""
    height = dot(n, load(body.position)) - offset - body.radius
    for k in range(3):
        along = body.half_extents[k] * dot(n, column(body.rotation, k))
        height += along if corner & (1 << k) else -along
    return height


@kernel
def _corner_on_plane(body, plane, first, threshold):
    """Root of the smallest gap among the corners that are free at the start and through after."""
    n, offset = load(plane.normal), plane.offset
    through = 0
    for corner in range(8):
        if _corner_gap(body, n, offset, corner) < -CLOSED:
            through |= 1 << corner
    place(body, 0.0)
    for corner in range(8):
        if _corner_gap(body, n, offset, corner) <= IMPACT_GAP:
            through &= ~(1 << corner)
    if through == 0:
        return first
    low, high = 0.0, first
    at_low = _least_gap(body, n, offset, through)
    place(body, first)
    at_high = _least_gap(body, n, offset, through)
    if at_low - at_high < threshold * first:
        return first
    side = 0
    t = first
    for _ in range(ITERATIONS):
        t = (low * at_high - high * at_low) / (at_high - at_low)
        place(body, t)
        gap = _least_gap(body, n, offset, through)
        if abs(gap) < CLOSED:
            break
        low, at_low, high, at_high, side = _illinois(low, at_low, high, at_high, side, t, gap)
    return t


@kernel
def _least_gap(body, n, offset, corners):
    least = FAR
    for corner in range(8):
        if corners & (1 << corner):
            least = min(least, _corner_gap(body, n, offset, corner))
    return least


@fast_inlined
def _illinois(low, at_low, high, at_high, side, t, value):
    """Narrow a bracket by the point (t, value); an end that stays twice counts half."""
    if value < 0.0:
        return low, 0.5 * at_low if side == -1 else at_low, t, value, -1
    return t, value, high, 0.5 * at_high if side == 1 else at_high, 1


@kernel
def _sampled(world, i, second, first, threshold):
    """First time that body i closes on a body, or a bounded plane -1 - p, by looking often."""
    body = body_at(world, i)
    thin = body.thinness
    moved, way = _moved(body, first), _way(body, first)
    if second >= 0:
        other = body_at(world, second)
        thin += other.thinness
        if other.inverse_mass > 0.0:
            moved += _moved(other, first)
            way += _way(other, first)
        apart = norm(sub(load(body.start_position), load(other.start_position)))
        if apart > body.reach + other.reach + 2.0 * way:
            return first
    elif not _crosses(body, plane_at(world, -1 - second), first):
        return first
    before = _gap_at(world, i, second, 0.0)
    level = 0.0
    if not moved < SAMPLES * 0.5 * thin:
        world.status = TOO_FAST
        return first
    samples = 1 + int(min(way / (0.5 * thin), SAMPLES - 1.0))
    if before <= IMPACT_GAP:
        if _greatest_speed(world, i, second) < 2.0 * threshold:
            return first
        samples = max(samples, TOUCHING_SAMPLES)
        # What presses keeps its gap; something else closes when the least gap falls below it.
        level = min(before, 0.0) - BARELY_APART
        before = BARELY_APART
    since = 0.0
    for k in range(1, samples + 1):
        t = first * k / samples
        gap = _gap_at(world, i, second, t) - level
        if gap < -CLOSED:
            if before - gap >= threshold * (t - since):
                return _root(world, i, second, level, since, before, t, gap)
            # What closes slowly is left to the pressed contacts; it may close faster later.
            level += gap - BARELY_APART
            gap = BARELY_APART
        since, before = t, gap
    return first


@fast_inlined
def _way(body, t):
    """A bound (m) on how far any point of a body moves."""
    return _moved(body, t) + t * body.reach * norm(load(body.turning))


@fast_inlined
def _moved(body, t):
    """How far (m) the centre of mass of a body moves."""
    return norm(sub(_at(body, t), load(body.start_position)))


@kernel
def _greatest_speed(world, i, second):
    """A bound (m/s) on how fast points of two bodies, or of one and a plane, may part or close."""
    body = body_at(world, i)
    speed = body.reach * norm(load(body.turning))
    velocity = load(body.path_velocity)
    if second >= 0:
        other = body_at(world, second)
        if other.inverse_mass > 0.0:
            speed += other.reach * norm(load(other.turning))
            velocity = sub(velocity, load(other.path_velocity))
    return speed + norm(velocity)


@kernel
def _root(world, i, second, level, low, at_low, high, at_high):
    """When the gap is at `level` (m) between two times at which it is above and below."""
    side = 0
    t = high
    for _ in range(ITERATIONS):
        # A body beside a bounded plane is infinitely far from it.
        t = 0.5 * (low + high)
        if at_low < FAR:
            t = (low * at_high - high * at_low) / (at_high - at_low)
        gap = _gap_at(world, i, second, t) - level
        if abs(gap) < CLOSED:
            break
        low, at_low, high, at_high, side = _illinois(low, at_low, high, at_high, side, t, gap)
    return t


@fast_inlined
def _at(body, t):
    x, v = load(body.start_position), load(body.path_velocity)
    a = load(body.path_acceleration)
    h = 0.5 * t * t
    return (
        x[0] + t * v[0] + h * a[0],
        x[1] + t * v[1] + h * a[1],
        x[2] + t * v[2] + h * a[2],
    )


@kernel
def _crosses(body, plane, first):
    n = load(plane.normal)
    start = dot(n, load(body.start_position)) - plane.offset
    end = dot(n, _at(body, first)) - plane.offset
    return start > 0.0 and min(start, end) < body.reach


@kernel
def _gap_at(world, i, second, t):
    place(body_at(world, i), t)
    if second < 0:
        return meet_plane(world, i, -1 - second, FAR, GAP_ONLY)[1]
    if body_at(world, second).inverse_mass > 0.0:
        place(body_at(world, second), t)
    return meet(world, i, second, FAR, GAP_ONLY)[1]
