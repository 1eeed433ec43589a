"""The newest θ_s over all materials that were observed, whether learned yet or not."""

from __future__ import annotations

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_learner.store.observation_store import ObservationStore


class CurrentParameters:
    """θ_s to be used at present.

    Parameters
    ----------
    store : whose observations and θ_s it begins with

    Attributes
    ----------
    newest : θ_s of the highest version; None when nothing was learned yet

    Raises
    ------
    StorageError
        When the store cannot be read.
    """

    def __init__(self, store: ObservationStore) -> None:
        self._store = store
        self._materials = store.materials()
        self.newest = store.newest_parameters()

    @property
    def version(self) -> int:
        """Version of the newest θ_s; 0 when nothing was learned yet."""
        return 0 if self.newest is None else self.newest.version

    def read(self) -> bool:
        """Read the store; return whether θ_s is newer than the present one, or the materials
        others.

        Raises
        ------
        StorageError
            When the store cannot be read.
        """
        before, self._materials = self._materials, self._store.materials()
        newest = self._store.newest_parameters()
        if newest is None or newest.version <= self.version:
            return self._materials != before
        self.newest = newest
        return True

    def extended(self) -> LearnedParameters | None:
        """Return θ_s over all observed materials, with defaults for those that were not learned.

        None while no material is known.
        """
        if self.newest is None and not self._materials:
            return None
        newest = self.newest or LearnedParameters.defaults(self._materials)
        return newest.extended(tuple(dict.fromkeys((*newest.materials, *self._materials))))
