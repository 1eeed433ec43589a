"""How deep objects are in planes and in one another, found apart from the engines.

Every shape is a box, thickened by a radius: that of a sphere is a point, that of a capsule a line.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Plane, Scene
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere

MISSED = 1e-3  # m; a deeper overlap is that of two that pass through each other
SEARCHES = 60  # thirds by which the closest point of a line is searched

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Deepest overlaps (W,) m of W scenes, and pairs that pass through each other (W,)."""

    in_planes: Array
    in_objects: Array
    missed: NDArray[np.int64]

    @property
    def deepest(self) -> Array:
        """(W,) m, of both."""
        return np.maximum(self.in_planes, self.in_objects)


@dataclass(frozen=True, eq=False)
class Solid:
    """Half edges (..., 3) m and radii (...) m of shapes at positions and orientations (..., 3 | 4).

    The first axes of all broadcast.
    """

    half: Array
    radius: Array
    positions: Array
    axes: Array  # (..., 3, 3), columns

    def at(self, where: NDArray[np.bool_]) -> Solid:
        """Return those where a mask is true."""
        shape = where.shape
        return Solid(
            np.broadcast_to(self.half, (*shape, 3))[where],
            np.broadcast_to(self.radius, shape)[where],
            self.positions[where],
            self.axes[where],
        )


def find_overlaps(scenes: Sequence[Scene], positions: Array, orientations: Array) -> Overlaps:
    """Measure W scenes that have the same planes at all outputs.

    Parameters
    ----------
    positions, orientations : (W, O, T, 3) m and (W, O, T, 4); NaN where there is nothing
    """
    solids = _solids(scenes, positions, orientations)
    in_planes, in_objects = np.zeros((2, len(scenes)))
    missed = np.zeros(len(scenes), dtype=np.int64)
    for plane, solid in itertools.product(scenes[0].environment.planes, solids):
        deep, behind = _in_plane(plane, solid)
        in_planes = np.maximum(in_planes, deep)
        missed += (deep > MISSED) | behind
    for a, b in itertools.combinations(solids, 2):
        deep = _in_object(a, b)
        in_objects = np.maximum(in_objects, deep)
        missed += deep > MISSED
    return Overlaps(in_planes, in_objects, missed)


def depths(a: Solid, b: Solid) -> Array:
    """Return how deep n pairs of solids are in each other, (n,) m; below zero, none is."""
    result = np.empty(len(a.positions))
    flat = [(solid.half > 0.0).all(axis=-1) for solid in (a, b)]
    for a_is_box, b_is_box in itertools.product((True, False), repeat=2):
        where = (flat[0] == a_is_box) & (flat[1] == b_is_box)
        one, other = a.at(where), b.at(where)
        if a_is_box and b_is_box:
            result[where] = _box_in_box(one, other)
        elif a_is_box:
            result[where] = _line_in_solid(other, one)
        else:
            result[where] = _line_in_solid(one, other)
    return result


def _in_plane(plane: Plane, solid: Solid) -> tuple[Array, NDArray[np.bool_]]:
    """Return how deep each scene's solid is in a plane, and whether its centre is behind it."""
    heights = solid.positions @ plane.normal - plane.offset
    # The lowest corner
    reach = (np.abs(np.einsum("...ij,i->...j", solid.axes, plane.normal)) * solid.half).sum(axis=-1)
    deep = np.nan_to_num(reach + solid.radius - heights, nan=-np.inf)
    behind: NDArray[np.bool_] = np.any(heights < 0.0, axis=1)
    return deep.max(axis=1), behind


def _in_object(a: Solid, b: Solid) -> Array:
    """Return how deep each scene's solid is in its other one."""
    bounds = [np.linalg.norm(solid.half, axis=-1) + solid.radius for solid in (a, b)]
    close = np.linalg.norm(a.positions - b.positions, axis=-1) < bounds[0] + bounds[1]
    deep = np.full(close.shape, -np.inf)
    if close.any():
        deep[close] = depths(a.at(close), b.at(close))
    return deep.max(axis=1)


def _box_in_box(a: Solid, b: Solid) -> Array:
    """Return the least overlap along the axes that may separate two boxes."""
    edges = np.cross(a.axes.swapaxes(-1, -2)[:, :, None], b.axes.swapaxes(-1, -2)[:, None])
    edges = edges.reshape(-1, 9, 3)
    lengths = np.linalg.norm(edges, axis=-1, keepdims=True)
    # Parallel edges have no axis of their own; a face's is one.
    edges = np.where(lengths > 1e-6, edges / np.maximum(lengths, 1e-6), a.axes[:, None, :, 0])
    faces = [solid.axes.swapaxes(-1, -2) for solid in (a, b)]
    axes = np.concatenate([*faces, edges], axis=1)
    reaches = [
        (np.abs(axes @ solid.axes) * solid.half[:, None]).sum(axis=-1) + solid.radius[:, None]
        for solid in (a, b)
    ]
    apart = np.abs(np.einsum("nki,ni->nk", axes, b.positions - a.positions))
    overlaps: Array = (reaches[0] + reaches[1] - apart).min(axis=1)
    return overlaps


def _line_in_solid(line: Solid, solid: Solid) -> Array:
    """Return how deep a sphere or capsule is in any solid: the least distance from its line."""
    back = solid.axes.swapaxes(-1, -2)
    middle = np.einsum("nij,nj->ni", back, line.positions - solid.positions)
    along = np.einsum("nij,nj->ni", back, line.axes[..., 2]) * line.half[:, 2:]

    def distance(place: Array) -> Array:
        beyond = np.abs(middle + place[:, None] * along) - solid.half
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        return outside + np.minimum(beyond.max(axis=-1), 0.0)

    return line.radius + solid.radius - _least(distance, len(middle))


def _least(convex: Callable[[Array], Array], count: int) -> Array:
    """Return the least values of convex functions of [-1, 1], evaluated together."""
    low, high = np.full(count, -1.0), np.full(count, 1.0)
    for _ in range(SEARCHES):
        third = (high - low) / 3.0
        falls = convex(low + third) > convex(high - third)
        low, high = np.where(falls, low + third, low), np.where(falls, high, high - third)
    return convex(0.5 * (low + high))


def _solids(scenes: Sequence[Scene], positions: Array, orientations: Array) -> list[Solid]:
    """Return the first, second … objects of all scenes, each with axes (W, T)."""
    count = positions.shape[1]
    half, radius = np.zeros((len(scenes), count, 3)), np.zeros((len(scenes), count))
    for w, scene in enumerate(scenes):
        for k, thing in enumerate(scene.objects):
            half[w, k], radius[w, k] = _thickened(thing.shape)
    axes = _axes(orientations)
    return [
        Solid(half[:, k, None], radius[:, k, None], positions[:, k], axes[:, k])
        for k in range(count)
    ]


def _thickened(shape: Shape) -> tuple[tuple[float, float, float], float]:
    match shape:
        case Sphere():
            return (0.0, 0.0, 0.0), shape.radius
        case Box():
            x, y, z = shape.edge_lengths
            return (x / 2, y / 2, z / 2), 0.0
        case Capsule():
            return (0.0, 0.0, shape.length / 2), shape.radius
    raise TypeError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")


def _axes(quaternions: Array) -> Array:
    """Return rotation matrices (..., 3, 3) of quaternions (..., 4)."""
    x, y, z, w = np.moveaxis(quaternions, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
