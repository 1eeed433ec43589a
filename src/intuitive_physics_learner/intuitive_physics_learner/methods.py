"""Methods of learning by name: the paper's update rules, and joint estimation."""

from __future__ import annotations

from intuitive_physics_learner.errors import UnknownMethodError
from intuitive_physics_learner.update_rules import UPDATE_RULES

JOINT_METHOD = "levenberg_marquardt"
"""Joint estimation of θ_s and first states (`joint_estimation`).

The quickest where the simulation has all the effects that the observations have. Where it lacks one
(the air, a shape that is not quite so) its residuals exceed the noise it expects, and it stays with
the first part of the trajectories.
"""

DEFAULT_METHOD = "cma_es"

METHODS = (DEFAULT_METHOD, JOINT_METHOD, *(name for name in UPDATE_RULES if name != DEFAULT_METHOD))
"""All names, the default first."""


def check_method(name: str) -> None:
    """Raise `UnknownMethodError` when no method has that name."""
    if name not in METHODS:
        raise UnknownMethodError(
            f"method is {name!r}; expected one of {', '.join(sorted(METHODS))}"
        )
