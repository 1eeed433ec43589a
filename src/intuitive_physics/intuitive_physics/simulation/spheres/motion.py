"""Evolve: carry spheres along their closed-form motion and write what was asked for.

Positions are parabolas. Orientations are those of bodies whose spin ω + α τ changes linearly.

Where ω keeps its direction, the rotation vector of the turn is its integral. Where it does not,
Magnus' expansion gives the rotation vector of a short piece: with a = h ω at the piece's middle,
b = h² α and c = a × b it is a + (-20 a + c) × (b - a × c / 60) / 240, to the sixth order in h
(S. Blanes et al., The Magnus expansion and some of its applications, Physics Reports 470, 2009).
"""

from __future__ import annotations

from intuitive_physics.geometry.quaternions import (
    axis_times,
    load_quaternion,
    store_quaternion,
    turned_by,
)
from intuitive_physics.geometry.vectors import (
    add,
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    store,
)
from intuitive_physics.kernels import inlined, kernel
from intuitive_physics.kernels.pointers import float_at, put_float
from intuitive_physics.simulation.rigid_bodies.outputs import output_time, write_orientation
from intuitive_physics.simulation.rigid_bodies.world import body_at

LONGEST_TURN = 0.15
"""rad. A piece of a motion whose spin changes direction turns no further."""

MOST_PIECES = 100_000
"""Pieces of one motion, whatever its spin."""

SAME_DIRECTION = 1e-13
"""rad. Spins whose directions differ by less turn about one axis."""

PER_QUARTER = 0.6366197723675814
"""Right angles in a radian, 2 / π."""

QUARTER_HIGH, QUARTER_LOW = 1.5707963267341256, 6.077100506506192e-11
"""π / 2 in two parts, of which the first has few digits: multiples of it are exact."""

ROUNDER = 6755399441055744.0
"""1.5 · 2⁵², adding which rounds to a whole number, in a way that compilers vectorise."""


@kernel
def carry(body, t, turns):
    """Bring a body to time t (s) of its phase, its orientation only if `turns`."""
    tau = t - body.time
    if tau == 0.0:
        return
    velocity, acceleration = load(body.velocity), load(body.acceleration)
    spin, spin_acceleration = load(body.spin), load(body.spin_acceleration)
    moved = add_scaled(load(body.position), velocity, tau)
    store(body.position, add_scaled(moved, acceleration, 0.5 * tau * tau))
    if turns:
        q = turned(load_quaternion(body.orientation), spin, spin_acceleration, tau)
        store_quaternion(body.orientation, q)
    store(body.velocity, add_scaled(velocity, acceleration, tau))
    store(body.spin, add_scaled(spin, spin_acceleration, tau))
    body.time = t
    if body.rounds_edge and t >= body.phase_end:
        store(body.velocity, load(body.end_velocity))


@kernel
def write_outputs(world, i, t):
    """Write all outputs of the present phase of body i up to and including time t (s)."""
    body = body_at(world, i)
    first = body.next_output
    last = first
    while last < world.output_count and output_time(world, last) <= t:
        last += 1
    if last == first:
        return
    body.next_output = last
    _write_positions(world, i, first, last)
    if world.orientations != 0:
        _write_orientations(world, i, first, last)


@kernel
def _write_positions(world, i, first, last):
    # Copies keep the loop free of loads that a store might have changed.
    body, times, positions = body_at(world, i), world.times, world.positions
    since, at = body.time, 3 * i * world.output_room
    x, y, z = load(body.position)
    vx, vy, vz = load(body.velocity)
    ax, ay, az = load(body.acceleration)
    for k in range(first, last):
        tau = float_at(times, k) - since
        half = 0.5 * tau * tau
        put_float(positions, at + 3 * k, x + tau * vx + half * ax)
        put_float(positions, at + 3 * k + 1, y + tau * vy + half * ay)
        put_float(positions, at + 3 * k + 2, z + tau * vz + half * az)


@kernel
def turned(q, spin, spin_acceleration, tau):
    """Return a quaternion (x, y, z, w) turned for tau (s) from where the spin is `spin`."""
    if keeps_direction(spin, spin_acceleration, tau):
        return turned_by(q, scaled(add_scaled(spin, spin_acceleration, 0.5 * tau), tau))
    fastest = max(norm(spin), norm(add_scaled(spin, spin_acceleration, tau)))
    pieces = MOST_PIECES
    if fastest * abs(tau) < MOST_PIECES * LONGEST_TURN:
        pieces = 1 + int(fastest * abs(tau) / LONGEST_TURN)
    h = tau / pieces
    b = scaled(spin_acceleration, h * h)
    for k in range(pieces):
        a = scaled(add_scaled(spin, spin_acceleration, (k + 0.5) * h), h)
        c = cross(a, b)
        left = add_scaled(c, a, -20.0)
        right = add_scaled(b, cross(a, c), -1.0 / 60.0)
        q = turned_by(q, add_scaled(a, cross(left, right), 1.0 / 240.0))
    return q


@inlined
def keeps_direction(spin, spin_acceleration, tau):
    """Whether spin and its change over tau (s) are parallel, or either is none."""
    change = scaled(spin_acceleration, tau)
    away = norm(cross(spin, change))
    return away <= SAME_DIRECTION * dot(spin, spin) or away <= SAME_DIRECTION * dot(change, change)


@kernel
def _write_orientations(world, i, first, last):
    """Write body i's orientations at the outputs `first` to `last` (exclusive) of its phase."""
    body = body_at(world, i)
    spin, change = load(body.spin), load(body.spin_acceleration)
    span = output_time(world, last - 1) - body.time
    if keeps_direction(spin, change, span):
        along = add(spin, change) if dot(spin, change) >= 0.0 else add_scaled(spin, change, -1.0)
        size = norm(along)
        axis = scaled(along, 1.0 / size) if size > 0.0 else along
        _write_turns(world, i, axis, dot(spin, axis), dot(change, axis), first, last)
        return
    start, at = load_quaternion(body.orientation), body.time
    q = start
    for k in range(first, last):
        t = output_time(world, k)
        q = turned(q, add_scaled(spin, change, at - body.time), change, t - at)
        store_quaternion(body.orientation, q)
        write_orientation(world, i, k)
        at = t
    store_quaternion(body.orientation, start)


@kernel
def _write_turns(world, i, axis, rate, change, first, last):
    """Write orientations turned about one axis by rate τ + change τ²/2.

    q = (axis sin(φ/2), cos(φ/2)) q₀ is q₀ cos(φ/2) + p sin(φ/2) with p = (axis, 0) q₀. Sine and
    cosine are polynomials over an eighth of a turn, as branch-free as a vectorised loop must be.
    """
    body, times, orientations = body_at(world, i), world.times, world.orientations
    since, at = body.time, 4 * i * world.output_room
    bx, by, bz, bw = load_quaternion(body.orientation)
    px, py, pz, pw = axis_times(axis, (bx, by, bz, bw))
    for k in range(first, last):
        tau = float_at(times, k) - since
        s, c = _sine_cosine(0.5 * tau * (rate + 0.5 * tau * change))
        put_float(orientations, at + 4 * k, c * bx + s * px)
        put_float(orientations, at + 4 * k + 1, c * by + s * py)
        put_float(orientations, at + 4 * k + 2, c * bz + s * pz)
        put_float(orientations, at + 4 * k + 3, c * bw + s * pw)


@kernel
def _sine_cosine(angle):
    """Sine and cosine to about 1e-15, for angles up to some 1e6 rad.

    A kernel and not `inlined`, where rounding by adding would be simplified away.
    """
    quarters = (angle * PER_QUARTER + ROUNDER) - ROUNDER
    x = (angle - quarters * QUARTER_HIGH) - quarters * QUARTER_LOW
    y = x * x
    # Taylor series; the first term left out is below 1e-16 for |x| ≤ π / 4.
    s = 1.0 - y * (1.0 / 156.0) * (1.0 - y * (1.0 / 210.0))
    s = 1.0 - y * (1.0 / 20.0) * (
        1.0 - y * (1.0 / 42.0) * (1.0 - y * (1.0 / 72.0) * (1.0 - y * (1.0 / 110.0) * s))
    )
    s = x * (1.0 - y * (1.0 / 6.0) * s)
    c = 1.0 - y * (1.0 / 132.0) * (1.0 - y * (1.0 / 182.0) * (1.0 - y * (1.0 / 240.0)))
    c = 1.0 - y * (1.0 / 12.0) * (
        1.0 - y * (1.0 / 30.0) * (1.0 - y * (1.0 / 56.0) * (1.0 - y * (1.0 / 90.0) * c))
    )
    c = 1.0 - y * (1.0 / 2.0) * c
    # Quarter turns swap the two and change their signs.
    odd = quarters - 2.0 * (((0.5 * quarters - 0.25) + ROUNDER) - ROUNDER)
    half = 0.5 * (quarters - odd)
    sign = 1.0 - 2.0 * (half - 2.0 * (((0.5 * half - 0.25) + ROUNDER) - ROUNDER))
    even = 1.0 - odd
    return sign * (even * s + odd * c), sign * (even * c - odd * s)
