"""Room for one world while the kernels work on it."""

from __future__ import annotations

import numpy as np

from intuitive_physics.simulation.stepped.world import BODY, CLIPPED, CONTACT, CORNER, PLANE, WORLD
from intuitive_physics.simulation.world_batch import WorldBatch

CONTACTS_A_BODY = 48
"""Room for contacts; more than so many for each body at once are left out."""


class Scratch:
    """Room for the largest world of a batch; the arrays live as long as this does.

    Parameters
    ----------
    contacts_a_body : 0 where only gaps are asked for
    """

    def __init__(self, worlds: WorldBatch, contacts_a_body: int = CONTACTS_A_BODY) -> None:
        moving = int(worlds.object_counts.max())
        self.bodies = np.zeros(moving + worlds.boxes.shape[1], BODY)
        self.planes = np.zeros(worlds.planes.shape[1], PLANE)
        self.contacts = np.zeros(contacts_a_body * moving, CONTACT)
        self.clipped = np.zeros((2, CLIPPED), CORNER)
        self.world = np.zeros(1, WORLD)
        for name in ("bodies", "planes", "contacts", "clipped"):
            self.world[name] = getattr(self, name).ctypes.data
        self.world["contact_room"] = len(self.contacts)
