"""Topics by which the suite's nodes meet: relative names, so one namespace is one robot."""

from __future__ import annotations

from collections.abc import Sequence

ENVIRONMENT = "environment"
"""Of intuitive_physics_msgs/Environment."""

OBJECT_STATES = "object_states"
"""Of intuitive_physics_msgs/ObjectStates."""

OBSERVATIONS = "observations"
"""Of intuitive_physics_msgs/Observation."""

STATIC_PARAMETERS = "static_parameters"
"""Of intuitive_physics_msgs/StaticParameters."""

PREDICTIONS = "predictions"
"""Of intuitive_physics_msgs/TrajectoryDistribution."""

EARLIER_NAMES = {
    "~/environment": ENVIRONMENT,
    "~/object_states": OBJECT_STATES,
    "~/observation": OBSERVATIONS,
    "~/static_parameters": STATIC_PARAMETERS,
    "~/trajectory_distribution": PREDICTIONS,
}
"""Private names of these topics in version 0.1.0; remapping rules may still use them."""


def with_earlier_remappings(arguments: Sequence[str]) -> list[str]:
    """Return a command line whose remapping rules of earlier names rename today's topics.

    Parameters
    ----------
    arguments : of a node's process, such as ["--ros-args", "-r", "~/environment:=/room"]
    """
    after_flag = [False, *(one in ("-r", "--remap") for one in arguments)]
    return [
        _translated(argument) if is_rule else argument
        for argument, is_rule in zip(arguments, after_flag, strict=False)
    ]


def _translated(rule: str) -> str:
    left, separator, target = rule.partition(":=")
    node, colon, name = left.rpartition(":")
    return f"{node}{colon}{EARLIER_NAMES.get(name, name)}{separator}{target}"
