"""Newton's method on the contact laws, for what sweeps do not end.

The laws say that each impulse stays as it is when the speed it works against is taken from it and
the result is projected onto what the contact can transmit (Alart and Curnier, 1991): J_n is not
below zero, J_t in its disc of μ J_n, and the rolling torque likewise. Each step solves these
equations with the projections linearised: a row for a speed that is to vanish (pressing, sticking),
or for an impulse that is at its limit (slipping).
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import add, dot, load, scaled, store
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.kernels.pointers import float_at, put_float
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    contact_at,
    row_at,
    times,
)
from intuitive_physics.simulation.stepped.contacts import (
    push,
    relative_spin,
    speed_along,
    twist,
)

SINGULAR = 1e-13
"""Largest element of a column, of rows whose own element is about one, below which there is no
solution."""

LARGEST_CHANGE = 1e6
"""m/s. Largest change of an impulse in a step, over the effective mass of its contact. Larger
changes of redundant contacts nearly cancel, and rounding makes the velocities inexact."""


@kernel
def newton_step(world, first, last, softness):
    """Take one step over the active contacts from `first` to `last` (exclusive).

    `softness` is added to the compliance of each contact, as a part of it, so that redundant
    contacts, such as the four corners of a face, distribute the change of impulse among them.

    Returns the number of equations, or 0 where no step was taken: where there is no room for so
    many contacts, or the linearised laws have no solution within `LARGEST_CHANGE`. Impulses may be
    outside their limits afterwards: a sweep brings them back.
    """
    rows = _list_rows(world, first, last)
    if rows == 0:
        return 0
    r = 0
    while r < rows:
        r = _write_laws(world, r, rows, softness)
    if not (_eliminate(world, rows) and _is_bounded(world, rows)):
        return 0
    change_impulses(world, rows, 1.0)
    return rows


@kernel
def change_impulses(world, rows, share):
    """Change the impulses of the first `rows` equations by a share of the last Newton step."""
    for r in range(rows):
        _change_impulse(world, row_at(world, r), share * float_at(world.right, r))


@kernel
def _list_rows(world, first, last):
    """Write a row for each impulse and torque of the contacts that press; return how many, or 0."""
    rows = 0
    for c in range(first, last):
        contact = contact_at(world, c)
        if contact.active == 1 and (contact.impulse[0] != 0.0 or _closes(world, contact)):
            count = 6 if contact.rolls == 1 else 3
            if rows + count > world.row_room:
                return 0
            for axis in range(count):
                _write_row(world, row_at(world, rows + axis), c, axis)
            rows += count
    return rows


@fast_inlined
def _closes(world, contact):
    return speed_along(world, contact, 0) < contact.least_speed


@kernel
def _write_row(world, row, c, axis):
    """Fill in a row: axes 0 to 2 are the contact's for impulses, 3 to 5 the same for torques."""
    contact = contact_at(world, c)
    row.contact, row.axis = c, axis
    row.first, row.second = contact.first, contact.second
    if axis < 3:
        store(row.linear, load(contact.axes[axis]))
        store(row.lever, load(contact.lever[axis]))
        store(row.turn, load(contact.turn[axis]))
        store(row.other_lever, load(contact.other_lever[axis]))
        store(row.other_turn, load(contact.other_turn[axis]))
        row.scale = contact.effective_mass[0] if axis == 0 else contact.grip_mass
        row.impulse = contact.impulse[axis]
        row.speed = speed_along(world, contact, axis)
        if axis == 0:
            row.speed -= contact.least_speed
        return
    direction = load(contact.axes[axis - 3])
    store(row.linear, (0.0, 0.0, 0.0))
    store(row.lever, direction)
    store(row.turn, times(body_at(world, contact.first).inverse_inertia, direction))
    if contact.second >= 0:
        store(row.other_lever, direction)
        other = body_at(world, contact.second)
        store(row.other_turn, times(other.inverse_inertia, direction))
    row.scale = contact.rolling_inertia
    row.impulse = dot(load(contact.torque), direction)
    row.speed = dot(relative_spin(world, contact), direction)


@kernel
def _write_laws(world, r, rows, softness):
    """Write the linear equations of the contact whose rows begin at r; return where they end."""
    normal = row_at(world, r)
    contact = contact_at(world, normal.contact)
    if normal.impulse - normal.scale * normal.speed > 0.0:
        _let_vanish(world, r, rows, softness)
    else:
        _write_change(world, r, rows, -normal.impulse)
    _write_disc(world, r + 1, r, contact.friction, rows, softness)
    if contact.rolls == 0:
        return r + 3
    _write_pivot(world, r + 3, r, contact.roll_limit, rows, softness)
    _write_disc(world, r + 4, r, contact.roll_limit, rows, softness)
    return r + 6


@kernel
def _let_vanish(world, r, rows, softness):
    """Write that the speed of row r is none afterwards."""
    row = row_at(world, r)
    for k in range(rows):
        _put(world, r, k, row.scale * _response(world, row, row_at(world, k)))
    _put(world, r, r, _at(world, r, r) + softness)
    put_float(world.right, r, -row.scale * row.speed)


@kernel
def _write_change(world, r, rows, change):
    """Write that the impulse of row r changes by a number."""
    for k in range(rows):
        _put(world, r, k, 0.0)
    _put(world, r, r, 1.0)
    put_float(world.right, r, change)


@kernel
def _write_pivot(world, r, normal, limit, rows, softness):
    """Write the law of an impulse between -limit J_n and limit J_n."""
    row = row_at(world, r)
    most = limit * max(row_at(world, normal).impulse, 0.0)
    asked = row.impulse - row.scale * row.speed
    if abs(asked) <= most:
        _let_vanish(world, r, rows, softness)
        return
    sense = 1.0 if asked > 0.0 else -1.0
    _write_change(world, r, rows, sense * most - row.impulse)
    _put(world, r, normal, -sense * limit)


@kernel
def _write_disc(world, r, normal, limit, rows, softness):
    """Write the law of the two impulses of rows r and r + 1 in a disc of the radius limit J_n.

    Outside it they are L ŷ with y = J - e u and L = limit J_n, of which the derivative is
    limit ŷ dJ_n + (L / |y|) (1 - ŷ ŷᵀ) dy.
    """
    one, other = row_at(world, r), row_at(world, r + 1)
    most = limit * max(row_at(world, normal).impulse, 0.0)
    x = one.impulse - one.scale * one.speed
    y = other.impulse - other.scale * other.speed
    size = sqrt(x * x + y * y)
    if size <= most:
        _let_vanish(world, r, rows, softness)
        _let_vanish(world, r + 1, rows, softness)
        return
    x, y, share = x / size, y / size, most / size
    _write_change(world, r, rows, most * x - one.impulse)
    _write_change(world, r + 1, rows, most * y - other.impulse)
    if share > 0.0:
        for k in range(rows):
            along = -one.scale * _response(world, one, row_at(world, k))
            across = -other.scale * _response(world, other, row_at(world, k))
            along += 1.0 if k == r else 0.0
            across += 1.0 if k == r + 1 else 0.0
            outward = x * along + y * across
            _put(world, r, k, _at(world, r, k) - share * (along - x * outward))
            _put(world, r + 1, k, _at(world, r + 1, k) - share * (across - y * outward))
    _put(world, r, normal, _at(world, r, normal) - limit * x)
    _put(world, r + 1, normal, _at(world, r + 1, normal) - limit * y)


@fast_inlined
def _at(world, r, k):
    return float_at(world.matrix, r * world.row_room + k)


@fast_inlined
def _put(world, r, k, value):
    put_float(world.matrix, r * world.row_room + k, value)


@kernel
def _response(world, row, cause):
    """Speed of a row from a unit of another one's impulse, through the bodies they share."""
    speed = 0.0
    along = dot(load(row.linear), load(cause.linear))
    mobility = body_at(world, row.first).inverse_mass
    if row.first == cause.first:
        speed += mobility * along + dot(load(row.lever), load(cause.turn))
    elif row.first == cause.second:
        speed -= mobility * along + dot(load(row.lever), load(cause.other_turn))
    if row.second >= 0:
        mobility = body_at(world, row.second).inverse_mass
        if row.second == cause.second:
            speed += mobility * along + dot(load(row.other_lever), load(cause.other_turn))
        elif row.second == cause.first:
            speed -= mobility * along + dot(load(row.other_lever), load(cause.turn))
    return speed


@kernel
def _eliminate(world, n):
    """Solve the n equations into `right` (Gauss, partial pivots); whether there is a solution."""
    room, matrix, right = world.row_room, world.matrix, world.right
    for k in range(n):
        pivot = k
        for r in range(k + 1, n):
            if abs(float_at(matrix, r * room + k)) > abs(float_at(matrix, pivot * room + k)):
                pivot = r
        if not abs(float_at(matrix, pivot * room + k)) > SINGULAR:
            return False
        if pivot != k:
            _swap(matrix, k * room, pivot * room, k, n)
            _swap(right, 0, pivot - k, k, k + 1)
        for r in range(k + 1, n):
            factor = float_at(matrix, r * room + k) / float_at(matrix, k * room + k)
            if factor != 0.0:
                _subtract(matrix, r * room, k * room, factor, k + 1, n)
                put_float(right, r, float_at(right, r) - factor * float_at(right, k))
    for step in range(n):
        k = n - 1 - step
        value = float_at(right, k)
        for j in range(k + 1, n):
            value -= float_at(matrix, k * room + j) * float_at(right, j)
        put_float(right, k, value / float_at(matrix, k * room + k))
    return True


@kernel
def _is_bounded(world, rows):
    for r in range(rows):
        if not abs(float_at(world.right, r)) < LARGEST_CHANGE * row_at(world, r).scale:
            return False
    return True


@fast_inlined
def _swap(array, one, other, first, last):
    for k in range(first, last):
        value = float_at(array, one + k)
        put_float(array, one + k, float_at(array, other + k))
        put_float(array, other + k, value)


@fast_inlined
def _subtract(matrix, row, other, factor, first, last):
    for k in range(first, last):
        put_float(matrix, row + k, float_at(matrix, row + k) - factor * float_at(matrix, other + k))


@kernel
def _change_impulse(world, row, change):
    contact = contact_at(world, row.contact)
    if row.axis < 3:
        contact.impulse[row.axis] += change
        push(world, contact, row.axis, change)
    else:
        torque = scaled(load(contact.axes[row.axis - 3]), change)
        store(contact.torque, add(load(contact.torque), torque))
        twist(world, contact, torque)
