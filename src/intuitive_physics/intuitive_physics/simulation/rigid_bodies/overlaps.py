"""Overlaps of the bodies of a world at the start, for which scenes are refused.

A bounded plane holds what is in front of it. What begins with its centre behind one and reaches
through it would fall: such a world gets the status `BEHIND_PLANE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.geometry.closest_points import part_over_polygon
from intuitive_physics.geometry.vectors import dot, load, sub
from intuitive_physics.kernels import entry, kernel
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.rigid_bodies.distance import separation
from intuitive_physics.simulation.rigid_bodies.placing import place_environment, place_shape
from intuitive_physics.simulation.rigid_bodies.planes import separation_from_plane
from intuitive_physics.simulation.rigid_bodies.scratch import Scratch, scratch_sizes
from intuitive_physics.simulation.rigid_bodies.sheets import way_from_behind
from intuitive_physics.simulation.rigid_bodies.world import body_at, plane_at
from intuitive_physics.simulation.world_batch import WorldArrays, WorldBatch, pack_worlds

OVERLAP = np.dtype(
    [
        ("found", "i8"),  # `NONE`, `TOO_DEEP` or `FROM_BEHIND`
        ("first", "i8"),  # body that moves
        ("second", "i8"),  # body, or -1 - p for plane p; static boxes follow what moves
        ("depth", "f8"),  # m; from behind, the way along the normal that ends it
        ("limit", "f8"),  # m
    ],
    align=True,
)
"""The first overlap of a world that is too deep, or from behind a bounded plane."""

NONE, TOO_DEEP, FROM_BEHIND = range(3)


@entry
def find_overlaps(share, batch, scratch, overlaps):
    """Write the first pair of each world of a batch that overlaps too much, or from behind.

    Two may overlap by a share of the smaller one's thinness; that of a plane or a box that never
    moves does not count. `batch` is `WorldBatch.arrays`, `scratch` (1,) a WORLD with room for the
    largest of the worlds, whose contacts are not used, `overlaps` (W,) OVERLAP to be filled.
    """
    worlds = WorldArrays(*batch)
    world = scratch[0]
    for w in range(worlds.object_counts.size):
        world.moving = worlds.object_counts[w]
        for i in range(world.moving):
            body, kind = body_at(world, i), worlds.shape_kinds[w, i]
            place_shape(body, kind, worlds.dimensions[w, i], 0, worlds.states[w, i])
        place_environment(world, worlds, worlds.environment_index[w])
        overlaps[w].found = NONE
        for i in range(world.moving):
            if _write_first_overlap(world, i, share, overlaps[w]):
                break


@kernel
def _write_first_overlap(world, i, share, overlap):
    """Write the first overlap of body i with what comes after it; return whether there is one."""
    body = body_at(world, i)
    for p in range(world.plane_count):
        plane, limit = plane_at(world, p), share * body.thinness
        if plane.corners > 0:
            way = way_from_behind(body, plane)
            if way != 0.0:
                _write(overlap, FROM_BEHIND, i, -1 - p, way, 0.0)
                return True
        gap, _ = separation_from_plane(world, i, p)
        if gap < -limit:
            _write(overlap, TOO_DEEP, i, -1 - p, -gap, limit)
            return True
    if share == inf:
        return False
    for j in range(i + 1, world.body_count):
        other = body_at(world, j)
        thinness = min(body.thinness, other.thinness if j < world.moving else inf)
        limit = share * thinness
        reach = body.reach + other.reach
        apart = sub(load(body.position), load(other.position))
        if dot(apart, apart) < reach * reach:
            gap, _ = separation(world, i, j)
            if gap < -limit:
                _write(overlap, TOO_DEEP, i, j, -gap, limit)
                return True
    return False


@kernel
def is_on_sheet(body, plane):
    """Whether a body's centre, projected onto a bounded plane, is within its edges."""
    centre, n = load(body.position), load(plane.normal)
    low, high = part_over_polygon(centre, (0.0, 0.0, 0.0), plane.boundary, plane.corners, n)
    return low < high


@kernel
def _write(overlap, kind, first, second, depth, limit):
    overlap.found = kind
    overlap.first, overlap.second = first, second
    overlap.depth, overlap.limit = depth, limit


LARGEST_OVERLAP = 0.25
"""Overlap that engines still part, as a part of the smaller object's inradius; objects
that touch are seen to overlap by less."""


def check_overlaps(scenes: Sequence[Scene], worlds: WorldBatch) -> None:
    """Check that nothing overlaps by more than a quarter of the smaller object's inradius.

    A bounded plane is a one-sided sheet: what has its centre behind it does not overlap it, but
    its world ends as BEHIND_PLANE if it reaches through.

    Parameters
    ----------
    worlds : the scenes, packed

    Raises
    ------
    InvalidInputError
        When two objects do, or an object and a plane or a static box.
    """
    overlaps = _found_overlaps(worlds, LARGEST_OVERLAP)
    too_deep = overlaps["found"] == TOO_DEEP
    if too_deep.any():
        world = int(too_deep.argmax())
        where = f"scene {world}: " if len(scenes) > 1 else ""
        raise InvalidInputError(where + _message(scenes[world], overlaps[world]))


def overlapping(scenes: Sequence[Scene]) -> NDArray[np.bool_]:
    """Return which scenes begin with any overlap, however small, (n_scenes,) bool.

    Parameters
    ----------
    scenes : at least one
    """
    materials = tuple(dict.fromkeys(name for scene in scenes for name in scene.materials))
    worlds = pack_worlds(scenes, StaticParameters.uniform(materials))
    return np.asarray(_found_overlaps(worlds, 0.0)["found"] == TOO_DEEP)


def behind_planes(worlds: WorldBatch) -> NDArray[np.bool_]:
    """Return in which worlds an object reaches through a bounded plane from behind, (W,)."""
    if not worlds.corner_counts.any():
        return np.zeros(worlds.size, dtype=bool)
    return np.asarray(_found_overlaps(worlds, inf)["found"] == FROM_BEHIND)


def pushed_out(worlds: WorldBatch) -> WorldBatch:
    """Return the worlds with what reaches through bounded planes from behind moved out of them."""
    if not worlds.corner_counts.any():
        return worlds
    for _ in range(worlds.states.shape[1] * worlds.planes.shape[1]):
        overlaps = _found_overlaps(worlds, inf)
        (behind,) = np.nonzero(overlaps["found"] == FROM_BEHIND)
        if behind.size == 0:
            break
        states = worlds.states.copy()
        for w in behind:
            overlap = overlaps[w]
            plane = worlds.planes[worlds.environment_index[w], -1 - overlap["second"]]
            states[w, overlap["first"], :3] += overlap["depth"] * plane[:3]
        worlds = replace(worlds, states=states)
    return worlds


def _found_overlaps(worlds: WorldBatch, share: float) -> np.ndarray:
    scratch = Scratch(*scratch_sizes(worlds), contacts_a_body=0)
    overlaps = np.empty(worlds.size, OVERLAP)
    find_overlaps(share, worlds.arrays, scratch.world, overlaps)
    return overlaps


def _message(scene: Scene, overlap: np.void) -> str:
    first = scene.objects[overlap["first"]]
    second = int(overlap["second"])
    moving = len(scene.objects)
    if second < 0:
        other = f"plane {scene.environment.planes[-1 - second].id!r}"
    elif second < moving:
        other = f"object {scene.objects[second].id!r}"
    else:
        other = f"static box {scene.environment.boxes[second - moving].id!r}"
    inradius = "smaller one's" if 0 <= second < moving else "object's"
    return (
        f"object {first.id!r} overlaps {other} by {1e3 * overlap['depth']:.3g} mm at the start; "
        f"expected at most {1e3 * overlap['limit']:.3g} mm, a quarter of the {inradius} inradius: "
        "move them apart"
    )
