"""The newest θ_s over all materials that were observed, whether learned yet or not."""

from __future__ import annotations

import threading

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_learner.store.observation_store import ObservationStore


class CurrentParameters:
    """θ_s to be used at present.

    Attributes
    ----------
    newest : θ_s of the highest version; None when nothing was learned yet
    """

    def __init__(self, store: ObservationStore) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._materials = store.materials()
        self.newest = store.newest_parameters()

    @property
    def version(self) -> int:
        """Version of the newest θ_s; 0 when nothing was learned yet."""
        return 0 if self.newest is None else self.newest.version

    def read(self) -> bool:
        """Read the store; return whether θ_s is newer than the present one, or the materials
        others.
        """
        materials, newest = self._store.materials(), self._store.newest_parameters()
        with self._lock:
            before, self._materials = self._materials, materials
        taken = newest is not None and self.take(newest)
        return taken or materials != before

    def take(self, learned: LearnedParameters) -> bool:
        """Take θ_s over unless its version is none above the present one; return whether it is.

        Any thread may call this: whoever is late does not undo what was newer.
        """
        with self._lock:
            if learned.version <= self.version:
                return False
            self.newest = learned
            return True

    def extended(self) -> LearnedParameters | None:
        """Return θ_s over all observed materials, new ones by default; None without any."""
        if self.newest is None and not self._materials:
            return None
        newest = self.newest or LearnedParameters.defaults(self._materials)
        return newest.extended(tuple(dict.fromkeys((*newest.materials, *self._materials))))
