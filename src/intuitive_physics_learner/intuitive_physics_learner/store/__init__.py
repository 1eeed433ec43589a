"""The learner's database: observations, versions of θ_s, unfinished searches."""

from intuitive_physics_learner.store.current_parameters import CurrentParameters
from intuitive_physics_learner.store.observation_entries import Assessment, ObservationEntry
from intuitive_physics_learner.store.observation_store import ObservationStore
from intuitive_physics_learner.store.online_record import OnlineRecord

__all__ = [
    "Assessment",
    "CurrentParameters",
    "ObservationEntry",
    "ObservationStore",
    "OnlineRecord",
]
