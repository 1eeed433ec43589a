"""Quaternions (x, y, z, w) as tuples of floats, as `vectors` are; `rotations` has array forms."""

from __future__ import annotations

from math import cos, sin, sqrt

from intuitive_physics.geometry.vectors import norm
from intuitive_physics.kernels import kernel


@kernel
def turned_by(q, turn):
    """The unit quaternion q, rotated by a rotation vector (rad) in the environment's axes."""
    half = 0.5 * norm(turn)
    # sin(x) / x, which is 1 - x² / 6 near zero.
    share = 0.5 * (sin(half) / half if half > 1e-4 else 1.0 - half * half / 6.0)
    px, py, pz, pw = axis_times(turn, q)
    c = cos(half)
    x, y = c * q[0] + share * px, c * q[1] + share * py
    z, w = c * q[2] + share * pz, c * q[3] + share * pw
    scale = 1.0 / sqrt(x * x + y * y + z * z + w * w)
    return x * scale, y * scale, z * scale, w * scale


@kernel
def rotated_axes(q):
    """The axes of a frame of orientation q: the columns of its rotation matrix."""
    x, y, z, w = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)),
        (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)),
        (2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


@kernel
def axis_times(axis, q):
    """The product of the quaternions (axis, 0) and q."""
    return (
        axis[0] * q[3] + axis[1] * q[2] - axis[2] * q[1],
        axis[1] * q[3] + axis[2] * q[0] - axis[0] * q[2],
        axis[2] * q[3] + axis[0] * q[1] - axis[1] * q[0],
        -(axis[0] * q[0] + axis[1] * q[1] + axis[2] * q[2]),
    )


@kernel
def load_quaternion(array):
    """The quaternion in an array of four."""
    return array[0], array[1], array[2], array[3]


@kernel
def store_quaternion(array, q):
    """Write a quaternion into an array of four."""
    array[0], array[1], array[2], array[3] = q
