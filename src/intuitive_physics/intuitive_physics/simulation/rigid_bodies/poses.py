"""Orientation of a body, and what follows from it."""

from __future__ import annotations

from math import cos, sin, sqrt

from intuitive_physics.geometry.quaternions import load_quaternion, rotated_axes
from intuitive_physics.geometry.vectors import add, add_scaled, dot, load, scaled, sub
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.world import column, transposed_times
from intuitive_physics.simulation.world_batch import SPHERE

SMALL_ANGLE = 0.4
"""rad. Below it the series of sine and cosine to the ninth power are exact to 3e-14."""


@kernel
def rotate(body, origin, angle):
    """Set a body's orientation to `origin` turned by the rotation vector `angle` (rad).

    `origin` (4,) is a quaternion (x, y, z, w), `angle` a tuple of three in the world's axes.
    """
    square = dot(angle, angle)
    h = 0.25 * square
    if square < SMALL_ANGLE * SMALL_ANGLE:
        s = 0.5 - h * (1 / 12 - h * (1 / 240 - h * (1 / 10080 - h * (1 / 725760))))
        w = 1.0 - h * (1 / 2 - h * (1 / 24 - h * (1 / 720 - h * (1 / 40320))))
    else:
        size = sqrt(square)
        s = sin(0.5 * size) / size
        w = cos(0.5 * size)
    x, y, z = scaled(angle, s)
    a, b, c, d = origin[0], origin[1], origin[2], origin[3]
    qx = w * a + x * d + y * c - z * b
    qy = w * b - x * c + y * d + z * a
    qz = w * c + x * b - y * a + z * d
    qw = w * d - x * a - y * b - z * c
    # One Newton step towards 1/sqrt: the length is one but for rounding.
    scale = 1.5 - 0.5 * (qx * qx + qy * qy + qz * qz + qw * qw)
    q = body.orientation
    q[0], q[1], q[2], q[3] = qx * scale, qy * scale, qz * scale, qw * scale


@kernel
def set_rotation(body):
    """Bring the rotation matrix up to the orientation."""
    r = body.rotation
    x, y, z = rotated_axes(load_quaternion(body.orientation))
    r[0], r[3], r[6] = x
    r[1], r[4], r[7] = y
    r[2], r[5], r[8] = z


@kernel
def set_inverse_inertia(body):
    """Bring the inverse inertia in the world's axes up to the rotation: R I⁻¹ Rᵀ."""
    r, inverse = body.rotation, body.inverse_inertia
    if body.kind == SPHERE:
        value = body.own_inverse_inertia[0]
        inverse[0] = inverse[4] = inverse[8] = value
        return
    a, b, c = load(body.own_inverse_inertia)
    inverse[0] = a * r[0] * r[0] + b * r[1] * r[1] + c * r[2] * r[2]
    inverse[4] = a * r[3] * r[3] + b * r[4] * r[4] + c * r[5] * r[5]
    inverse[8] = a * r[6] * r[6] + b * r[7] * r[7] + c * r[8] * r[8]
    inverse[1] = inverse[3] = a * r[0] * r[3] + b * r[1] * r[4] + c * r[2] * r[5]
    inverse[2] = inverse[6] = a * r[0] * r[6] + b * r[1] * r[7] + c * r[2] * r[8]
    inverse[5] = inverse[7] = a * r[3] * r[6] + b * r[4] * r[7] + c * r[5] * r[8]


@kernel
def angular_momentum(body):
    """R I Rᵀ ω in kg m²/s, as a tuple, in the world's axes."""
    spin = load(body.spin)
    if body.kind == SPHERE:
        return spin[0] * body.inertia[0], spin[1] * body.inertia[0], spin[2] * body.inertia[0]
    local = transposed_times(body.rotation, spin)
    return turned(
        body, (local[0] * body.inertia[0], local[1] * body.inertia[1], local[2] * body.inertia[2])
    )


@kernel
def turned(body, a):
    """A vector of the body's axes in the world's."""
    r = body.rotation
    return (
        r[0] * a[0] + r[1] * a[1] + r[2] * a[2],
        r[3] * a[0] + r[4] * a[1] + r[5] * a[2],
        r[6] * a[0] + r[7] * a[1] + r[8] * a[2],
    )


@kernel
def centre_of_mass(body):
    """Position (m) of the centre of mass, as a tuple."""
    if body.off_centre == 0:
        return load(body.position)
    return add(load(body.position), turned(body, load(body.centre_offset)))


@fast_inlined
def support(body, n):
    """How far (m) a body reaches along a unit vector, or against it, from its shape's centre."""
    reach = body.radius
    for k in range(3):
        reach += abs(body.half_extents[k] * dot(n, column(body.rotation, k)))
    return reach


@fast_inlined
def segment_end(body, sign):
    """End of a capsule's axis, or a sphere's centre."""
    return add_scaled(load(body.position), column(body.rotation, 2), sign * body.half_extents[2])


@fast_inlined
def into_frame(body, point):
    """A point of the world in the frame of a body, from its shape's centre."""
    return transposed_times(body.rotation, sub(point, load(body.position)))
