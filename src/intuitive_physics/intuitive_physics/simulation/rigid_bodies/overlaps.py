"""Overlaps of the bodies of a world at the start, for which scenes are refused."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.geometry.closest_points import part_over_polygon
from intuitive_physics.geometry.vectors import dot, load, sub
from intuitive_physics.kernels import entry, kernel
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.rigid_bodies.contact_points import GAP_ONLY
from intuitive_physics.simulation.rigid_bodies.pairs import meet
from intuitive_physics.simulation.rigid_bodies.placing import place_environment, place_shape
from intuitive_physics.simulation.rigid_bodies.planes import separation_from_plane
from intuitive_physics.simulation.rigid_bodies.world import (
    Scratch,
    body_at,
    scratch_sizes,
)
from intuitive_physics.simulation.world_batch import WorldArrays, WorldBatch, pack_worlds

OVERLAP = np.dtype(
    [
        ("found", "i8"),  # 1 if there is one
        ("first", "i8"),  # body that moves
        ("second", "i8"),  # body, or -1 - p for plane p; static boxes follow what moves
        ("depth", "f8"),  # m
        ("limit", "f8"),  # m
    ],
    align=True,
)
"""The first overlap of a world that is too deep."""


@entry
def find_overlaps(share, batch, scratch, overlaps):
    """Write the first pair of each world of a batch that overlaps too much.

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
        overlaps[w].found = 0
        for i in range(world.moving):
            if _write_first_overlap(world, i, share, overlaps[w]):
                break


@kernel
def _write_first_overlap(world, i, share, overlap):
    """Write the first overlap of body i with what comes after it; return whether there is one."""
    body = body_at(world, i)
    for p in range(world.plane_count):
        limit = share * body.thinness
        gap, _ = separation_from_plane(world, i, p)
        if gap < -limit:
            _write(overlap, i, -1 - p, gap, limit)
            return True
    for j in range(i + 1, world.body_count):
        other = body_at(world, j)
        thinness = min(body.thinness, other.thinness if j < world.moving else inf)
        limit = share * thinness
        reach = body.reach + other.reach
        apart = sub(load(body.position), load(other.position))
        if dot(apart, apart) < reach * reach:
            _, gap = meet(world, i, j, -limit, GAP_ONLY)
            if gap < -limit:
                _write(overlap, i, j, gap, limit)
                return True
    return False


@kernel
def is_on_sheet(body, plane):
    """Whether a body's centre, projected onto a bounded plane, is within its edges."""
    centre, n = load(body.position), load(plane.normal)
    low, high = part_over_polygon(centre, (0.0, 0.0, 0.0), plane.boundary, plane.corners, n)
    return low < high


@kernel
def _write(overlap, first, second, gap, limit):
    overlap.found = 1
    overlap.first, overlap.second = first, second
    overlap.depth, overlap.limit = -gap, limit


LARGEST_OVERLAP = 0.25
"""Overlap that engines still part, as a part of the smaller object's inradius; objects
that touch are seen to overlap by less."""


def check_overlaps(scenes: Sequence[Scene], worlds: WorldBatch) -> None:
    """Check that nothing overlaps by more than a quarter of the smaller object's inradius.

    A bounded plane is a one-sided sheet: what has its centre behind it does not overlap it.

    Parameters
    ----------
    worlds : the scenes, packed

    Raises
    ------
    InvalidInputError
        When two objects do, or an object and a plane or a static box.
    """
    overlaps = _found_overlaps(worlds, LARGEST_OVERLAP)
    if overlaps["found"].any():
        world = int(overlaps["found"].argmax())
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
    return np.asarray(_found_overlaps(worlds, 0.0)["found"] != 0)


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
