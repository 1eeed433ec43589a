"""Fields of dataclasses of settings that say in their metadata what a user may give.

A node makes its parameters of them (`intuitive_physics_ros.parameters.setting_parameters`).
"""

from __future__ import annotations

from dataclasses import field
from typing import Any


def number(default: float, lower: float, upper: float, description: str) -> Any:
    """A number from `lower` to `upper`, both allowed; a whole one where the default is."""
    return field(
        default=default,
        metadata={"description": description, "lower": lower, "upper": upper},
    )


def choice(default: str, choices: tuple[str, ...], description: str) -> Any:
    """One of some words."""
    return field(default=default, metadata={"description": description, "choices": choices})


def other(default: Any, description: str) -> Any:
    """Anything else, such as a truth value or a name."""
    return field(default=default, metadata={"description": description})
