"""Vectors of three as tuples of floats, for kernels: Numba keeps them in registers."""

from __future__ import annotations

from math import sqrt

from intuitive_physics.kernels import fast_inlined
from intuitive_physics.kernels.pointers import float_at, put_float


@fast_inlined
def load(array):
    """The vector in an array of three."""
    return array[0], array[1], array[2]


@fast_inlined
def store(array, a):
    """Write a vector into an array of three."""
    array[0], array[1], array[2] = a


@fast_inlined
def vector_at(address, k):
    """Row k of the array (n, 3) of float64 at an address."""
    return float_at(address, 3 * k), float_at(address, 3 * k + 1), float_at(address, 3 * k + 2)


@fast_inlined
def put_vector(address, k, a):
    """Write row k of the array (n, 3) of float64 at an address."""
    put_float(address, 3 * k, a[0])
    put_float(address, 3 * k + 1, a[1])
    put_float(address, 3 * k + 2, a[2])


@fast_inlined
def bounded(value, low, high):
    """A number, or the nearer of two bounds where it lies outside them."""
    return min(max(value, low), high)


@fast_inlined
def add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@fast_inlined
def sub(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@fast_inlined
def scaled(a, s):
    return a[0] * s, a[1] * s, a[2] * s


@fast_inlined
def add_scaled(a, b, s):
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@fast_inlined
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@fast_inlined
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@fast_inlined
def norm(a):
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@fast_inlined
def tangential(a, n):
    """The part of a that is perpendicular to the unit vector n."""
    return add_scaled(a, n, -dot(a, n))


@fast_inlined
def clamped(a, longest):
    """A vector, shortened to the length `longest` if it is longer."""
    length = norm(a)
    if length > longest:
        return scaled(a, longest / length)
    return a
