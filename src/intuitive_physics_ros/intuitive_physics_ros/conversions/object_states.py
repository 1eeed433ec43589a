"""`ObjectState` messages and objects with their θ_d."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovariance, Twist, TwistWithCovariance
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectState as ObjectStateMessage
from intuitive_physics_msgs.msg import ObjectStates
from std_msgs.msg import Header

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Scene, SceneObject
from intuitive_physics.state import ERROR_SIZE, ObjectState
from intuitive_physics_ros.conversions.environment import environment_from_message
from intuitive_physics_ros.conversions.fields import flat_array, in_field
from intuitive_physics_ros.conversions.primitives import (
    pose_to_message,
    vector_to_message,
    xyz,
    xyzw,
)
from intuitive_physics_ros.conversions.shapes_and_regions import (
    shape_from_message,
    shape_to_message,
)

POSE = slice(0, 6)
"""Rows and columns of position and orientation in the covariance of a state."""
TWIST = slice(6, 12)
"""Rows and columns of linear and angular velocity in the covariance of a state."""


def object_state_to_message(thing: SceneObject, state: ObjectState) -> ObjectStateMessage:
    """Return one object with its state as a message."""
    return ObjectStateMessage(
        id=thing.id,
        material=thing.material,
        shape=shape_to_message(thing.shape),
        pose=PoseWithCovariance(
            pose=pose_to_message(state.position, state.orientation),
            covariance=state.covariance[POSE, POSE].ravel(),
        ),
        twist=TwistWithCovariance(
            twist=Twist(
                linear=vector_to_message(state.linear_velocity),
                angular=vector_to_message(state.angular_velocity),
            ),
            covariance=state.covariance[TWIST, TWIST].ravel(),
        ),
        pose_twist_covariance=state.covariance[POSE, TWIST].ravel(),
    )


def object_state_from_message(message: ObjectStateMessage) -> tuple[SceneObject, ObjectState]:
    """Return the object and the state that a message describes.

    Raises
    ------
    InvalidInputError
        When the shape, a number or the covariance is not what it must be.
    """
    with in_field("shape"):
        shape = shape_from_message(message.shape)
    pose, twist = message.pose.pose, message.twist.twist
    state = ObjectState(
        xyz(pose.position),
        xyzw(pose.orientation),
        xyz(twist.linear),
        xyz(twist.angular),
        _covariance(message),
    )
    return SceneObject(message.id, message.material, shape), state


def object_states_to_message(
    things: Sequence[SceneObject],
    states: Sequence[ObjectState],
    *,
    frame_id: str,
    stamp: Time | None = None,
) -> ObjectStates:
    """Return objects with their states, in the same order, as one message.

    Parameters
    ----------
    frame_id, stamp : the frame and the time that all states are in and at
    """
    if len(things) != len(states):
        raise InvalidInputError(
            f"{len(things)} objects and {len(states)} states; expected a state for each object"
        )
    return ObjectStates(
        header=Header(stamp=stamp or Time(), frame_id=frame_id),
        objects=list(map(object_state_to_message, things, states)),
    )


def object_states_from_messages(
    messages: Sequence[ObjectStateMessage],
) -> tuple[tuple[SceneObject, ...], tuple[ObjectState, ...]]:
    """Return the objects and the states that messages describe, in the same order.

    Raises
    ------
    InvalidInputError
        When one of them is not what it must be; ids may stand twice.
    """
    things, states = [], []
    for i, message in enumerate(messages):
        with in_field(f"objects[{i}]"):
            thing, state = object_state_from_message(message)
        things.append(thing)
        states.append(state)
    return tuple(things), tuple(states)


def scene_from_messages(
    environment: EnvironmentMessage, objects: Sequence[ObjectStateMessage]
) -> Scene:
    """Return the world that an environment and the objects in it make.

    Raises
    ------
    InvalidInputError
        When a part is not what it must be, there is no object, or an id stands twice.
    """
    with in_field("environment"):
        surroundings = environment_from_message(environment)
    things, states = object_states_from_messages(objects)
    return Scene(surroundings, things, states)


def _covariance(message: ObjectStateMessage) -> np.ndarray:
    matrix = np.zeros((ERROR_SIZE, ERROR_SIZE))
    with in_field("pose.covariance"):
        matrix[POSE, POSE] = flat_array(message.pose.covariance, (6, 6))
    with in_field("twist.covariance"):
        matrix[TWIST, TWIST] = flat_array(message.twist.covariance, (6, 6))
    with in_field("pose_twist_covariance"):
        matrix[POSE, TWIST] = flat_array(message.pose_twist_covariance, (6, 6))
    matrix[TWIST, POSE] = matrix[POSE, TWIST].T
    return matrix
