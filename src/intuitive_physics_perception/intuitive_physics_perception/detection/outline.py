"""Kernel that looks round the outline of a sphere: does the object end there, was it there before?

A free sphere ends at its outline: just outside, the sensor sees something else, or nothing. A part
of something larger (a corner, a shoulder, the bulge of a mug) goes on there as the same surface. A
surface that leaves the outline backwards at the steepest angle at which a sensor still reads it
lies, s radii across the line of sight, (s - 1) tan(angle) radii behind the outline, and no more.

`noise` is (a², b², limit², lateral²) of `RangeNoise`; lengths in m, the sensor at the origin.
"""

from __future__ import annotations

from math import atan2, pi, sqrt
from typing import Any

import numpy as np

from intuitive_physics.kernels import allocating_entry
from intuitive_physics_perception.detection.sphere_fit import (
    BEHIND_SIGMAS,
    EDGE_PART,
    line_of_sight_axes,
    surface_error,
)

SECTORS = 16
"""Of the ring round the outline: each is judged by itself. A ball that touches another of its size
has 2 to 3 of them in common with it."""

RING_WIDTH = 0.35
"""Radii over which the ring outside the outline reaches: a neighbour of the same size in contact
covers a seventh of it. Set by hand."""

PATCH_RINGS = 3
"""Rings of equal area, each of `SECTORS` patches, into which the disc of a sphere is divided."""

STEEPEST_SLOPE = 1.7320508
"""Tangent of 60°, the angle of incidence up to which a surface that goes on is expected to be
read."""

CHANGE_SIGMAS = 4.0
"""Standard deviations by which a reading differs from the one before when something else is seen.
Six in 100,000 do so by chance."""


@allocating_entry
def look_round_outline(
    points: Any, own: Any, before: Any, sphere: Any, pixel: float, sigmas: float, noise: Any
) -> tuple[float, float, float, float, Any]:
    """Judge the ring outside a sphere's outline, and whether its surface is new.

    Parameters
    ----------
    points : (n, 3) readings about the sphere, may hold NaN
    own : (n,) nonzero where a reading belongs to the cluster in which the sphere was found
    before : (n,) m, range read there when the environment was modelled, NaN where it is unknown
    sphere : (4,)
    pixel : angle between neighbouring pixels, rad
    sigmas : standard deviations from the surface within which a reading is on it

    Returns
    -------
    goes_on : part of the ring's sectors in which the cluster goes on past the outline
    level : part of the ring's sectors in which any surface goes on past the outline, as a plate
        does round a bulge
    ends : part of the ring's sectors in which what is read lies behind all that could go on
    new : part of the readings on the surface that are nearer than what was read there before, or
        where nothing was
    patches : (n_patches, 3) readings on the surface, mean of their distance outside it, m, and mean
        variance of that distance, m², by patch of the disc
    """
    cx, cy, cz, r = sphere[0], sphere[1], sphere[2], sphere[3]
    across, upwards = line_of_sight_axes(sphere)
    distance = sqrt(cx * cx + cy * cy + cz * cz)
    # Readings nearer to the outline may be mixed of both sides of the edge, or fattened.
    inner = 1.0 + 2.5 * pixel * distance / r
    outer = inner + max(RING_WIDTH, 2.0 * pixel * distance / r)
    same = np.zeros(SECTORS, dtype=np.int64)
    near = np.zeros(SECTORS, dtype=np.int64)
    total = np.zeros(SECTORS, dtype=np.int64)
    patches = np.zeros((PATCH_RINGS * SECTORS, 3))
    new, on_surface = 0, 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        toward = x * cx + y * cy + z * cz
        if not toward > 0.0:
            continue
        error, variance, deviation, ahead, sine = surface_error(x, y, z, cx, cy, cz, r, noise)
        if sine > outer or 1.0 < sine < inner:
            continue
        a = x * across[0] + y * across[1] + z * across[2]
        b = x * upwards[0] + y * upwards[1] + z * upwards[2]
        sector = int((atan2(b, a) + pi) / (2.0 * pi) * SECTORS) % SECTORS
        if sine <= 1.0:
            if error * error > sigmas * sigmas * variance or ahead < -BEHIND_SIGMAS * deviation:
                continue
            on_surface += 1
            change = before[i] - sqrt(x * x + y * y + z * z)
            # NaN, where nothing was read, is not at most anything.
            new += not change <= CHANGE_SIGMAS * 1.4142136 * deviation
            if sine < EDGE_PART:
                # Rings of equal area: as many readings in each.
                ring = int(sine * sine / (EDGE_PART * EDGE_PART) * PATCH_RINGS)
                patch = ring * SECTORS + sector
                patches[patch, 0] += 1.0
                patches[patch, 1] += error
                patches[patch, 2] += variance
        else:
            behind = STEEPEST_SLOPE * (sine - 1.0) * r + BEHIND_SIGMAS * deviation
            total[sector] += 1
            near[sector] += ahead > -behind
            same[sector] += own[i] != 0 and ahead > -behind
    goes_on, level, ends = 0, 0, 0
    for k in range(SECTORS):
        goes_on += 2 * same[k] > total[k]
        level += 2 * near[k] > total[k]
        ends += 2 * near[k] <= total[k] and total[k] > 0
    for k in range(patches.shape[0]):
        patches[k, 1:] /= max(patches[k, 0], 1.0)
    return goes_on / SECTORS, level / SECTORS, ends / SECTORS, new / max(on_surface, 1), patches
