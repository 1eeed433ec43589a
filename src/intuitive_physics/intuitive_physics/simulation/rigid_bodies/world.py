"""The state of one world while it is stepped.

Everything is a record, so that a kernel gets a pointer to it. Every shape is a core (a point, a
segment or a box, given by its half extents) that is rounded by a radius.
"""

from __future__ import annotations

from math import isfinite

import numpy as np

from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.kernels.pointers import record_getter
from intuitive_physics.simulation.world_record import COMMON_FIELDS

WARM_STARTS = 16
"""Contacts of one body whose forces the next step's search starts from; others start from none."""

MOST_PLANES = 64
"""Planes of which some may be bounded: each of those has a bit in a body's `behind`."""

MOST_TOUCHED = 12
"""Solids that one sphere can touch at once; one more and the world stops, TOO_MANY_CONTACTS."""

LEVELS = 4
"""Spans over which islands are looked for."""

BODY = np.dtype(
    [
        ("position", "f8", 3),  # m, of the shape's centre
        ("velocity", "f8", 3),  # m/s, of the centre of mass
        ("spin", "f8", 3),  # rad/s, in the world's axes
        ("reach", "f8"),  # m, from either centre no point is farther, however it turns
        ("asleep", "i8"),
        ("island", "i8", LEVELS),  # over each of the spans of `islands`
        ("alone", "i8"),  # 1 while it is the only body of its island
        ("done", "i8"),  # steps over which it has been carried
        ("fastest", "f8"),  # m/s, a bound of its speed, …
        ("pull", "f8"),  # m/s², … which grows by so much at most
        ("orientation", "f8", 4),  # (x, y, z, w)
        ("rotation", "f8", 9),  # the same as a matrix, row by row
        ("inverse_inertia", "f8", 9),  # 1/(kg m²), in the world's axes, row by row
        # What the body is.
        ("half_extents", "f8", 3),  # m, of the core
        ("radius", "f8"),  # m, around the core
        ("centre_offset", "f8", 3),  # m, of the centre of mass, in the body's axes
        ("off_centre", "i8"),  # 1 where the two are not one
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
        ("next_output", "i8"),
        ("warm_starts", "i8"),  # of its contacts that have one, see `WARM_START`
        # Of a sphere in closed form, see `spheres`: its motion since its own `time` is
        # x + v τ + a τ²/2 and ω + α τ, with the acceleration above.
        ("exact", "i8"),  # 1 where it may be carried so
        ("followed", "i8"),  # 1 while what it touches is known from its last event
        ("mass", "f8"),  # kg
        ("spin_acceleration", "f8", 3),  # rad/s²
        ("end_velocity", "f8", 3),  # m/s, at `phase_end` where `rounds_edge`
        ("time", "f8"),  # s
        ("phase_end", "f8"),  # s, until when the accelerations hold
        # Of a force along the surface, the part that accelerates a sphere in rolling contact,
        # 1 / (1 + κ); friction takes the rest.
        ("rolling_share", "f8"),
        # Change of the spin's r ω, and of the slip, per change of velocity by friction.
        ("spin_gain", "f8"),  # 1 / κ
        ("slip_gain", "f8"),  # 1 + 1 / κ
        ("impact_time", "f8"),  # s, of the next impact on a solid, infinite if none
        ("impact_solid", "i8"),  # index of that solid
        ("pair_time", "f8"),  # s, of its next impact on a sphere before it, infinite if none
        ("pair_with", "i8"),  # index of that sphere
        ("clustered", "i8"),  # 1 while the accelerations come from `clusters`
        ("rounds_edge", "i8"),  # 1 while it goes round an edge or corner
        # Solids it touches, in contacts that last: gap and normal velocity are zero.
        ("touched_count", "i8"),
        ("touched", "i8", MOST_TOUCHED),
    ],
    align=True,
)
"""A body: what it is, its motion over a part of a step or a phase, and its sleep."""

WARM_START = np.dtype(
    [
        ("second", "i8"),  # what the body touched
        ("arm", "f8", 3),  # m, and where, from its centre of mass
        ("force", "f8", 3),  # N
        ("torque", "f8", 3),  # N m
    ],
    align=True,
)
"""The force of a contact in the last step, in the world's axes."""

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
"""A plane that never moves, bounded where it has corners."""

CONTACT = np.dtype(
    [
        ("first", "i8"),  # body that moves
        ("second", "i8"),  # body, or -1 - p for plane p
        ("gap", "f8"),  # m, below zero where the two overlap
        ("on_face", "i8"),  # 1 where it is one of three or more that the two have
        # Rows: normal, towards the first; along the slip; across it.
        ("axes", "f8", (3, 3)),
        ("normal", "f8", 3),  # the true one while an impact's noise tilts `axes`
        ("arm", "f8", 3),  # m, from the first's centre of mass
        ("other_arm", "f8", 3),  # m, from the second's centre of mass
        ("lever", "f8", (3, 3)),  # arm × axis
        ("other_lever", "f8", (3, 3)),
        ("turn", "f8", (3, 3)),  # rad/s of the first for 1 N s along each axis
        ("other_turn", "f8", (3, 3)),
        ("inverse_effective_mass", "f8", 3),  # 1/kg: change of speed along each axis for 1 N s
        ("effective_mass", "f8", 3),  # kg: its inverse
        ("grip_mass", "f8"),  # kg: the smaller one of those along the surface
        ("impulse", "f8", 3),  # N s
        ("torque", "f8", 3),  # N m s of rolling friction, in the world's axes
        ("rolling_response", "f8"),  # 1/(kg m): change of speed at the surface for 1 N m s
        ("rolling_inertia", "f8"),  # kg m²
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
"""One point of contact, with the rows of its impulses."""

MEMBER = np.dtype([("body", "i8")])
"""One body of the island that is being stepped, or of the spheres that go from event to event."""

PAIR = np.dtype(
    [
        ("touches", "i8"),  # 1 in a contact that lasts
        ("impact_time", "f8"),  # s, infinite if none
    ],
    align=True,
)
"""Two spheres in closed form."""

SPHERE_CONTACT = np.dtype(
    [
        ("first", "i8"),  # sphere
        ("second", "i8"),  # sphere, or -1 - s for solid s
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
"""One contact of a cluster of spheres, and the impulses of the last step that it was in."""

ROW = np.dtype(
    [
        ("contact", "i8"),
        ("axis", "i8"),  # of the contact: 0 to 2 for impulses, 3 to 5 the same for torques
        ("first", "i8"),  # the contact's bodies
        ("second", "i8"),
        # Its speed is linear · v + lever · ω of the first, less the same of the second.
        ("linear", "f8", 3),
        ("lever", "f8", 3),  # m, or none for a torque
        ("other_lever", "f8", 3),
        ("turn", "f8", 3),  # rad/s of the first for one unit of the impulse
        ("other_turn", "f8", 3),
        ("impulse", "f8"),  # N s or N m s, so far
        ("speed", "f8"),  # m/s or rad/s, with it
        ("scale", "f8"),  # kg or kg m²: impulse that takes the speed away, about
    ],
    align=True,
)
"""One equation of `newton`: an impulse or torque of a contact, and the speed it acts on."""

WORLD = np.dtype(
    [
        # Addresses of arrays, see `pointers`.
        ("bodies", "i8"),  # (n + b,) BODY: n that move, then the environment's boxes
        ("warm_starts", "i8"),  # (n, WARM_STARTS) WARM_START
        ("planes", "i8"),  # (P,) PLANE
        ("contacts", "i8"),  # (contact_room,) CONTACT, scratch
        ("members", "i8"),  # (n + b,) MEMBER, of the island that is stepped
        ("followed", "i8"),  # (n,) MEMBER, of the spheres that go from event to event
        ("pairs", "i8"),  # PAIR: that of bodies i and j > i is j (j - 1) / 2 + i
        ("solids", "i8"),  # (S,) SOLID: planes, sheets, boxes
        ("features", "i8"),  # (F,) FEATURE
        ("sphere_contacts", "i8"),  # (sphere_contact_room,) SPHERE_CONTACT
        ("sphere_contact_room", "i8"),
        ("clipped", "i8"),  # (2, clipped_room, 3) float64, m, scratch: two polygons
        ("clipped_room", "i8"),
        ("rows", "i8"),  # (row_room,) ROW, scratch
        ("matrix", "i8"),  # (row_room, row_room) float64, scratch
        ("right", "i8"),  # (row_room,) float64, scratch
        ("row_room", "i8"),
        ("times", "i8"),  # (T,) float64, s
        ("positions", "i8"),  # (n, T, 3) float64 to be filled
        ("orientations", "i8"),  # (n, T, 4) float64 to be filled, 0 if not wanted
        ("moving", "i8"),  # n
        ("body_count", "i8"),
        ("plane_count", "i8"),
        ("contact_room", "i8"),
        ("followed_count", "i8"),
        ("closed_forms", "i8"),  # 1 where motion is carried in closed form wherever it has one
        ("events", "i8"),  # so far
        ("most_events", "i8"),
        ("solid_count", "i8"),
        ("open_planes", "i8"),  # solids that are planes without an edge
        ("end", "f8"),  # s, up to when events are looked for
        ("output_count", "i8"),  # outputs wanted in this world
        ("output_room", "i8"),  # T
        ("gravity_size", "f8"),  # m/s²
        *COMMON_FIELDS,
    ],
    align=True,
)
"""A world while it is stepped: addresses of its arrays, and what they have in common."""

_body, _plane = record_getter(BODY), record_getter(PLANE)
_contact = record_getter(CONTACT)
_warm_start = record_getter(WARM_START)
_sphere_contact = record_getter(SPHERE_CONTACT)
_member, _pair = record_getter(MEMBER), record_getter(PAIR)
_row = record_getter(ROW)


@fast_inlined
def body_at(world, i):
    return _body(world.bodies, i)


@fast_inlined
def member_at(world, a):
    """Index of the a-th body of the island that is being stepped."""
    return _member(world.members, a).body


@fast_inlined
def set_member(world, a, i):
    """Let body i be the a-th of the island that is being stepped."""
    _member(world.members, a).body = i


@fast_inlined
def followed_at(world, a):
    """Index of the a-th of the spheres that go from event to event."""
    return _member(world.followed, a).body


@fast_inlined
def set_followed(world, a, i):
    """Let body i be the a-th of the spheres that go from event to event."""
    _member(world.followed, a).body = i


@fast_inlined
def pair_of(world, i, j):
    """The record of two bodies that move, in either order."""
    return _pair(world.pairs, (j * (j - 1)) // 2 + i if i < j else (i * (i - 1)) // 2 + j)


@fast_inlined
def plane_at(world, p):
    return _plane(world.planes, p)


@fast_inlined
def contact_at(world, c):
    return _contact(world.contacts, c)


@fast_inlined
def sphere_contact_at(world, c):
    return _sphere_contact(world.sphere_contacts, c)


@fast_inlined
def warm_start_at(world, i, k):
    """The k-th warm start of body i."""
    return _warm_start(world.warm_starts, i * WARM_STARTS + k)


@fast_inlined
def row_at(world, r):
    return _row(world.rows, r)


@fast_inlined
def clipped_polygon(world, side):
    """Address of one of the two polygons for `clipping`, each of `clipped_room` corners."""
    return world.clipped + side * world.clipped_room * 24


@kernel
def is_finite(body):
    """Whether position and velocity of a body are numbers."""
    x, v = body.position, body.velocity
    return isfinite(x[0] + x[1] + x[2] + v[0] + v[1] + v[2])


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
