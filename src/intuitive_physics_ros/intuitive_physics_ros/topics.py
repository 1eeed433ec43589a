"""Topics by which the suite's nodes meet.

Names that no other package has, and relative ones, so that one namespace is one robot.
"""

from __future__ import annotations

ENVIRONMENT = "intuitive_physics/environment"
"""Topic of intuitive_physics_msgs/Environment."""

OBJECT_STATES = "intuitive_physics/object_states"
"""Topic of intuitive_physics_msgs/ObjectStates."""

OBSERVATIONS = "intuitive_physics/observations"
"""Topic of intuitive_physics_msgs/Observation."""

STATIC_PARAMETERS = "intuitive_physics/static_parameters"
"""Topic of intuitive_physics_msgs/StaticParameters."""

PREDICTIONS = "intuitive_physics/predictions"
"""Topic of intuitive_physics_msgs/TrajectoryDistribution."""

DETECTIONS = "intuitive_physics/detections"
"""Topic of vision_msgs/Detection3DArray, where they are asked for."""
