"""Refuse scenes of objects that are in one another, which no engine can make sense of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.rigid_bodies.overlaps import OVERLAP, find_overlaps
from intuitive_physics.simulation.rigid_bodies.world import Scratch, scratch_sizes
from intuitive_physics.simulation.world_batch import WorldBatch

LARGEST_OVERLAP = 0.25
"""Of the smaller object's inradius. What is seen to touch overlaps by less; engines part it."""


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
    scratch = Scratch(*scratch_sizes(worlds), contacts_a_body=0)
    overlaps = np.empty(worlds.size, OVERLAP)
    find_overlaps(LARGEST_OVERLAP, worlds.arrays, scratch.world, overlaps)
    if overlaps["found"].any():
        world = int(overlaps["found"].argmax())
        where = f"scene {world}: " if len(scenes) > 1 else ""
        raise InvalidInputError(where + _message(scenes[world], overlaps[world]))


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
