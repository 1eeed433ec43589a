"""Methods of learning by name: the paper's update rules, and joint estimation."""

from __future__ import annotations

from intuitive_physics_learner.errors import UnknownMethodError
from intuitive_physics_learner.update_rules import UPDATE_RULES

JOINT_METHOD = "levenberg_marquardt"
"""Joint estimation of θ_s and first states (`joint_estimation`)."""

METHODS = (JOINT_METHOD, *UPDATE_RULES)
"""All names, the default first."""


def check_method(name: str) -> None:
    """Raise `UnknownMethodError` when no method has that name."""
    if name not in METHODS:
        raise UnknownMethodError(
            f"method is {name!r}; expected one of {', '.join(sorted(METHODS))}"
        )
