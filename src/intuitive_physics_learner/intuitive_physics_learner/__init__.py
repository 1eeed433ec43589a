"""Learning θ_s from observations: cost J, update rules, search, identifiability, storage."""

from intuitive_physics_learner.cost.cost_function import Cost, TrajectoryCost
from intuitive_physics_learner.cost.parameter_influence import active_parameters
from intuitive_physics_learner.cost.trials import Trials
from intuitive_physics_learner.errors import (
    MissingDependencyError,
    NoObservationsError,
    StorageError,
    UnknownMethodError,
)
from intuitive_physics_learner.joint_search.identifiability import Identifiability
from intuitive_physics_learner.learning_session import (
    LearningOptions,
    LearningResult,
    learn,
)
from intuitive_physics_learner.methods import DEFAULT_METHOD, JOINT_METHOD, METHODS
from intuitive_physics_learner.search.convergence import (
    ConvergenceCriteria,
    SearchProgress,
    SearchResult,
    StopReason,
)
from intuitive_physics_learner.search.parameter_search import ParameterSearch
from intuitive_physics_learner.search.search_space import ActiveSpace
from intuitive_physics_learner.search.update_rules import (
    FURTHER_RULES,
    UPDATE_RULES,
    UpdateRule,
    make_update_rule,
)
from intuitive_physics_learner.store import ObservationStore
from intuitive_physics_learner.stored_learning import learn_from_store

__all__ = [
    "DEFAULT_METHOD",
    "FURTHER_RULES",
    "JOINT_METHOD",
    "METHODS",
    "UPDATE_RULES",
    "ActiveSpace",
    "ConvergenceCriteria",
    "Cost",
    "Identifiability",
    "LearningOptions",
    "LearningResult",
    "MissingDependencyError",
    "NoObservationsError",
    "ObservationStore",
    "ParameterSearch",
    "SearchProgress",
    "SearchResult",
    "StopReason",
    "StorageError",
    "TrajectoryCost",
    "Trials",
    "UnknownMethodError",
    "UpdateRule",
    "active_parameters",
    "learn",
    "learn_from_store",
    "make_update_rule",
]
