"""Methods of learning by name: joint estimation, the paper's update rules and further ones."""

from __future__ import annotations

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.trajectory import MEAN_DISTANCE
from intuitive_physics_learner.cost.wrapped_costs import CachedCost
from intuitive_physics_learner.errors import UnknownMethodError
from intuitive_physics_learner.joint_search import JointSearch
from intuitive_physics_learner.search.learning_task import LearningTask
from intuitive_physics_learner.search.parameter_search import ParameterSearch, Search
from intuitive_physics_learner.search.update_rules import ALL_RULES, make_update_rule

JOINT_METHOD = "levenberg_marquardt"
"""Joint estimation of θ_s and initial states (`joint_estimation`); where the simulation lacks an
effect that the observations have, it lowers J instead."""

DEFAULT_METHOD = JOINT_METHOD
"""The method of the nodes and of the command line where none is named."""

METHODS = (DEFAULT_METHOD, *ALL_RULES)
"""All names, the default first."""


def check_method(name: str, distance: str) -> None:
    """Check that there is such a method, and that it can minimise a distance.

    Joint estimation maximises a likelihood of the observed points; it has no distance to choose.
    """
    if name not in METHODS:
        raise UnknownMethodError.among(name, METHODS)
    if name == JOINT_METHOD and distance != MEAN_DISTANCE:
        raise InvalidInputError(
            f"distance is {distance!r} with the method {name}, which fits the observed points by "
            f"their likelihood and minimises no distance; expected the distance {MEAN_DISTANCE!r}, "
            "or a method that is an update rule, such as cma_es"
        )


def make_search(name: str, task: LearningTask, generator: np.random.Generator) -> Search:
    """Return the search by the method of that name, ready to run, as `check_method` allows it."""
    if name == JOINT_METHOD:
        return JointSearch(task, generator)
    size = task.searched.size
    rule = make_update_rule(name, size, generator, task.begin)
    return ParameterSearch(CachedCost(task.cost).costs, task.searched, rule)
