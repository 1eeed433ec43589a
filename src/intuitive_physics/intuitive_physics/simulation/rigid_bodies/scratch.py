"""Memory for the records of one world."""

from __future__ import annotations

import numpy as np

from intuitive_physics.simulation.rigid_bodies.solids import FEATURE, SOLID, most_features
from intuitive_physics.simulation.rigid_bodies.world import (
    BODY,
    CONTACT,
    MEMBER,
    MOST_TOUCHED,
    PAIR,
    PLANE,
    ROW,
    SPHERE_CONTACT,
    WARM_START,
    WARM_STARTS,
    WORLD,
)
from intuitive_physics.simulation.world_batch import WorldBatch

CONTACTS_A_BODY = 48
"""Room for contacts for each body that moves; with more in all, a world stops."""

MOST_ROWS = 384
"""Most equations that are solved directly: 64 contacts with rolling friction, 128 without."""


class Scratch:
    """Room for one world; the arrays live as long as this does.

    Parameters
    ----------
    moving, boxes, planes, corners : the most that it has of each, corners of one plane
    contacts_a_body : 0 where only gaps are asked for
    """

    def __init__(
        self,
        moving: int,
        boxes: int,
        planes: int,
        corners: int,
        contacts_a_body: int = CONTACTS_A_BODY,
    ) -> None:
        self.bodies = np.zeros(moving + boxes, BODY)
        self.warm_starts = np.zeros((moving, WARM_STARTS), WARM_START)
        self.planes = np.zeros(planes, PLANE)
        self.contacts = np.zeros(contacts_a_body * moving, CONTACT)
        # Each half-space that cuts a convex polygon adds at most one corner to it: four of another
        # box's face, or one at each edge of a plane.
        self.clipped = np.zeros((2, 4 + max(4, corners), 3))
        self.members = np.zeros(moving + boxes, MEMBER)
        self.followed = np.zeros(moving, MEMBER)
        self.pairs = np.zeros(moving * (moving - 1) // 2, PAIR)
        self.solids = np.zeros(planes + boxes, SOLID)
        self.features = np.zeros(most_features(planes, boxes, corners), FEATURE)
        touched = min(MOST_TOUCHED, planes + boxes)
        self.sphere_contacts = np.zeros(moving * touched + len(self.pairs), SPHERE_CONTACT)
        self.rows = np.zeros(min(6 * len(self.contacts), MOST_ROWS), ROW)
        self.matrix = np.zeros((len(self.rows), len(self.rows)))
        self.right = np.zeros(len(self.rows))
        self.world = np.zeros(1, WORLD)
        for name in (
            "bodies",
            "warm_starts",
            "planes",
            "contacts",
            "clipped",
            "members",
            "followed",
            "pairs",
            "solids",
            "features",
            "sphere_contacts",
            "rows",
            "matrix",
        ):
            self.world[name] = getattr(self, name).ctypes.data
        self.world["right"] = self.right.ctypes.data
        self.world["row_room"] = len(self.rows)
        self.world["contact_room"] = len(self.contacts)
        self.world["sphere_contact_room"] = len(self.sphere_contacts)
        self.world["clipped_room"] = self.clipped.shape[1]


def scratch_sizes(worlds: WorldBatch) -> tuple[int, int, int, int]:
    """Return how many moving bodies, boxes, planes and corners a batch's worlds have at most."""
    moving = int(worlds.object_counts.max())
    return moving, worlds.boxes.shape[1], worlds.planes.shape[1], worlds.corners.shape[2]
