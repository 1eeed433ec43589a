"""The state of one world while it is rolled out."""

from __future__ import annotations

from collections import namedtuple
from math import inf

import numpy as np
from numba import njit

World = namedtuple(
    "World",
    [
        # Each object's motion since its own `time`: x + v τ + a τ²/2 and ω + α τ.
        "position",  # (O, 3) m
        "velocity",  # (O, 3) m/s
        "spin",  # (O, 3) rad/s
        "orientation",  # (O, 4)
        "acceleration",  # (O, 3) m/s²
        "spin_acceleration",  # (O, 3) rad/s²
        "time",  # (O,) s
        "phase_end",  # (O,) s, until when the accelerations hold
        "radius",  # (O,) m
        "mass",  # (O,) kg
        "material",  # (O,)
        "normal",  # (P, 3)
        "offset",  # (P,) m
        "plane_material",  # (P,)
        "gravity",  # (3,)
        "coefficients",  # (4, m, m)
        # Contacts that last: gap and normal velocity are zero.
        "touches_plane",  # (O, P) bool
        "touches_object",  # (O, O) bool
        "clustered",  # (O,) bool, whether the accelerations come from `clusters`
        # Next impacts as far as known, infinite if none.
        "plane_impact_time",  # (O,) s
        "plane_impact",  # (O,) index of that plane
        "object_impact_time",  # (O, O) s, for i < j
        "next_output",  # (O,) index of the first output time not yet written
        "members",  # (O,) scratch: objects of a cluster
        "contacts",  # (O (P + O), CONTACT_SIZE) scratch of `clusters`
    ],
)

CONTACT_SIZE = 14
STATIC, DYNAMIC, ROLLING, RESTITUTION = range(4)


@njit(cache=True)
def make_world(objects, planes, gravity, coefficients):
    """Allocate a world of up to so many objects and planes."""
    return World(
        np.zeros((objects, 3)),
        np.zeros((objects, 3)),
        np.zeros((objects, 3)),
        np.zeros((objects, 4)),
        np.zeros((objects, 3)),
        np.zeros((objects, 3)),
        np.zeros(objects),
        np.full(objects, inf),
        np.zeros(objects),
        np.zeros(objects),
        np.zeros(objects, np.int64),
        np.zeros((planes, 3)),
        np.zeros(planes),
        np.zeros(planes, np.int64),
        gravity,
        coefficients,
        np.zeros((objects, planes), np.bool_),
        np.zeros((objects, objects), np.bool_),
        np.zeros(objects, np.bool_),
        np.full(objects, inf),
        np.zeros(objects, np.int64),
        np.full((objects, objects), inf),
        np.zeros(objects, np.int64),
        np.zeros(objects, np.int64),
        np.zeros((objects * (planes + objects), CONTACT_SIZE)),
    )


@njit(inline="always")
def plane_coefficient(world, kind, i, p):
    """One of the four coefficients between object i and plane p."""
    return world.coefficients[kind, world.material[i], world.plane_material[p]]


@njit(inline="always")
def object_coefficient(world, kind, i, j):
    """One of the four coefficients between objects i and j."""
    return world.coefficients[kind, world.material[i], world.material[j]]


@njit(inline="always")
def inertia(world, i):
    """Moment of inertia of a solid sphere, 2/5 m r², in kg m²."""
    return 0.4 * world.mass[i] * world.radius[i] * world.radius[i]
