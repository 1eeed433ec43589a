"""A world's outputs: when, and where they are written."""

from __future__ import annotations

from math import isfinite, nan

from intuitive_physics.geometry.vectors import load
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.kernels.pointers import float_at, put_float
from intuitive_physics.simulation.rigid_bodies.world import body_at
from intuitive_physics.simulation.rollout import NOT_FINITE

TIME_ROUNDING = 1e-12
"""s. An output this little after a step's end belongs to it."""


@kernel
def write_rest(world, i, end):
    """Write the outputs of a body that does not move, up to and including time `end`."""
    body = body_at(world, i)
    k = body.next_output
    while k < world.output_count and output_time(world, k) <= end + TIME_ROUNDING:
        write_position(world, i, k, load(body.position))
        if world.orientations != 0:
            write_orientation(world, i, k)
        k += 1
    body.next_output = k


@fast_inlined
def output_time(world, k):
    return float_at(world.times, k)


@fast_inlined
def write_position(world, i, k, position):
    at = 3 * (i * world.output_room + k)
    for c in range(3):
        put_float(world.positions, at + c, position[c])


@fast_inlined
def write_orientation(world, i, k):
    at = 4 * (i * world.output_room + k)
    orientation = body_at(world, i).orientation
    for c in range(4):
        put_float(world.orientations, at + c, orientation[c])


@kernel
def blank_rest(world, objects):
    """Write NaN where there is no output: after a stop, for unwanted times and absent objects.

    `objects` is the number of objects there is room for.
    """
    for i in range(objects):
        first = 0
        if i < world.moving:
            first = body_at(world, i).next_output
            if world.status == NOT_FINITE:
                first = _first_not_finite(world, i, first)
        for k in range(first, world.output_room):
            write_position(world, i, k, (nan, nan, nan))
            if world.orientations != 0:
                at = 4 * (i * world.output_room + k)
                for c in range(4):
                    put_float(world.orientations, at + c, nan)


@kernel
def _first_not_finite(world, i, last):
    for k in range(last):
        at = 3 * (i * world.output_room + k)
        x, y = float_at(world.positions, at), float_at(world.positions, at + 1)
        if not isfinite(x + y + float_at(world.positions, at + 2)):
            return k
    return last
