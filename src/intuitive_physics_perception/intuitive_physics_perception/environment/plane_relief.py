"""Relief of a surface that is not flat: a floor that sags, or a sensor that bends what it reads.

The surface lies above its plane by a polynomial of second order in the coordinates of the plane,

    h(a, b) = c0 + c1 a + c2 b + c3 a² + c4 a b + c5 b²,

with a and b from -1 to 1 over what was seen of it. Six coefficients over a whole plane cannot take
up an object that lies there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.environment.range_cloud import RangeCloud, plane_axes

ROUNDS = 12
"""Rounds of fitting a relief and extending it to the readings that it explains."""

GROWTH = 1.2
"""Part by which a relief may extend beyond its readings in one round: farther a polynomial says
little."""

LARGEST = 0.1
"""Largest height of a relief over its plane, in halves of its longer extent: what rises more is
curved, not uneven. Set by hand."""

EXPLAINED = 0.3
"""Part of the squared distances from the plane that a relief must explain: less is by chance."""

FEWEST = 100
"""Readings from which a relief is fitted."""


@dataclass(frozen=True, eq=False)
class PlaneRelief:
    """Heights of a surface over its plane.

    Parameters
    ----------
    origin : (3,) m, middle of what was seen of it
    axes : (3, 2) of the plane, each over half of the extent along it, 1/m
    coefficients : (6,) c0 to c5 in m
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    def heights(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the height (n,) m of the surface where points (n, 3) m stand over it; beyond what
        was seen, that at its border."""
        return _terms(np.clip((points - self.origin) @ self.axes, -1.0, 1.0)) @ self.coefficients

    def seen_from(self, way: RigidTransform) -> PlaneRelief:
        """Return the same relief in the frame of a sensor that has moved; `way` leads from its
        frame now to this one."""
        turn, shift = way.matrix, way.translation
        return replace(self, origin=(self.origin - shift) @ turn, axes=turn.T @ self.axes)


def fitted_relief(
    cloud: RangeCloud,
    plane: NDArray[np.float64],
    surface: NDArray[np.intp],
    others: Sequence[NDArray[np.float64]],
) -> tuple[PlaneRelief, NDArray[np.intp]] | None:
    """Return the relief of a plane and the indices (n,) of the readings on it; None where flat.

    `plane` (4,) normal and offset in m; `surface` (n,) indices of the readings on it; `others` (4,)
    each, planes that cross it, whose readings are none of its own.
    """
    if surface.size < FEWEST:
        return None
    free = np.ones(len(cloud.points), dtype=bool)
    for other in others:
        free &= ~cloud.near(other)
    heights = cloud.points @ plane[:3] - plane[3]
    possible = np.flatnonzero(free)
    relief, on = _fit(cloud, plane, surface, heights), surface
    for _ in range(ROUNDS):
        within = np.abs((cloud.points[possible] - relief.origin) @ relief.axes).max(axis=1) < GROWTH
        near = possible[within]
        extended = near[np.abs(cloud.scaled_distances(plane, near, relief.heights)) < 1.0]
        if extended.size < FEWEST or np.array_equal(extended, on):
            break
        on = extended
        relief = _fit(cloud, plane, on, heights)
    rise = relief.heights(cloud.points[on])
    flat, left = np.square(heights[on]), np.square(heights[on] - rise)
    highest, extent = np.abs(rise).max(), 1.0 / np.linalg.norm(relief.axes, axis=0).min()
    is_uneven = cloud.tolerance < highest < LARGEST * extent
    return (relief, on) if is_uneven and left.sum() < (1.0 - EXPLAINED) * flat.sum() else None


def _fit(
    cloud: RangeCloud,
    plane: NDArray[np.float64],
    on: NDArray[np.intp],
    heights: NDArray[np.float64],
) -> PlaneRelief:
    """Relief through readings, weighted by their noise across the plane."""
    points = cloud.points[on]
    axes = np.column_stack(plane_axes(plane[:3]))
    places = points @ axes
    low, high = places.min(axis=0), places.max(axis=0)
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-6)
    root = np.sqrt(1.0 / (cloud.deviations[on] ** 2 + (cloud.tolerance / cloud.sigmas) ** 2))
    design = _terms((places - middle) / half)
    solution = np.linalg.lstsq(design * root[:, None], heights[on] * root, rcond=None)[0]
    origin = middle @ axes.T + plane[3] * plane[:3]
    return PlaneRelief(origin, axes / half, np.asarray(solution, dtype=np.float64))


def _terms(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """The monomials (n, 6) at places (n, 2) whose factors are the coefficients."""
    a, b = places[:, 0], places[:, 1]
    return np.column_stack([np.ones_like(a), a, b, a * a, a * b, b * b])
