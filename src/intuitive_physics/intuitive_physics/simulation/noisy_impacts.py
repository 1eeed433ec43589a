"""Noise at each impact, as in noisy Newton: what makes one bounce differ from the next.

The restitution of an impact is e + σ_e z, cut off at 0 and 1; its normal is tilted by two angles
σ_n z, as the unevenness of a surface does. The impulse then obeys the same laws about the tilted
normal: so friction stays in its cone, and no impact gains energy.

The deviates z are functions of a world's key and of the number of the impact in that world, and of
nothing else: the answer depends neither on threads nor on the other worlds of a batch.
"""

from __future__ import annotations

from math import cos, log, pi, sin, sqrt

import numpy as np

from intuitive_physics.geometry.vectors import add_scaled, cross, norm, scaled
from intuitive_physics.kernels import inlined, kernel

NOISE_FIELDS = [
    ("noisy", "i8"),  # 1 where impacts are noisy
    ("noise_key", "u8"),  # of the world
    ("noisy_impacts", "i8"),  # so far
    ("restitution_noise", "f8"),  # standard deviation
    ("tilt_noise", "f8"),  # rad, likewise
]
"""Fields of a world's record for the noise."""

GOLDEN, FIRST_MIX, SECOND_MIX = (
    np.uint64(0x9E3779B97F4A7C15),
    np.uint64(0xBF58476D1CE4E5B9),
    np.uint64(0x94D049BB133111EB),
)
"""Constants of SplitMix64 (Steele, Lea, Flood 2014), whose k-th number is a hash of seed + k
GOLDEN."""

DRAWS = 4
"""Uniform numbers that an impact takes."""


@inlined
def set_noise(world, deviations, key):
    """Let a world's impacts be noisy from the first one on, unless both deviations are zero.

    The deviations are (2,), of the restitution and of the tilt (rad).
    """
    world.restitution_noise, world.tilt_noise = deviations[0], deviations[1]
    world.noisy = deviations[0] > 0.0 or deviations[1] > 0.0
    world.noise_key = key
    world.noisy_impacts = 0


@kernel
def _uniform(world, draw):
    """One of the impact's uniform numbers, above 0 and at most 1."""
    number = np.uint64(DRAWS * world.noisy_impacts + draw + 1)
    x = world.noise_key + number * GOLDEN
    x = (x ^ (x >> np.uint64(30))) * FIRST_MIX
    x = (x ^ (x >> np.uint64(27))) * SECOND_MIX
    x = x ^ (x >> np.uint64(31))
    return (np.float64(x >> np.uint64(11)) + 1.0) * 2.0**-53


@kernel
def _deviates(world, draw):
    """Two independent normal deviates (Box and Muller) from two of the impact's numbers."""
    size = sqrt(-2.0 * log(_uniform(world, draw)))
    angle = 2.0 * pi * _uniform(world, draw + 1)
    return size * cos(angle), size * sin(angle)


@kernel
def noisy_restitution(world, restitution):
    """Restitution at the present impact."""
    z, _ = _deviates(world, 0)
    return min(max(restitution + world.restitution_noise * z, 0.0), 1.0)


@kernel
def tilted(world, n):
    """The unit normal n as it is at the present impact."""
    u, v = _deviates(world, 2)
    other = (1.0, 0.0, 0.0) if abs(n[0]) < 0.7 else (0.0, 1.0, 0.0)
    side = cross(n, other)
    side = scaled(side, 1.0 / norm(side))
    slanted = add_scaled(n, side, world.tilt_noise * u)
    slanted = add_scaled(slanted, cross(n, side), world.tilt_noise * v)
    return scaled(slanted, 1.0 / norm(slanted))
