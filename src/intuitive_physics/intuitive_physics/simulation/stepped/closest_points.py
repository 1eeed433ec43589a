"""Closest points between cores: points, segments, boxes and convex polygons."""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.vectors import add_scaled, cross, dot, load, norm, scaled, sub
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.stepped.world import (
    boundary_corner,
    column,
    times,
    transposed_times,
)


@fast_inlined
def segment_end(body, sign):
    """End of a capsule's axis, or a sphere's centre."""
    return add_scaled(load(body.position), column(body.rotation, 2), sign * body.half_extents[2])


@fast_inlined
def bounded(value, low, high):
    return min(max(value, low), high)


@kernel
def nearest_on_segment(point, start, span):
    """Parameter in [0, 1] of the point of a segment (start + t span) nearest to a point."""
    square = dot(span, span)
    if square == 0.0:
        return 0.0
    return bounded(dot(sub(point, start), span) / square, 0.0, 1.0)


@kernel
def nearest_of_segments(start, span, other_start, other_span):
    """Parameters in [0, 1] of the nearest points of two segments."""
    apart = sub(start, other_start)
    a, e = dot(span, span), dot(other_span, other_span)
    f = dot(other_span, apart)
    if a == 0.0:
        return 0.0, nearest_on_segment(start, other_start, other_span)
    if e == 0.0:
        return nearest_on_segment(other_start, start, span), 0.0
    b, c = dot(span, other_span), dot(span, apart)
    determinant = a * e - b * b
    s = 0.5
    if determinant > 1e-12 * a * e:
        s = bounded((b * f - c * e) / determinant, 0.0, 1.0)
    t = (b * s + f) / e
    if t < 0.0:
        return bounded(-c / a, 0.0, 1.0), 0.0
    if t > 1.0:
        return bounded((b - c) / a, 0.0, 1.0), 1.0
    return s, t


@kernel
def point_from_box(point, box):
    """Distance (m, below zero inside) of a point from a box, and the direction away from it."""
    p = transposed_times(box.rotation, sub(point, load(box.position)))
    h = load(box.half_extents)
    q = bounded(p[0], -h[0], h[0]), bounded(p[1], -h[1], h[1]), bounded(p[2], -h[2], h[2])
    away = sub(p, q)
    distance = norm(away)
    if distance > 1e-12:
        return distance, times(box.rotation, scaled(away, 1.0 / distance))
    axis, depth = 0, inf
    for k in range(3):
        if h[k] - abs(p[k]) < depth:
            axis, depth = k, h[k] - abs(p[k])
    side = 1.0 if p[axis] >= 0.0 else -1.0
    return -depth, scaled(column(box.rotation, axis), side)


@kernel
def segment_nearest_to_box(start, span, box):
    """Parameter in [0, 1] of the point of a segment nearest to a box.

    The squared distance is convex along the segment: its slope is bisected.
    """
    p = transposed_times(box.rotation, sub(start, load(box.position)))
    u = transposed_times(box.rotation, span)
    low, high = 0.0, 1.0
    for _ in range(30):
        t = 0.5 * (low + high)
        slope = 0.0
        for k in range(3):
            x = p[k] + t * u[k]
            slope += (x - bounded(x, -box.half_extents[k], box.half_extents[k])) * u[k]
        if slope > 0.0:
            high = t
        elif slope < 0.0:
            low = t
        else:
            return t
    return 0.5 * (low + high)


@kernel
def nearest_on_polygon(point, plane):
    """The point of a plane's bounded part nearest to a point."""
    n = load(plane.normal)
    inside = True
    nearest, least = point, inf
    for k in range(plane.corners):
        start = load(boundary_corner(plane, k).point)
        span = sub(load(boundary_corner(plane, (k + 1) % plane.corners).point), start)
        if dot(cross(n, span), sub(point, start)) < 0.0:
            inside = False
        on_edge = add_scaled(start, span, nearest_on_segment(point, start, span))
        distance = norm(sub(point, on_edge))
        if distance < least:
            nearest, least = on_edge, distance
    if inside:
        return add_scaled(point, n, plane.offset - dot(n, point))
    return nearest


@kernel
def part_over_polygon(start, span, plane):
    """Parameters of the part of a segment over a plane's bounded part; the first larger if none."""
    n = load(plane.normal)
    low, high = 0.0, 1.0
    for k in range(plane.corners):
        corner = load(boundary_corner(plane, k).point)
        following = load(boundary_corner(plane, (k + 1) % plane.corners).point)
        inward = cross(n, sub(following, corner))
        at = dot(inward, sub(start, corner))
        rate = dot(inward, span)
        if rate > 0.0:
            low = max(low, -at / rate)
        elif rate < 0.0:
            high = min(high, -at / rate)
        elif at < 0.0:
            return 1.0, 0.0
    return low, high
