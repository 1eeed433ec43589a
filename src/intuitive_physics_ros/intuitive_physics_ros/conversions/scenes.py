"""Shapes, environments, objects and observations as ROS messages; regions and scenes from them.

The mapping is that of `intuitive_physics.messages`, with ROS' own classes of messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectState as ObjectStateMessage
from intuitive_physics_msgs.msg import Region as RegionMessage
from numpy.typing import NDArray
from std_msgs.msg import Header

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.messages import environment as environments
from intuitive_physics.messages import object_states
from intuitive_physics.messages import observation as observations
from intuitive_physics.messages.fields import in_field
from intuitive_physics.messages.geometry import xyz, xyzw
from intuitive_physics.regions import BallRegion, BoxRegion, HalfSpaceRegion, Region
from intuitive_physics.scene import Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions.primitives import make_message, vector_to_message

shape_to_message = partial(object_states.shape_to_message, make=make_message)
"""Returns a shape as a message."""

object_state_to_message = partial(object_states.object_state_to_message, make=make_message)
"""Returns one object with its state as a message."""

object_states_to_message = partial(object_states.object_states_to_message, make=make_message)
"""Returns objects with their states, in the same order, as one message."""

environment_to_message = partial(environments.environment_to_message, make=make_message)
"""Returns an environment as a message, its planes before its boxes."""

observation_to_message = partial(observations.observation_to_message, make=make_message)
"""Returns an observation as a message; it must not start before time zero."""


def scene_from_messages(
    environment: EnvironmentMessage, objects: Sequence[ObjectStateMessage]
) -> Scene:
    """Return the scene that an environment and the objects in it make.

    An invalid part, no object, or an id that stands twice is an InvalidInputError.
    """
    with in_field("environment"):
        surroundings = environments.environment_from_message(environment)
    scene_objects, states = object_states.object_states_from_messages(objects)
    return Scene(surroundings, scene_objects, states)


def region_from_message(message: RegionMessage) -> Region:
    """Return the region of a message; invalid numbers or kinds are an InvalidInputError."""
    center = xyz(message.pose.position)
    if message.kind == RegionMessage.SPHERE:
        return BallRegion(center, message.radius)
    if message.kind == RegionMessage.BOX:
        return BoxRegion(center, xyzw(message.pose.orientation), xyz(message.edge_lengths))
    if message.kind == RegionMessage.HALF_SPACE:
        return HalfSpaceRegion(xyz(message.normal), message.offset)
    raise InvalidInputError(
        f"region kind is {message.kind}; expected {RegionMessage.SPHERE} (SPHERE), "
        f"{RegionMessage.BOX} (BOX) or {RegionMessage.HALF_SPACE} (HALF_SPACE)"
    )


def detections_to_message(
    objects: Sequence[SceneObject], states: Sequence[ObjectState], header: Header
) -> Any:
    """Return objects as vision_msgs/Detection3DArray: box, pose with covariance, id, and class.

    The class is the material, with the score 1; the box has the object's axes. vision_msgs, which
    is optional, must be installed.
    """
    from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose

    message = Detection3DArray(header=header)
    for item, state in zip(objects, states, strict=True):
        pose = object_state_to_message(item, state).pose
        result = ObjectHypothesisWithPose(pose=pose)
        result.hypothesis.class_id, result.hypothesis.score = item.material, 1.0
        detection = Detection3D(header=header, id=item.id, results=[result])
        detection.bbox.center = pose.pose
        detection.bbox.size = vector_to_message(box_around(item.shape))
        message.detections.append(detection)
    return message


def box_around(shape: Shape) -> NDArray[np.float64]:
    """Return the edge lengths (3,), m, of the box along a shape's axes that just holds it."""
    if isinstance(shape, Box):
        return np.array(shape.edge_lengths)
    if isinstance(shape, Capsule):
        return 2.0 * shape.radius + np.array([0.0, 0.0, shape.length])
    return np.full(3, 2.0 * shape.bounding_radius)
