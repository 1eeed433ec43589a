"""Messages to library objects and back, one module for each family of messages.

What recordings need too is mapped by `intuitive_physics.messages`, here with the classes of ROS.
"""

from intuitive_physics.messages.environment import environment_from_message
from intuitive_physics.messages.fields import (
    InvalidFieldError,
    float32_field,
)
from intuitive_physics.messages.geometry import seconds_from_stamp
from intuitive_physics.messages.object_states import (
    detections_from_messages,
    object_states_from_messages,
    shape_from_message,
)
from intuitive_physics.messages.observation import observation_from_message
from intuitive_physics_ros.conversions.primitives import stamp_from_seconds
from intuitive_physics_ros.conversions.scenes import (
    environment_to_message,
    object_state_to_message,
    object_states_to_message,
    observation_to_message,
    region_from_message,
    scene_from_messages,
    shape_to_message,
)
from intuitive_physics_ros.conversions.static_parameters import (
    bounds_from_messages,
    bounds_to_messages,
    static_parameters_from_message,
    static_parameters_to_message,
)

__all__ = [
    "InvalidFieldError",
    "bounds_from_messages",
    "bounds_to_messages",
    "detections_from_messages",
    "environment_from_message",
    "environment_to_message",
    "float32_field",
    "object_state_to_message",
    "object_states_from_messages",
    "object_states_to_message",
    "observation_from_message",
    "observation_to_message",
    "region_from_message",
    "scene_from_messages",
    "seconds_from_stamp",
    "shape_from_message",
    "shape_to_message",
    "stamp_from_seconds",
    "static_parameters_from_message",
    "static_parameters_to_message",
]
