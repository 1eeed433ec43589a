"""Where two bodies touch, or nearly touch, one of which at least is a sphere or capsule.

Each function of this kind writes the contacts whose gap is below `margin` (m) behind the first
`count` of the world's contacts and returns the new count. Normals point towards the first body.
"""

from __future__ import annotations

from intuitive_physics.geometry.closest_points import (
    nearest_of_segments,
    nearest_on_segment,
    point_from_box,
    segment_nearest_to_box,
)
from intuitive_physics.geometry.vectors import add_scaled, cross, load, norm, scaled, sub
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.contact_points import write_contact
from intuitive_physics.simulation.rigid_bodies.poses import into_frame, segment_end
from intuitive_physics.simulation.rigid_bodies.world import body_at, times, transposed_times
from intuitive_physics.simulation.world_batch import CAPSULE

PARALLEL = 0.05
"""Sine of the angle between capsules below which they touch at two points."""

SAME_PLACE = 2e-3
"""Part of a capsule's axis within which two of its points are one: of an axis l long and a radius
r, distances there differ by (l / 500)² / 2 r at most, less than a micrometre."""

UP = (0.0, 0.0, 1.0)
"""A direction for what has none: two centres at the same place."""


@kernel
def meet_rounded(world, i, j, margin, count):
    """Contacts of body i with body j, both spheres or capsules."""
    one, other = body_at(world, i), body_at(world, j)
    start, other_start = segment_end(one, -1.0), segment_end(other, -1.0)
    span = sub(segment_end(one, 1.0), start)
    other_span = sub(segment_end(other, 1.0), other_start)
    s, t = nearest_of_segments(start, span, other_start, other_span)
    length, other_length = norm(span), norm(other_span)
    if norm(cross(span, other_span)) < PARALLEL * length * other_length:
        return _meet_along(world, i, j, margin, count)
    here, there = add_scaled(start, span, s), add_scaled(other_start, other_span, t)
    return _meet_points(world, i, j, here, there, margin, count)


@kernel
def _meet_points(world, i, j, here, there, margin, count):
    one, other = body_at(world, i), body_at(world, j)
    apart = sub(here, there)
    distance = norm(apart)
    gap = distance - one.radius - other.radius
    if gap < margin:
        n = scaled(apart, 1.0 / distance) if distance > 0.0 else UP
        point = add_scaled(here, n, -one.radius - 0.5 * gap)
        count = write_contact(world, count, i, j, gap, n, point)
    return count


@kernel
def _meet_along(world, i, j, margin, count):
    """Two capsules side by side touch where their common stretch begins and ends."""
    one, other = body_at(world, i), body_at(world, j)
    start, other_start = segment_end(one, -1.0), segment_end(other, -1.0)
    span = sub(segment_end(one, 1.0), start)
    other_span = sub(segment_end(other, 1.0), other_start)
    a = nearest_on_segment(other_start, start, span)
    b = nearest_on_segment(segment_end(other, 1.0), start, span)
    for end in range(1 if a == b else 2):
        here = add_scaled(start, span, b if end else a)
        t = nearest_on_segment(here, other_start, other_span)
        there = add_scaled(other_start, other_span, t)
        count = _meet_points(world, i, j, here, there, margin, count)
    return count


@kernel
def meet_box(world, i, j, box, margin, count):
    """Contacts of bodies i and j, of which `box` is a box and the other none."""
    rounded = body_at(world, j if box == i else i)
    solid = body_at(world, box)
    start = segment_end(rounded, -1.0)
    if rounded.kind != CAPSULE:
        return _meet_point(world, i, j, box, start, margin, count)
    span = sub(segment_end(rounded, 1.0), start)
    nearest = segment_nearest_to_box(
        into_frame(solid, start), transposed_times(solid.rotation, span), load(solid.half_extents)
    )
    for end in range(3):
        t = 0.5 * end
        if end == 1:
            if nearest < SAME_PLACE or nearest > 1.0 - SAME_PLACE:
                continue
            t = nearest
        centre = add_scaled(start, span, t)
        count = _meet_point(world, i, j, box, centre, margin, count)
    return count


@kernel
def _meet_point(world, i, j, box, centre, margin, count):
    rounded = body_at(world, j if box == i else i)
    solid = body_at(world, box)
    distance, away = point_from_box(into_frame(solid, centre), load(solid.half_extents))
    n = times(solid.rotation, away)
    gap = distance - rounded.radius
    if gap < margin:
        point = add_scaled(centre, n, -rounded.radius - 0.5 * gap)
        towards = n if box == j else scaled(n, -1.0)
        count = write_contact(world, count, i, j, gap, towards, point)
    return count
