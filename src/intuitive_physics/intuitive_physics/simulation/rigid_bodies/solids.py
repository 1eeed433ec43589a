"""What never moves, with its faces, edges and corners, as spheres in closed form meet it."""

from __future__ import annotations

from math import inf

import numpy as np
from numba import int64

from intuitive_physics.geometry.quaternions import rotated_axes
from intuitive_physics.geometry.vectors import (
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    store,
    sub,
)
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.kernels.pointers import record_getter

HALF_SPACE, SHEET, BLOCK = range(3)
"""Kinds of solids: plane without an edge, one-sided polygon, box."""

SOLID = np.dtype(
    [
        ("kind", "i8"),
        ("material", "i8"),
        ("normal", "f8", 3),  # of a plane or sheet
        ("offset", "f8"),  # m
        ("center", "f8", 3),  # m, of a box, as are the next two
        ("axes", "f8", (3, 3)),  # row k is the direction of edge length k
        ("half_lengths", "f8", 3),  # m
        ("low", "f8", 3),  # m, bounds of a sheet or box along the world's axes
        ("high", "f8", 3),
        ("first_feature", "i8"),  # of a sheet or box in the world's features
        ("last_feature", "i8"),  # exclusive
    ],
    align=True,
)
"""A plane, a sheet or a box that never moves."""

FACE, SIDE, EDGE, CORNER = range(4)
"""Kinds of features. A side bounds a sheet: the plane through an edge that is normal to it."""

FEATURE = np.dtype(
    [
        ("kind", "i8"),
        ("direction", "f8", 3),  # outward normal of a face or side, direction of an edge
        ("offset", "f8"),  # m, of a face or side
        ("point", "f8", 3),  # m, where an edge starts, or the corner
        ("length", "f8"),  # m, of an edge
        ("low", "f8", 3),  # m, bounds along the world's axes, not of a side
        ("high", "f8", 3),
    ],
    align=True,
)
"""A face, side, edge or corner of a sheet or box."""

_solid, _feature = record_getter(SOLID), record_getter(FEATURE)


@fast_inlined
def solid_at(world, s):
    return _solid(world.solids, s)


@fast_inlined
def feature_at(world, f):
    return _feature(world.features, f)


SHORTEST_EDGE = 1e-9
"""m. Corners of a boundary nearer than this are one."""


def most_features(planes: int, boxes: int, corners: int) -> int:
    """Return the largest number of features of planes, each with `corners`, and boxes."""
    # A sheet has its face, and for each corner a side, an edge and the corner itself.
    per_sheet = 1 + 3 * corners if corners else 0
    per_box = 6 + 12 + 8
    return planes * per_sheet + boxes * per_box


@kernel
def place_solids(world, worlds, e):
    """Fill in the solids of environment e of a batch: planes without an edge, sheets, boxes."""
    planes, materials = worlds.planes[e], worlds.plane_materials[e]
    corner_counts, corners = worlds.corner_counts[e], worlds.corners[e]
    s, f = int64(0), int64(0)
    for p in range(worlds.plane_counts[e]):
        if corner_counts[p] == 0:
            solid = solid_at(world, s)
            _place_plane(solid, planes[p], materials[p])
            solid.kind = HALF_SPACE
            s += 1
    world.open_planes = s
    for p in range(worlds.plane_counts[e]):
        if corner_counts[p] > 0:
            solid = solid_at(world, s)
            _place_plane(solid, planes[p], materials[p])
            solid.kind = SHEET
            f = _place_sheet(world, solid, f, corners[p], corner_counts[p])
            s += 1
    for b in range(worlds.box_counts[e]):
        solid = solid_at(world, s)
        f = _place_box(world, solid, f, worlds.boxes[e, b], worlds.box_materials[e, b])
        s += 1
    world.solid_count = s


@kernel
def _place_plane(solid, plane, material):
    solid.material = material
    store(solid.normal, load(plane))
    solid.offset = plane[3]


@kernel
def _place_sheet(world, solid, f, corners, count):
    """Write the face, then side, edge and corner for each corner of the boundary."""
    n = load(solid.normal)
    _start_bounds(solid)
    solid.first_feature = f
    face = feature_at(world, f)
    face.kind = FACE
    store(face.direction, n)
    face.offset = solid.offset
    f += 1
    for k in range(count):
        start = _on_plane(load(corners[k]), n, solid.offset)
        end = _on_plane(load(corners[k + 1 if k + 1 < count else 0]), n, solid.offset)
        _widen(solid, start)
        length = norm(sub(end, start))
        if length > SHORTEST_EDGE:
            direction = scaled(sub(end, start), 1.0 / length)
            side = feature_at(world, f)
            side.kind = SIDE
            store(side.direction, cross(direction, n))
            side.offset = dot(start, load(side.direction))
            _write_edge(feature_at(world, f + 1), start, direction, length)
            _write_corner(feature_at(world, f + 2), start)
            f += 3
    store(face.low, load(solid.low))
    store(face.high, load(solid.high))
    solid.last_feature = f
    return f


@kernel
def _place_box(world, solid, f, box, material):
    solid.kind = BLOCK
    solid.material = material
    store(solid.center, load(box))
    x, y, z = rotated_axes((box[3], box[4], box[5], box[6]))
    store(solid.axes[0], x)
    store(solid.axes[1], y)
    store(solid.axes[2], z)
    for k in range(3):
        solid.half_lengths[k] = 0.5 * box[7 + k]
    _start_bounds(solid)
    solid.first_feature = f
    for k in range(8):
        corner = _corner_of_box(solid, k)
        _write_corner(feature_at(world, f), corner)
        _widen(solid, corner)
        f += 1
    for axis in range(3):
        direction = load(solid.axes[axis])
        bit = 1 << axis
        for k in range(8):
            if k & bit == 0:
                length = 2.0 * solid.half_lengths[axis]
                _write_edge(feature_at(world, f), _corner_of_box(solid, k), direction, length)
                f += 1
        _write_box_face(solid, feature_at(world, f), axis, -1.0)
        _write_box_face(solid, feature_at(world, f + 1), axis, 1.0)
        f += 2
    solid.last_feature = f
    return f


@kernel
def _corner_of_box(solid, k):
    """Corner k of a box; bit j says on which end of axis j it lies."""
    corner = load(solid.center)
    for j in range(3):
        reach = solid.half_lengths[j] if k & (1 << j) else -solid.half_lengths[j]
        corner = add_scaled(corner, load(solid.axes[j]), reach)
    return corner


@kernel
def _write_box_face(solid, face, axis, sense):
    face.kind = FACE
    normal = scaled(load(solid.axes[axis]), sense)
    store(face.direction, normal)
    face.offset = dot(load(solid.center), normal) + solid.half_lengths[axis]
    _start_bounds(face)
    for k in range(8):
        if (k & (1 << axis) != 0) == (sense > 0.0):
            _widen(face, _corner_of_box(solid, k))


@kernel
def _write_edge(edge, start, direction, length):
    edge.kind = EDGE
    store(edge.point, start)
    store(edge.direction, direction)
    edge.length = length
    _start_bounds(edge)
    _widen(edge, start)
    _widen(edge, add_scaled(start, direction, length))


@kernel
def _write_corner(corner, point):
    corner.kind = CORNER
    store(corner.point, point)
    _start_bounds(corner)
    _widen(corner, point)


@kernel
def _start_bounds(bounded):
    store(bounded.low, (inf, inf, inf))
    store(bounded.high, (-inf, -inf, -inf))


@kernel
def _widen(bounded, point):
    """Let the bounds take in a point."""
    for k in range(3):
        bounded.low[k] = min(bounded.low[k], point[k])
        bounded.high[k] = max(bounded.high[k], point[k])


@kernel
def _on_plane(point, n, offset):
    return add_scaled(point, n, offset - dot(point, n))
