"""Room for one world while the kernels work on it."""

from __future__ import annotations

import numpy as np

from intuitive_physics.simulation.stepped.world import BODY, CLIPPED, CONTACT, PLANE, WORLD
from intuitive_physics.simulation.world_batch import WorldBatch

CONTACTS_A_BODY = 48
"""Room for contacts; more than so many for each body at once are left out."""


class Scratch:
    """Room for one world; the arrays live as long as this does.

    Parameters
    ----------
    moving, boxes, planes : so many it has at most
    contacts_a_body : 0 where only gaps are asked for
    """

    def __init__(
        self, moving: int, boxes: int, planes: int, contacts_a_body: int = CONTACTS_A_BODY
    ) -> None:
        self.bodies = np.zeros(moving + boxes, BODY)
        self.planes = np.zeros(planes, PLANE)
        self.contacts = np.zeros(contacts_a_body * moving, CONTACT)
        self.clipped = np.zeros((2, CLIPPED, 3))
        self.world = np.zeros(1, WORLD)
        for name in ("bodies", "planes", "contacts", "clipped"):
            self.world[name] = getattr(self, name).ctypes.data
        self.world["contact_room"] = len(self.contacts)


def scratch_sizes(worlds: WorldBatch) -> tuple[int, int, int]:
    """Return how many bodies that move, boxes and planes a batch's largest world may have."""
    return int(worlds.object_counts.max()), worlds.boxes.shape[1], worlds.planes.shape[1]
