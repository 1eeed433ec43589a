"""Spheres among static planes and boxes, from event to event: exact, at a cost of the bounces."""

from __future__ import annotations

import numpy as np

from intuitive_physics.errors import InvalidInputError, UnsupportedSceneError
from intuitive_physics.simulation.event_driven.clusters import most_contacts
from intuitive_physics.simulation.event_driven.kernel import roll_worlds
from intuitive_physics.simulation.event_driven.solids import most_features
from intuitive_physics.simulation.event_driven.world import (
    CONTACT,
    FEATURE,
    MEMBER,
    OBJECT,
    PAIR,
    SOLID,
    WORLD,
)
from intuitive_physics.simulation.kernel_simulator import KernelSimulator
from intuitive_physics.simulation.shares import ThreadScratch
from intuitive_physics.simulation.world_batch import SPHERE, WorldBatch


class Scratch:
    """Room for one world; the arrays live as long as this does.

    Parameters
    ----------
    objects, solids, features : the most that a world has of each
    """

    def __init__(self, objects: int, solids: int, features: int) -> None:
        self.objects = np.empty(objects, OBJECT)
        self.solids = np.empty(solids, SOLID)
        self.features = np.empty(features, FEATURE)
        self.members = np.empty(objects, MEMBER)
        self.contacts = np.empty(most_contacts(objects, solids), CONTACT)
        self.pairs = np.empty(objects * objects, PAIR)
        self.world = np.zeros(1, WORLD)
        for name in ("objects", "solids", "features", "members", "contacts", "pairs"):
            self.world[name] = getattr(self, name).ctypes.data
        self.world["contact_room"] = len(self.contacts)


class EventDrivenSimulator(KernelSimulator):
    """Jumps from event to event, between which motion has a closed form.

    Free flight, sliding and rolling on a plane are parabolas; impacts are roots of polynomials.
    See `contact_phases`, `impacts` and `clusters` for the laws.

    Parameters
    ----------
    threads : worker threads over the worlds of a batch; the answer does not depend on it
    max_events : a world with more events stops and is marked TOO_MANY_EVENTS
    """

    name = "event_driven"
    scratch = ThreadScratch(Scratch)
    smallest_share = 64
    kernel = staticmethod(roll_worlds)

    def __init__(self, *, threads: int = 1, max_events: int = 100_000) -> None:
        super().__init__(threads=threads)
        if max_events < 1:
            raise InvalidInputError(f"max_events is {max_events}; expected at least 1")
        self.max_events = max_events

    def _check_supported(self, worlds: WorldBatch) -> None:
        # Padding is a sphere without air, so that whole arrays can be looked at.
        if (worlds.shape_kinds != SPHERE).any():
            raise UnsupportedSceneError(
                "scene has an object that is not a sphere; event_driven simulates spheres only, "
                "use the stepped simulator"
            )
        if worlds.has_air_forces.any():
            raise UnsupportedSceneError(
                "scene has an object with a drag or Magnus coefficient; event_driven simulates "
                "motion without air only, use the stepped simulator"
            )

    def _scratch_sizes(self, worlds: WorldBatch) -> tuple[int, ...]:
        solids = worlds.planes.shape[1] + worlds.boxes.shape[1]
        return worlds.states.shape[1], solids, most_features(worlds)

    @property
    def _kernel_option(self) -> int:
        return self.max_events
