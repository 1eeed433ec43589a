"""The learner's database: observations, versions of θ_s, unfinished searches."""

from intuitive_physics_learner.store.current_parameters import CurrentParameters
from intuitive_physics_learner.store.observation_store import ObservationStore
from intuitive_physics_learner.store.search_checkpoint import SearchCheckpoint

__all__ = ["CurrentParameters", "ObservationStore", "SearchCheckpoint"]
