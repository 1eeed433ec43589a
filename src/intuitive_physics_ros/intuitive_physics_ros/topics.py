"""Topics by which the suite's nodes meet: relative names, so one namespace is one robot."""

from __future__ import annotations

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
