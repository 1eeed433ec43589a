"""Detect: when each sphere will next hit something."""

from __future__ import annotations

from math import inf, sqrt

from intuitive_physics.geometry.vectors import (
    add_scaled,
    dot,
    load,
    norm,
    sub,
    tangential,
)
from intuitive_physics.kernels import inlined, kernel
from intuitive_physics.simulation.rigid_bodies.solids import (
    EDGE,
    FACE,
    SHEET,
    SIDE,
    feature_at,
    solid_at,
)
from intuitive_physics.simulation.rigid_bodies.world import body_at, followed_at, pair_of
from intuitive_physics.simulation.spheres.contact_geometry import arc_pull, nearest
from intuitive_physics.simulation.spheres.roots import (
    evaluate,
    first_fall_quadratic,
    next_fall,
)
from intuitive_physics.simulation.spheres.touching import touches

REACHED = 1e-7
"""m. A gap below this is none where a feature of a solid is hit."""

GRAZES = 1e-6
"""m/s. At a lower normal speed the acceleration decides whether what touches a solid hits it."""

MOST_FALLS = 4
"""Intervals in which a polynomial of degree four falls: two, and one more where each begins at an
inflection."""

PASSED = 1e-4
"""m. What is deeper in a sheet has come through from behind, and does not hit it."""


@kernel
def predict_solid_impacts(world, i):
    """Find the first solid that sphere i hits in its present phase."""
    body = body_at(world, i)
    position, velocity = load(body.position), load(body.velocity)
    acceleration = load(body.acceleration)
    first, solid = inf, -1
    for s in range(world.open_planes):
        plane = solid_at(world, s)
        n = load(plane.normal)
        speed, push = dot(velocity, n), dot(acceleration, n)
        if (speed < 0.0 or push < 0.0) and not touches(body, s):
            gap = dot(position, n) - plane.offset - body.radius
            t = first_fall_quadratic(gap, speed, push)
            if t < first:
                first, solid = t, s
    body.impact_time = inf
    if body.time + first <= body.phase_end:
        body.impact_time = body.time + first
        body.impact_solid = solid
    if world.solid_count > world.open_planes:
        _predict_bounded_impacts(world, body)


@kernel
def _predict_bounded_impacts(world, body):
    """Find out whether a body hits a sheet or box before it hits a plane."""
    span = min(min(body.phase_end, body.impact_time), world.end) - body.time
    if not span >= 0.0:
        return
    low, high = _bounds_of_path(body, span)
    for s in range(world.open_planes, world.solid_count):
        solid = solid_at(world, s)
        if not _overlaps(solid, low, high) or touches(body, s):
            continue
        for f in range(solid.first_feature, solid.last_feature):
            feature = feature_at(world, f)
            if feature.kind != SIDE and _overlaps(feature, low, high):
                tau = _feature_impact(world, body, solid, feature, span)
                if tau < span or (tau == span and body.impact_time > body.time + span):
                    span = tau
                    body.impact_time = body.time + tau
                    body.impact_solid = s


@kernel
def _bounds_of_path(body, span):
    """Lowest and highest coordinates that a body's surface reaches within `span` (s)."""
    x, v, a = load(body.position), load(body.velocity), load(body.acceleration)
    low0, high0 = _extremes(x[0], v[0], a[0], span)
    low1, high1 = _extremes(x[1], v[1], a[1], span)
    low2, high2 = _extremes(x[2], v[2], a[2], span)
    r = body.radius + REACHED
    return (low0 - r, low1 - r, low2 - r), (high0 + r, high1 + r, high2 + r)


@kernel
def _extremes(x, v, a, span):
    end = x + span * (v + 0.5 * span * a)
    low, high = min(x, end), max(x, end)
    if v * (v + span * a) < 0.0:
        apex = x - 0.5 * v * v / a
        low, high = min(low, apex), max(high, apex)
    return low, high


@kernel
def _overlaps(bounded, low, high):
    return (
        bounded.low[0] <= high[0]
        and low[0] <= bounded.high[0]
        and bounded.low[1] <= high[1]
        and low[1] <= bounded.high[1]
        and bounded.low[2] <= high[2]
        and low[2] <= bounded.high[2]
    )


@kernel
def _feature_impact(world, body, solid, feature, span):
    """Time τ in [0, span] at which a body hits a face, edge or corner of a solid, else infinity."""
    x, v, a = load(body.position), load(body.velocity), load(body.acceleration)
    if feature.kind == FACE:
        n = load(feature.direction)
        gap = dot(x, n) - feature.offset - body.radius
        tau = first_fall_quadratic(gap, dot(v, n), dot(a, n))
        if tau > span:
            return inf
        gap += tau * (dot(v, n) + 0.5 * tau * dot(a, n))
        return tau if _hits(world, body, solid, tau, gap) else inf
    w = sub(x, load(feature.point))
    if feature.kind == EDGE:
        direction = load(feature.direction)
        w, v, a = (
            tangential(w, direction),
            tangential(v, direction),
            tangential(a, direction),
        )
    square = dot(w, w) - body.radius * body.radius
    gap_squared = (
        square,
        2.0 * dot(w, v),
        dot(v, v) + dot(w, a),
        dot(v, a),
        0.25 * dot(a, a),
    )
    low = 0.0
    for _ in range(MOST_FALLS):
        tau, low = next_fall(gap_squared, low, span)
        if tau == inf:
            return inf
        distance = sqrt(max(0.0, evaluate(gap_squared, tau) + body.radius * body.radius))
        if _hits(world, body, solid, tau, distance - body.radius):
            return tau
    return inf


@kernel
def _hits(world, body, solid, tau, gap_to_feature):
    """Whether a body at time τ (s) touches a solid, approaches it, and the feature is nearest."""
    x = position_at(body, body.time + tau)
    gap, n, axis, part = nearest(world, solid, x, body.radius)
    if gap > REACHED or abs(gap - gap_to_feature) > REACHED:
        return False
    if solid.kind == SHEET and gap < -PASSED:
        return False
    velocity = add_scaled(load(body.velocity), load(body.acceleration), tau)
    speed = dot(velocity, n)
    if abs(speed) >= GRAZES:
        return speed < 0.0
    apart = dot(load(body.acceleration), n) + arc_pull(velocity, axis, part, body.radius)
    return apart < 0.0 or (apart == 0.0 and speed < 0.0)


@kernel
def predict_sphere_impacts(world, i):
    """Find when sphere i hits each other one while both are in their present phases.

    Each sphere keeps the first impact with one of those before it.
    """
    body = body_at(world, i)
    body.pair_time, body.pair_with = inf, -1
    for k in range(world.followed_count):
        j = followed_at(world, k)
        if j == i:
            continue
        other, pair = body_at(world, j), pair_of(world, i, j)
        pair.impact_time = inf
        if not pair.touches:
            pair.impact_time = _pair_impact(body, other, world.end)
        if j > i:
            if other.pair_with == i:
                _find_first_impact(world, j)
            else:
                _note_impact(other, pair.impact_time, i)
        else:
            _note_impact(body, pair.impact_time, j)


@inlined
def _note_impact(body, time, before):
    """Take note that a body hits one of those before it at a time (s), if that is first."""
    if time < body.pair_time or (time == body.pair_time and before < body.pair_with):
        body.pair_time, body.pair_with = time, before


@kernel
def _find_first_impact(world, i):
    """Find the first impact of sphere i with one of those before it among the known ones."""
    body = body_at(world, i)
    body.pair_time, body.pair_with = inf, -1
    for k in range(world.followed_count):
        j = followed_at(world, k)
        if j >= i:
            break
        _note_impact(body, pair_of(world, i, j).impact_time, j)


@kernel
def _pair_impact(one, other, end):
    """Time of impact of two spheres: a root of a quartic, of a quadratic where both fly freely."""
    start = max(one.time, other.time)
    end = min(end, min(one.phase_end, other.phase_end))
    end = min(end, min(one.impact_time, other.impact_time))
    if end < start:
        return inf
    apart = sub(position_at(one, start), position_at(other, start))
    closing = sub(_velocity_at(one, start), _velocity_at(other, start))
    bending = sub(load(one.acceleration), load(other.acceleration))
    reach = one.radius + other.radius
    span = end - start
    if norm(apart) - reach > span * (norm(closing) + 0.5 * span * norm(bending)):
        return inf
    gap = dot(apart, apart) - reach * reach
    approach = dot(apart, closing)
    if dot(bending, bending) == 0.0:
        if approach >= 0.0:
            return inf
        speed = dot(closing, closing)
        under_root = approach * approach - speed * gap
        if under_root <= 0.0:
            return inf
        t = start + max(0.0, gap / (sqrt(under_root) - approach))
        return t if t <= end else inf
    c2 = dot(closing, closing) + dot(apart, bending)
    c3, c4 = dot(closing, bending), 0.25 * dot(bending, bending)
    tau, _ = next_fall((gap, 2.0 * approach, c2, c3, c4), 0.0, span)
    return start + tau


@kernel
def position_at(body, t):
    """Position (m) of a body at time t (s) of its present phase."""
    tau = t - body.time
    moved = add_scaled(load(body.position), load(body.velocity), tau)
    return add_scaled(moved, load(body.acceleration), 0.5 * tau * tau)


@kernel
def _velocity_at(body, t):
    return add_scaled(load(body.velocity), load(body.acceleration), t - body.time)
