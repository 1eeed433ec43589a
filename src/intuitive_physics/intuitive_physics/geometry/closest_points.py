"""Closest points between points, segments, boxes and convex polygons, for kernels.

Points and vectors are tuples in m, as in `vectors`. A polygon is the address of its corners, an
array (n, 3) of float64, counterclockwise about its normal, and their number. `gaps` has distances
for whole arrays.
"""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.vectors import (
    add_scaled,
    bounded,
    cross,
    dot,
    norm,
    sub,
    vector_at,
)
from intuitive_physics.kernels import kernel

PARALLEL = 1e-12
"""Squared sine of the angle between two segments below which they are taken as parallel."""

SAME_POINT = 1e-12
"""m. A point nearer to a box than this is taken as one of its surface or inside it."""

BISECTIONS = 30
"""Halvings of a segment, which leave 1e-9 of its length."""


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
    if determinant > PARALLEL * a * e:
        s = bounded((b * f - c * e) / determinant, 0.0, 1.0)
    t = (b * s + f) / e
    if t < 0.0:
        return bounded(-c / a, 0.0, 1.0), 0.0
    if t > 1.0:
        return bounded((b - c) / a, 0.0, 1.0), 1.0
    return s, t


@kernel
def point_from_box(point, half):
    """Distance (m) of a point from a box in the box's frame, and the unit vector away from the box.

    Inside, the distance is below zero and the direction is that of the nearest face. The box is
    given by half of its edge lengths (m).
    """
    nearest = (
        bounded(point[0], -half[0], half[0]),
        bounded(point[1], -half[1], half[1]),
        bounded(point[2], -half[2], half[2]),
    )
    away = sub(point, nearest)
    distance = norm(away)
    if distance > SAME_POINT:
        scale = 1.0 / distance
        return distance, (away[0] * scale, away[1] * scale, away[2] * scale)
    x, y, z = half[0] - abs(point[0]), half[1] - abs(point[1]), half[2] - abs(point[2])
    if x <= y and x <= z:
        return -x, (1.0 if point[0] >= 0.0 else -1.0, 0.0, 0.0)
    if y <= z:
        return -y, (0.0, 1.0 if point[1] >= 0.0 else -1.0, 0.0)
    return -z, (0.0, 0.0, 1.0 if point[2] >= 0.0 else -1.0)


@kernel
def segment_nearest_to_box(start, span, half):
    """Parameter in [0, 1] of the point of a segment nearest to a box, in the box's frame.

    The squared distance is convex along the segment: its slope is bisected.
    """
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        t = 0.5 * (low + high)
        slope = 0.0
        for k in range(3):
            x = start[k] + t * span[k]
            slope += (x - bounded(x, -half[k], half[k])) * span[k]
        if slope > 0.0:
            high = t
        elif slope < 0.0:
            low = t
        else:
            return t
    return 0.5 * (low + high)


@kernel
def nearest_on_polygon(point, polygon, corners, normal, offset):
    """The point of a convex polygon, in the plane normal · p = offset (m), nearest to a point."""
    inside = True
    nearest, least = point, inf
    for k in range(corners):
        start = vector_at(polygon, k)
        span = sub(vector_at(polygon, (k + 1) % corners), start)
        if dot(cross(normal, span), sub(point, start)) < 0.0:
            inside = False
        on_edge = add_scaled(start, span, nearest_on_segment(point, start, span))
        distance = norm(sub(point, on_edge))
        if distance < least:
            nearest, least = on_edge, distance
    if inside:
        return add_scaled(point, normal, offset - dot(normal, point))
    return nearest


@kernel
def part_over_polygon(start, span, polygon, corners, normal):
    """Parameters of the part of a segment over a convex polygon; the first larger if none."""
    low, high = 0.0, 1.0
    for k in range(corners):
        corner = vector_at(polygon, k)
        inward = cross(normal, sub(vector_at(polygon, (k + 1) % corners), corner))
        at = dot(inward, sub(start, corner))
        rate = dot(inward, span)
        if rate > 0.0:
            low = max(low, -at / rate)
        elif rate < 0.0:
            high = min(high, -at / rate)
        elif at < 0.0:
            return 1.0, 0.0
    return low, high
