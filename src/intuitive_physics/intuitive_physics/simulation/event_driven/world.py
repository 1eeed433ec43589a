"""The state of one world while it is rolled out.

Objects, planes and contacts are records: a kernel gets a pointer to them, where every array among
its arguments would cost it two atomic operations a call to count references.
"""

from __future__ import annotations

from collections import namedtuple
from math import inf

import numpy as np
from numba import njit

from intuitive_physics.simulation.vectors import dot, load

OBJECT = np.dtype(
    [
        # Motion since the object's own `time`: x + v τ + a τ²/2 and ω + α τ.
        ("position", "f8", 3),  # m
        ("velocity", "f8", 3),  # m/s
        ("spin", "f8", 3),  # rad/s
        ("orientation", "f8", 4),  # (x, y, z, w)
        ("acceleration", "f8", 3),  # m/s²
        ("spin_acceleration", "f8", 3),  # rad/s²
        ("time", "f8"),  # s
        ("phase_end", "f8"),  # s, until when the accelerations hold
        ("radius", "f8"),  # m
        ("mass", "f8"),  # kg
        ("material", "i8"),
        ("clustered", "i8"),  # 1 while the accelerations come from `clusters`
        ("plane_impact_time", "f8"),  # s, of the next impact on a plane, infinite if none
        ("plane_impact", "i8"),  # index of that plane
        ("next_output", "i8"),  # index of the first output time not yet written
        ("member", "i8"),  # scratch of `clusters.gather`: entry k is its k-th object
    ],
    align=True,
)

PLANE = np.dtype([("normal", "f8", 3), ("offset", "f8"), ("material", "i8")], align=True)

CONTACT = np.dtype(
    [
        ("first", "i8"),  # object
        ("second", "i8"),  # object, or -1 - p for plane p
        ("normal", "f8", 3),  # towards the first
        ("least_speed", "f8"),  # m/s, along the normal at the step's end
        ("slip", "f8"),  # m/s, at the step's start
        ("normal_impulse", "f8"),  # N s, as are the next two, times m
        ("friction", "f8", 3),
        ("torque", "f8", 3),
    ],
    align=True,
)

World = namedtuple(
    "World",
    [
        "objects",  # (O,) OBJECT
        "planes",  # (P,) PLANE
        "contacts",  # (O (P + O),) CONTACT, scratch of `clusters`
        # Contacts that last: gap and normal velocity are zero.
        "touches_plane",  # (O, P) bool
        "touches_object",  # (O, O) bool
        "object_impact_time",  # (O, O) s, for i < j, infinite if none
        "gravity",  # (3,) m/s²
        "coefficients",  # (4, m, m)
    ],
)

STATIC, DYNAMIC, ROLLING, RESTITUTION = range(4)


@njit(cache=True)
def make_world(objects, planes, gravity, coefficients):
    """Allocate a world of so many objects and planes."""
    world = World(
        np.zeros(objects, OBJECT),
        np.zeros(planes, PLANE),
        np.zeros(objects * (planes + objects), CONTACT),
        np.zeros((objects, planes), np.bool_),
        np.zeros((objects, objects), np.bool_),
        np.full((objects, objects), inf),
        gravity,
        coefficients,
    )
    for i in range(objects):
        world.objects[i].phase_end = inf
        world.objects[i].plane_impact_time = inf
    return world


@njit(inline="always")
def plane_coefficient(world, kind, i, p):
    """One of the four coefficients between object i and plane p."""
    return world.coefficients[kind, world.objects[i].material, world.planes[p].material]


@njit(inline="always")
def object_coefficient(world, kind, i, j):
    """One of the four coefficients between objects i and j."""
    return world.coefficients[kind, world.objects[i].material, world.objects[j].material]


@njit(inline="always")
def inertia(body):
    """Moment of inertia of a solid sphere, 2/5 m r², in kg m²."""
    return 0.4 * body.mass * body.radius * body.radius


@njit(inline="always")
def plane_gap(body, plane):
    """Distance in m between a body's surface and a plane."""
    return dot(load(body.position), load(plane.normal)) - plane.offset - body.radius
