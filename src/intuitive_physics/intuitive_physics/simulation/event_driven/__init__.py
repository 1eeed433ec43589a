"""Spheres among static planes and boxes, from event to event: exact, at a cost of the bounces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnsupportedSceneError
from intuitive_physics.simulation.event_driven.clusters import most_contacts
from intuitive_physics.simulation.event_driven.kernel import roll_worlds
from intuitive_physics.simulation.event_driven.solids import most_features
from intuitive_physics.simulation.event_driven.world import (
    CONTACT,
    FEATURE,
    OBJECT,
    PAIR,
    SOLID,
    WORLD,
)
from intuitive_physics.simulation.shares import run_in_shares
from intuitive_physics.simulation.simulator import Rollout, Simulator
from intuitive_physics.simulation.thread_scratch import ThreadScratch
from intuitive_physics.simulation.world_batch import SPHERE, WorldBatch

SMALLEST_SHARE = 64
"""Worlds for which another thread is worth its start."""


class Scratch:
    """Room for one world of so many objects, solids and features of solids."""

    def __init__(self, objects: int, solids: int, features: int) -> None:
        self.objects = np.empty(objects, OBJECT)
        self.solids = np.empty(solids, SOLID)
        self.features = np.empty(features, FEATURE)
        self.contacts = np.empty(most_contacts(objects, solids), CONTACT)
        self.pairs = np.empty(objects * objects, PAIR)
        self.world = np.empty(1, WORLD)


SCRATCH = ThreadScratch(Scratch)


class EventDrivenSimulator(Simulator):
    """Jumps from event to event, between which motion has a closed form.

    Free flight, sliding and rolling on a plane are parabolas; impacts are roots of polynomials.
    See `contact_phases`, `impacts` and `clusters` for the laws.

    Parameters
    ----------
    threads : worker threads over the worlds of a batch; the answer does not depend on it
    max_events : a world with more events stops and is marked TOO_MANY_EVENTS
    """

    name = "event_driven"
    takes_contact_noise = True

    def __init__(self, *, threads: int = 1, max_events: int = 100_000) -> None:
        if threads < 1 or max_events < 1:
            raise InvalidInputError(
                f"threads is {threads} and max_events {max_events}; expected at least 1 of each"
            )
        self.threads = threads
        self.max_events = max_events

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        _check_supported(worlds)
        count, objects = worlds.dimensions.shape[:2]
        positions = np.empty((count, objects, times.shape[1], 3))
        turned = np.empty((count, objects if orientations else 0, times.shape[1], 4))
        status = np.empty(count, dtype=np.int64)
        solids = worlds.planes.shape[1] + worlds.boxes.shape[1]
        features = most_features(worlds)

        def roll(first: int, last: int) -> None:
            scratch = SCRATCH.of_size(objects, solids, features)
            roll_worlds(
                first,
                last,
                worlds.object_counts,
                worlds.dimensions,
                worlds.object_materials,
                worlds.states,
                worlds.environment_index,
                worlds.gravity,
                worlds.plane_counts,
                worlds.planes,
                worlds.plane_materials,
                worlds.corner_counts,
                worlds.corners,
                worlds.box_counts,
                worlds.boxes,
                worlds.box_materials,
                worlds.parameter_index,
                worlds.density,
                worlds.coefficients,
                worlds.noise_keys,
                worlds.contact_noise,
                times,
                self.max_events,
                scratch.world,
                scratch.objects,
                scratch.solids,
                scratch.features,
                scratch.contacts,
                scratch.pairs,
                positions,
                turned,
                status,
            )

        run_in_shares(roll, count, self.threads, SMALLEST_SHARE)
        return Rollout(positions, turned if orientations else None, status)


def _check_supported(worlds: WorldBatch) -> None:
    # Padding is a sphere without air, so that whole arrays can be looked at.
    if (worlds.shape_kinds != SPHERE).any():
        raise UnsupportedSceneError(
            "scene has an object that is not a sphere; event_driven simulates spheres only, "
            "use the stepped simulator"
        )
    if worlds.air_factors.any():
        raise UnsupportedSceneError(
            "scene has an object with a drag or Magnus coefficient; event_driven simulates motion "
            "without air only, use the stepped simulator"
        )
