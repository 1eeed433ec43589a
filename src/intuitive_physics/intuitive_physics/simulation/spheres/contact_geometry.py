"""The contact of a sphere with a solid."""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.vectors import (
    add,
    add_scaled,
    dot,
    load,
    norm,
    scaled,
    sub,
)
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.solids import (
    BLOCK,
    EDGE,
    HALF_SPACE,
    SIDE,
    feature_at,
)

ON_FACE, ON_EDGE, ON_CORNER = range(3)
"""Part of a solid that is nearest."""

NO_AXIS = (0.0, 0.0, 0.0)
"""In place of the direction of an edge."""


@kernel
def nearest(world, solid, center, radius):
    """Contact of a sphere with a solid: gap, normal, axis and part.

    The gap (m) is below zero where they overlap, infinite behind a sheet. The normal is from the
    solid's nearest point to the sphere. The axis is the direction of the edge where that point is
    on an edge, else zero. The part is ON_FACE, ON_EDGE or ON_CORNER.
    """
    if solid.kind == BLOCK:
        return _nearest_on_box(solid, center, radius)
    n = load(solid.normal)
    height = dot(center, n) - solid.offset
    if solid.kind == HALF_SPACE:
        return height - radius, n, NO_AXIS, ON_FACE
    if not height >= 0.0:
        return inf, n, NO_AXIS, ON_FACE
    return _nearest_on_sheet(world, solid, center, radius, height)


@kernel
def _nearest_on_sheet(world, solid, center, radius, height):
    n = load(solid.normal)
    foot = add_scaled(center, n, -height)
    least = inf
    point, axis, part = foot, NO_AXIS, ON_FACE
    outside = False
    for f in range(solid.first_feature, solid.last_feature):
        feature = feature_at(world, f)
        if feature.kind == SIDE:
            outside = dot(foot, load(feature.direction)) > feature.offset
        elif feature.kind == EDGE and outside:
            start, direction = load(feature.point), load(feature.direction)
            along = dot(sub(foot, start), direction)
            at = min(max(along, 0.0), feature.length)
            candidate = add_scaled(start, direction, at)
            distance = norm(sub(foot, candidate))
            if distance < least:
                least, point = distance, candidate
                axis, part = (direction, ON_EDGE) if at == along else (NO_AXIS, ON_CORNER)
    if part == ON_FACE:
        return height - radius, n, axis, part
    apart = sub(center, point)
    distance = norm(apart)
    return distance - radius, scaled(apart, 1.0 / distance), axis, part


@kernel
def _nearest_on_box(solid, center, radius):
    apart = sub(center, load(solid.center))
    outward, inside = NO_AXIS, NO_AXIS
    shallowest = -inf
    face = NO_AXIS
    outer = 0
    for k in range(3):
        direction = load(solid.axes[k])
        along = dot(apart, direction)
        if along < 0.0:
            along = -along
            direction = scaled(direction, -1.0)
        beyond = along - solid.half_lengths[k]
        if beyond > 0.0:
            outward = add_scaled(outward, direction, beyond)
            outer += 1
        else:
            inside = add(inside, direction)
        if beyond > shallowest:
            shallowest, face = beyond, direction
    if outer <= 1:
        return shallowest - radius, face, NO_AXIS, ON_FACE
    distance = norm(outward)
    normal = scaled(outward, 1.0 / distance)
    if outer == 2:
        return distance - radius, normal, inside, ON_EDGE
    return distance - radius, normal, NO_AXIS, ON_CORNER


@kernel
def arc_pull(v, axis, part, radius):
    """Acceleration (m/s²) that keeps a centre of velocity v on its arc round an edge or corner."""
    across = arc_velocity(v, axis, part)
    return dot(across, across) / radius


@kernel
def arc_velocity(v, axis, part):
    """The part of a velocity that turns the normal of a contact."""
    return scaled(add_scaled(v, axis, -dot(v, axis)), 0.0 if part == ON_FACE else 1.0)
