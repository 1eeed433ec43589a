"""Which topic of which node is heard by which: said once, for all that start them."""

from __future__ import annotations

NODES: dict[str, str] = {
    "perception_node": "intuitive_physics_perception",
    "learner_node": "intuitive_physics_learner",
    "predictor_node": "intuitive_physics_predictor",
}
"""Package of each node; node, executable and module (in `nodes/`) have the same name."""

_HEARD: dict[str, dict[str, str]] = {
    "perception_node": {},
    "learner_node": {"~/observation": "perception_node/observation"},
    "predictor_node": {
        "~/environment": "perception_node/environment",
        "~/object_states": "perception_node/object_states",
        "~/static_parameters": "learner_node/static_parameters",
    },
}
"""Topics that a node subscribes to, by the names of their publishers."""

CAMERA_TOPICS: dict[str, str] = {
    "~/depth/image": "/camera/depth/image_rect_raw",
    "~/depth/camera_info": "/camera/depth/camera_info",
    "~/points": "/camera/depth/color/points",
    "~/imu": "/camera/imu",
}
"""Topics of the perception node's inputs; these are what common depth cameras publish."""


def remappings(node: str) -> list[tuple[str, str]]:
    """Return (from, to) of each topic a node hears from another node of the suite."""
    return list(_HEARD[node].items())


def module(node: str) -> str:
    """Return the Python module whose `main` runs a node."""
    return f"{NODES[node]}.nodes.{node}"
