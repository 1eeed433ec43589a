"""The state of one world while it is rolled out.

Everything is a record, so that a kernel gets a pointer to it.
"""

from __future__ import annotations

import numpy as np

from intuitive_physics.geometry.vectors import (
    add_scaled,
    load,
    norm,
    scaled,
    store,
    sub,
)
from intuitive_physics.kernels import inlined, kernel
from intuitive_physics.kernels.pointers import record_getter
from intuitive_physics.simulation.rollout import TOO_MANY_CONTACTS
from intuitive_physics.simulation.world_record import COMMON_FIELDS, coefficient

MOST_TOUCHED = 12
"""Solids that one object can touch at once; one more and the world stops, TOO_MANY_CONTACTS."""

OBJECT = np.dtype(
    [
        # Motion since the object's own `time`: x + v τ + a τ²/2 and ω + α τ.
        ("position", "f8", 3),  # m
        ("velocity", "f8", 3),  # m/s
        ("spin", "f8", 3),  # rad/s
        ("orientation", "f8", 4),  # (x, y, z, w)
        ("acceleration", "f8", 3),  # m/s²
        ("spin_acceleration", "f8", 3),  # rad/s²
        # What `clusters` seeks while it solves: the motion at the end of its step.
        ("solved_velocity", "f8", 3),  # m/s
        ("solved_spin", "f8", 3),  # rad/s
        ("end_velocity", "f8", 3),  # m/s, at `phase_end` where `turning`
        ("time", "f8"),  # s
        ("phase_end", "f8"),  # s, until when the accelerations hold
        ("radius", "f8"),  # m
        ("mass", "f8"),  # kg
        ("inertia", "f8"),  # kg m²: κ m r², κ = 2/5 of a solid sphere and 2/3 of a thin shell
        # Of a force along the surface, the part that accelerates a sphere in rolling contact,
        # 1 / (1 + κ); friction takes the rest.
        ("rolling_share", "f8"),
        # Change of the spin's r ω, and of the slip, per change of velocity by friction.
        ("spin_gain", "f8"),  # 1 / κ
        ("slip_gain", "f8"),  # 1 + 1 / κ
        ("impact_time", "f8"),  # s, of the next impact on a solid, infinite if none
        ("impact_solid", "i8"),  # index of that solid
        ("material", "i8"),
        ("clustered", "i8"),  # 1 while the accelerations come from `clusters`
        (
            "turning",
            "i8",
        ),  # 1 while it goes round an edge or corner, see `turning_contact`
        ("next_output", "i8"),  # index of the first output time not yet written
        # Solids it touches, in contacts that last: gap and normal velocity are zero.
        ("touched_count", "i8"),
        ("touched", "i8", MOST_TOUCHED),
    ],
    align=True,
)
"""A sphere, its motion in the present phase, and what it touches."""

PLANE, SHEET, BOX = range(3)
"""Kinds of solids: without an edge, one-sided polygon, box."""

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
        (
            "direction",
            "f8",
            3,
        ),  # outward normal of a face or side, direction of an edge
        ("offset", "f8"),  # m, of a face or side
        ("point", "f8", 3),  # m, where an edge starts, or the corner
        ("length", "f8"),  # m, of an edge
        ("low", "f8", 3),  # m, bounds along the world's axes, not of a side
        ("high", "f8", 3),
    ],
    align=True,
)
"""A face, side, edge or corner of a sheet or box."""

MEMBER = np.dtype([("object", "i8")])
"""One object of those that `clusters.gather` has found."""

CONTACT = np.dtype(
    [
        ("first", "i8"),  # object
        ("second", "i8"),  # object, or -1 - s for solid s
        ("normal", "f8", 3),  # towards the first
        ("least_speed", "f8"),  # m/s, along the normal at the step's end
        ("slip", "f8"),  # m/s, at the step's start
        ("normal_impulse", "f8"),  # N s, as are the next two, times m
        ("friction", "f8", 3),
        ("torque", "f8", 3),
        ("until", "f8"),  # s, end of the step that the impulses are of, below zero if of none
    ],
    align=True,
)
"""One contact of a cluster, and the impulses of the last step that it was in."""

PAIR = np.dtype(
    [
        ("touches", "i8"),  # 1 in a contact that lasts
        ("impact_time", "f8"),  # s, infinite if none
    ],
    align=True,
)
"""Two objects."""

WORLD = np.dtype(
    [
        # Addresses of arrays, see `pointers`.
        ("objects", "i8"),  # (O,) OBJECT
        ("solids", "i8"),  # (S,) SOLID, planes first
        ("features", "i8"),  # (F,) FEATURE
        ("members", "i8"),  # (O,) MEMBER, scratch of `clusters`
        ("contacts", "i8"),  # CONTACT, scratch of `clusters`
        ("pairs", "i8"),  # PAIR: that of objects i and j > i is j (j - 1) / 2 + i
        ("contact_room", "i8"),  # how many contacts there can be
        ("object_count", "i8"),
        ("solid_count", "i8"),
        ("planes", "i8"),  # number of planes without an edge
        ("turns", "i8"),  # 1 if orientations are wanted
        ("end", "f8"),  # s, last output time
        *COMMON_FIELDS,
    ],
    align=True,
)
"""A world while it is rolled out: addresses of its arrays, and what they have in common."""

_object, _solid, _feature = record_getter(OBJECT), record_getter(SOLID), record_getter(FEATURE)
_contact, _pair = record_getter(CONTACT), record_getter(PAIR)
_member = record_getter(MEMBER)


@inlined
def object_at(world, i):
    return _object(world.objects, i)


@inlined
def member_at(world, k):
    """Index of the k-th object of those that `clusters.gather` has found."""
    return _member(world.members, k).object


@inlined
def set_member(world, k, i):
    """Let object i be the k-th of those that `clusters.gather` has found."""
    _member(world.members, k).object = i


@inlined
def solid_at(world, s):
    return _solid(world.solids, s)


@inlined
def feature_at(world, f):
    return _feature(world.features, f)


@inlined
def contact_at(world, c):
    return _contact(world.contacts, c)


@inlined
def pair_at(world, k):
    return _pair(world.pairs, k)


@inlined
def solid_coefficient(world, kind, i, s):
    """One of the four coefficients between object i and solid s."""
    return coefficient(world, kind, object_at(world, i).material, solid_at(world, s).material)


@inlined
def object_coefficient(world, kind, i, j):
    """One of the four coefficients between objects i and j."""
    return coefficient(world, kind, object_at(world, i).material, object_at(world, j).material)


@inlined
def pair_index(i, j):
    """Index of objects i and j, either of which may be the larger, in the world's pairs."""
    return (j * (j - 1)) // 2 + i if i < j else (i * (i - 1)) // 2 + j


@inlined
def touches(body, s):
    """Whether a body is in lasting contact with solid s."""
    found = False
    for k in range(body.touched_count):
        found = found or body.touched[k] == s
    return found


@kernel
def touch(world, body, s):
    """Take note that a body touches solid s."""
    if touches(body, s):
        return
    if body.touched_count == MOST_TOUCHED:
        world.status = TOO_MANY_CONTACTS
    else:
        body.touched[body.touched_count] = s
        body.touched_count += 1


@inlined
def forget_touched(body, k):
    """Strike out the k-th solid a body touches; the last one takes its place."""
    body.touched_count -= 1
    body.touched[k] = body.touched[body.touched_count]


@inlined
def lift(body, n, gap):
    """Move a body along the normal n so that a gap (m) closes."""
    store(body.position, add_scaled(load(body.position), n, -gap))


@kernel
def part_overlap(one, other):
    """Move two overlapping bodies apart, the lighter one further; return whether they did."""
    apart = sub(load(one.position), load(other.position))
    distance = norm(apart)
    overlap = one.radius + other.radius - distance
    if not overlap > 0.0:
        return False
    n = scaled(apart, 1.0 / distance) if distance > 0.0 else (0.0, 0.0, 1.0)
    share = overlap / (one.mass + other.mass)
    store(one.position, add_scaled(load(one.position), n, share * other.mass))
    store(other.position, add_scaled(load(other.position), n, -share * one.mass))
    return True
