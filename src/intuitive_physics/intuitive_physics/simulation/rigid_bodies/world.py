"""The state of one world while it is stepped.

Everything is a record, so that a kernel gets a pointer to it. Every shape is a core (a point, a
segment or a box, given by its half extents) that is rounded by a radius.
"""

from __future__ import annotations

import numpy as np

from intuitive_physics.kernels import fast_inlined
from intuitive_physics.kernels.pointers import record_getter
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics.simulation.world_record import COMMON_FIELDS

WARM_STARTS = 16
"""Contacts of one body whose forces the next step's search starts from; others start from none."""

MOST_PLANES = 64
"""Planes of which some may be bounded: each of those has a bit in a body's `behind`."""

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
    ],
    align=True,
)
"""A body: what it is, its motion over a part of a step, and its sleep."""

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
"""One body of the island that is being stepped."""

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
_member = record_getter(MEMBER)
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
def plane_at(world, p):
    return _plane(world.planes, p)


@fast_inlined
def contact_at(world, c):
    return _contact(world.contacts, c)


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


CONTACTS_A_BODY = 48
"""Room for contacts for each body that moves; with more in all, a world stops."""

MOST_ROWS = 384
"""Most equations that are solved directly: 64 contacts with rolling friction, 128 without."""


class Scratch:
    """Room for one world; the arrays live as long as this does.

    Parameters
    ----------
    moving, boxes, planes, corners : the most that it has of each, corners of one plane
    contacts_a_body : 0 where only gaps are asked for
    """

    def __init__(
        self,
        moving: int,
        boxes: int,
        planes: int,
        corners: int,
        contacts_a_body: int = CONTACTS_A_BODY,
    ) -> None:
        self.bodies = np.zeros(moving + boxes, BODY)
        self.warm_starts = np.zeros((moving, WARM_STARTS), WARM_START)
        self.planes = np.zeros(planes, PLANE)
        self.contacts = np.zeros(contacts_a_body * moving, CONTACT)
        # Each half-space that cuts a convex polygon adds at most one corner to it: four of another
        # box's face, or one at each edge of a plane.
        self.clipped = np.zeros((2, 4 + max(4, corners), 3))
        self.members = np.zeros(moving + boxes, MEMBER)
        self.rows = np.zeros(min(6 * len(self.contacts), MOST_ROWS), ROW)
        self.matrix = np.zeros((len(self.rows), len(self.rows)))
        self.right = np.zeros(len(self.rows))
        self.world = np.zeros(1, WORLD)
        for name in (
            "bodies",
            "warm_starts",
            "planes",
            "contacts",
            "clipped",
            "members",
            "rows",
            "matrix",
        ):
            self.world[name] = getattr(self, name).ctypes.data
        self.world["right"] = self.right.ctypes.data
        self.world["row_room"] = len(self.rows)
        self.world["contact_room"] = len(self.contacts)
        self.world["clipped_room"] = self.clipped.shape[1]


def scratch_sizes(worlds: WorldBatch) -> tuple[int, int, int, int]:
    """Return how many moving bodies, boxes, planes and corners a batch's worlds have at most."""
    moving = int(worlds.object_counts.max())
    return moving, worlds.boxes.shape[1], worlds.planes.shape[1], worlds.corners.shape[2]
