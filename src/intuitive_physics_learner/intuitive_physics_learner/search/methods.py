"""Methods of learning by name: the paper's update rules, further ones, and joint estimation."""

from __future__ import annotations

from intuitive_physics_learner.errors import UnknownMethodError
from intuitive_physics_learner.search.update_rules import FURTHER_RULES, UPDATE_RULES

JOINT_METHOD = "levenberg_marquardt"
"""Joint estimation of θ_s and initial states (`joint_estimation`); where the simulation lacks an
effect that the observations have, it lowers J instead."""

DEFAULT_METHOD = JOINT_METHOD

METHODS = (
    DEFAULT_METHOD,
    *(name for name in (JOINT_METHOD, *UPDATE_RULES, *FURTHER_RULES) if name != DEFAULT_METHOD),
)
"""All names, the default first."""


def check_method(name: str) -> None:
    """Raise `UnknownMethodError` when no method has that name."""
    if name not in METHODS:
        raise UnknownMethodError(
            f"method is {name!r}; expected one of {', '.join(sorted(METHODS))}"
        )
