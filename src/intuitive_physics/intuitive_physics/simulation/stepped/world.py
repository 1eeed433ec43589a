"""The state of one world while it is stepped.

Everything is a record, so that a kernel gets a pointer to it. Every shape is a core (a point, a
segment or a box, given by its half extents) that is rounded by a radius.
"""

from __future__ import annotations

import numpy as np

from intuitive_physics.kernels import fast_inlined
from intuitive_physics.kernels.pointers import record_getter
from intuitive_physics.simulation.world_record import COMMON_FIELDS

KEPT = 16
"""Contacts of one body whose impulses are kept to start the next step's search with."""

CLIPPED = 16
"""Corners that the intersection of a face with a convex polygon may have."""

BODY = np.dtype(
    [
        ("position", "f8", 3),  # m, of the shape's centre
        ("velocity", "f8", 3),  # m/s, of the centre of mass
        ("spin", "f8", 3),  # rad/s, in the world's axes
        ("orientation", "f8", 4),  # (x, y, z, w)
        ("rotation", "f8", 9),  # the same as a matrix, row by row
        ("inverse_inertia", "f8", 9),  # 1/(kg m²), in the world's axes, row by row
        # What the body is.
        ("half_extents", "f8", 3),  # m, of the core
        ("radius", "f8"),  # m, around the core
        ("reach", "f8"),  # m, from either centre no point is farther, however it turns
        ("lever", "f8", 3),  # m, from the shape's centre to that of mass, in the body's axes
        ("lopsided", "i8"),  # 1 where the two are not one
        ("thinness", "f8"),  # m, from the centre to the nearest point of the surface
        ("inverse_mass", "f8"),  # 1/kg
        ("inertia", "f8", 3),  # kg m², about the body's axes
        ("own_inverse_inertia", "f8", 3),  # 1/(kg m²), its inverse
        ("inertia_ratio", "f8"),  # κ = I / (m r²) about the axis it rolls about
        ("euler", "f8", 3),  # (I_y - I_z) / I_x and so on, as in Euler's equations
        ("round", "i8"),  # 1 where all three are alike
        ("kind", "i8"),
        ("material", "i8"),
        ("drag", "f8"),  # kg/m
        ("magnus", "f8"),  # kg
        # Its motion over the present part of a step, from the part's start on.
        ("start_position", "f8", 3),  # of the centre of mass
        ("start_orientation", "f8", 4),
        ("start_velocity", "f8", 3),
        ("start_spin", "f8", 3),
        ("acceleration", "f8", 3),  # m/s²
        # The path is x + v τ + a τ²/2 with its own v and a: see `motion.plan_pressed`.
        ("path_velocity", "f8", 3),  # m/s
        ("path_acceleration", "f8", 3),  # m/s²
        ("turning", "f8", 3),  # rad/s, mean
        ("angular_momentum", "f8", 3),  # N m s, at the start
        ("torque", "f8", 3),  # N m
        ("placed_after", "f8"),  # s after the part's start, where `motion.place` has put it
        ("pressed", "i8"),  # 1 while contacts act on it
        ("steady", "i8"),  # 1 while they neither part nor close
        ("behind", "i8"),  # bit p is set once it has come behind the bounded plane p
        # Sleep and islands.
        ("quiet_steps", "i8"),
        ("asleep", "i8"),
        ("island", "i8"),
        ("member", "i8"),  # scratch of `kernel`: entry a is the a-th body of an island
        ("next_output", "i8"),
        # The last step's contact forces (N, N, N and N m), in the world's axes.
        ("kept", "i8"),
        ("kept_seconds", "i8", KEPT),  # what it touched
        ("kept_arms", "f8", (KEPT, 3)),  # m, and where
        ("kept_forces", "f8", (KEPT, 3)),
        ("kept_torques", "f8", (KEPT, 3)),
    ],
    align=True,
)

PLANE = np.dtype(
    [
        ("normal", "f8", 3),
        ("offset", "f8"),
        ("material", "i8"),
        ("corners", "i8"),  # of its boundary, 0 where it has none
        ("boundary", "i8"),  # address of its corners
    ],
    align=True,
)

CONTACT = np.dtype(
    [
        ("first", "i8"),  # body that moves
        ("second", "i8"),  # body, or -1 - p for plane p
        ("gap", "f8"),  # m, below zero where the two overlap
        # Rows: normal, towards the first; along the slip; across it.
        ("axes", "f8", (3, 3)),
        ("normal", "f8", 3),  # the true one while an impact's noise tilts `axes`
        ("arm", "f8", 3),  # m, from the first's centre of mass
        ("other_arm", "f8", 3),  # m, from the second's centre of mass
        ("lever", "f8", (3, 3)),  # arm × axis
        ("other_lever", "f8", (3, 3)),
        ("turn", "f8", (3, 3)),  # rad/s of the first for 1 N s along each axis
        ("other_turn", "f8", (3, 3)),
        ("softness", "f8", 3),  # 1/kg: change of speed along each axis for 1 N s
        ("stiffness", "f8", 3),  # kg: its inverse
        ("impulse", "f8", 3),  # N s
        ("torque", "f8", 3),  # N m s of rolling friction, in the world's axes
        ("roll_softness", "f8"),  # 1/(kg m): change of speed at the surface for 1 N m s
        ("roll_stiffness", "f8"),  # kg m²
        ("roll_radius", "f8"),  # m: μ_r r
        ("roll_limit", "f8"),  # m: what of it holds now
        ("first_speed", "f8"),  # m/s along the normal before
        ("least_speed", "f8"),  # m/s along the normal afterwards
        ("static", "f8"),
        ("dynamic", "f8"),
        ("restitution", "f8"),
        ("friction", "f8"),  # the coefficient that holds now
        ("sticks", "i8"),  # 1 where it slipped slower than STICK_SPEED when it was prepared
        ("rolls", "i8"),  # 1 while rolling friction acts
        ("active", "i8"),  # 1 while the solver looks at it
    ],
    align=True,
)

WORLD = np.dtype(
    [
        # Addresses of arrays, see `pointers`.
        ("bodies", "i8"),  # (n + b,) BODY: n that move, then the environment's boxes
        ("planes", "i8"),  # (P,) PLANE
        ("contacts", "i8"),  # (contact_room,) CONTACT, scratch
        ("clipped", "i8"),  # (2, CLIPPED, 3) float64, m, scratch: two polygons
        ("times", "i8"),  # (T,) float64, s
        ("positions", "i8"),  # (n, T, 3) float64 to be filled
        ("orientations", "i8"),  # (n, T, 4) float64 to be filled, 0 if not wanted
        ("moving", "i8"),  # n
        ("body_count", "i8"),
        ("plane_count", "i8"),
        ("contact_room", "i8"),
        ("output_count", "i8"),  # outputs wanted in this world
        ("output_room", "i8"),  # T
        ("gravity_size", "f8"),  # m/s²
        *COMMON_FIELDS,
    ],
    align=True,
)

_body, _plane = record_getter(BODY), record_getter(PLANE)
_contact = record_getter(CONTACT)


@fast_inlined
def body_at(world, i):
    return _body(world.bodies, i)


@fast_inlined
def member_at(world, a):
    """Index of the a-th body of the island that is being stepped."""
    return _body(world.bodies, a).member


@fast_inlined
def plane_at(world, p):
    return _plane(world.planes, p)


@fast_inlined
def contact_at(world, c):
    return _contact(world.contacts, c)


@fast_inlined
def clipped_polygon(world, side):
    """Address of one of the two polygons for `clipping`, each with room for CLIPPED corners."""
    return world.clipped + side * CLIPPED * 24


@fast_inlined
def column(array, k):
    """Column k of a matrix that is stored row by row: axis k of a rotated body."""
    return array[k], array[3 + k], array[6 + k]


@fast_inlined
def times(matrix, a):
    """A matrix, stored row by row, times a vector."""
    return (
        matrix[0] * a[0] + matrix[1] * a[1] + matrix[2] * a[2],
        matrix[3] * a[0] + matrix[4] * a[1] + matrix[5] * a[2],
        matrix[6] * a[0] + matrix[7] * a[1] + matrix[8] * a[2],
    )


@fast_inlined
def transposed_times(matrix, a):
    """The transpose of a matrix, stored row by row, times a vector."""
    return (
        matrix[0] * a[0] + matrix[3] * a[1] + matrix[6] * a[2],
        matrix[1] * a[0] + matrix[4] * a[1] + matrix[7] * a[2],
        matrix[2] * a[0] + matrix[5] * a[1] + matrix[8] * a[2],
    )
