"""`Shape` and `ObjectState` messages, shapes and objects with their θ_d."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.messages.detections import detections_from_message, detections_to_message
from intuitive_physics.messages.fields import flat_array, float64_field, in_field
from intuitive_physics.messages.geometry import (
    MakeMessage,
    header_to_message,
    pose_to_message,
    vector_to_message,
    xyz,
    xyzw,
)
from intuitive_physics.observation import Detections
from intuitive_physics.scene import SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.state import ERROR_SIZE, ObjectState


class ShapeKind(IntEnum):
    """Codes of `Shape.kind`, as the message's definition has them."""

    SPHERE = 1
    BOX = 2
    CAPSULE = 3


DIMENSION_COUNTS = {ShapeKind.SPHERE.value: 1, ShapeKind.BOX.value: 3, ShapeKind.CAPSULE.value: 2}
"""Numbers in the field `dimensions`, by kind of shape."""

POSE = slice(0, 6)
"""Rows and columns of position and orientation in the covariance of a state."""
TWIST = slice(6, 12)
"""Rows and columns of linear and angular velocity in the covariance of a state."""


def shape_to_message(shape: Shape, make: MakeMessage) -> Any:
    """Return a shape as a message."""
    dimensions: tuple[float, ...]
    match shape:
        case Sphere():
            kind, dimensions = ShapeKind.SPHERE, (shape.radius,)
        case Box():
            kind, dimensions = ShapeKind.BOX, shape.edge_lengths
        case Capsule():
            kind, dimensions = ShapeKind.CAPSULE, (shape.radius, shape.length)
        case _:
            raise InvalidInputError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")
    return make("intuitive_physics_msgs/msg/Shape")(
        kind=kind.value, dimensions=float64_field(dimensions)
    )


def shape_from_message(message: Any) -> Shape:
    """Return the shape that a message describes.

    Raises
    ------
    InvalidInputError
        When the kind is unknown, or dimensions are missing, superfluous or not above zero.
    """
    with in_field("kind"):
        count = DIMENSION_COUNTS.get(message.kind)
        if count is None:
            raise InvalidInputError(
                f"is {message.kind}; expected {ShapeKind.SPHERE} (sphere), "
                f"{ShapeKind.BOX} (box) or {ShapeKind.CAPSULE} (capsule)"
            )
    with in_field("dimensions"):
        dimensions = flat_array(message.dimensions, (count,)).tolist()
        match message.kind:
            case ShapeKind.SPHERE:
                return Sphere(*dimensions)
            case ShapeKind.BOX:
                return Box(tuple(dimensions))
            case _:
                return Capsule(*dimensions)


def object_state_to_message(
    scene_object: SceneObject, state: ObjectState, make: MakeMessage
) -> Any:
    """Return one object with its state as a message."""
    return make("intuitive_physics_msgs/msg/ObjectState")(
        id=scene_object.id,
        material=scene_object.material,
        shape=shape_to_message(scene_object.shape, make),
        pose=make("geometry_msgs/msg/PoseWithCovariance")(
            pose=pose_to_message(state.position, state.orientation, make),
            covariance=state.covariance[POSE, POSE].ravel(),
        ),
        twist=make("geometry_msgs/msg/TwistWithCovariance")(
            twist=make("geometry_msgs/msg/Twist")(
                linear=vector_to_message(state.linear_velocity, make),
                angular=vector_to_message(state.angular_velocity, make),
            ),
            covariance=state.covariance[TWIST, TWIST].ravel(),
        ),
        pose_twist_covariance=state.covariance[POSE, TWIST].ravel(),
    )


def object_state_from_message(message: Any) -> tuple[SceneObject, ObjectState]:
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
    scene_objects: Sequence[SceneObject],
    states: Sequence[ObjectState],
    make: MakeMessage,
    *,
    frame_id: str,
    stamp: Any = None,
    detections: Sequence[Detections | None] = (),
) -> Any:
    """Return objects with their states, in the same order, as one message.

    Parameters
    ----------
    make : makes messages
    frame_id, stamp : the frame and the time that all states are in and at
    detections : of each object, at this time; None where it was not seen; empty: not known
    """
    if len(scene_objects) != len(states):
        raise InvalidInputError(
            f"{len(scene_objects)} objects and {len(states)} states; "
            "expected a state for each object"
        )
    return make("intuitive_physics_msgs/msg/ObjectStates")(
        header=header_to_message(stamp, frame_id, make),
        objects=[
            object_state_to_message(scene_object, state, make)
            for scene_object, state in zip(scene_objects, states, strict=True)
        ],
        detections=[
            detections_to_message(each, float(each.times[-1]) if each else 0.0, make)
            for each in detections
        ],
    )


def object_states_from_messages(
    messages: Sequence[Any],
) -> tuple[tuple[SceneObject, ...], tuple[ObjectState, ...]]:
    """Return the objects and the states that messages describe, in the same order.

    Raises
    ------
    InvalidInputError
        When one of them is not what it must be; ids may stand twice.
    """
    check_limit("most_objects", len(messages), "objects")
    scene_objects, states = [], []
    for i, message in enumerate(messages):
        with in_field(f"objects[{i}]"):
            scene_object, state = object_state_from_message(message)
        scene_objects.append(scene_object)
        states.append(state)
    return tuple(scene_objects), tuple(states)


def detections_from_messages(message: Any, time: float) -> tuple[Detections | None, ...]:
    """Return what an `ObjectStates` message says was detected of each of its objects.

    Parameters
    ----------
    time : s, of the message

    Returns
    -------
    None for each object that was not seen, and for all where nothing is known

    Raises
    ------
    InvalidInputError
        When there are neither none nor as many as objects, or one is not what it must be.
    """
    count, expected = len(message.detections), len(message.objects)
    if count == 0:
        return (None,) * expected
    if count != expected:
        raise InvalidInputError(
            f"{count} detections of {expected} objects; expected one for each, or none at all"
        )
    check_limit(
        "most_points",
        sum(len(detections_message.times) for detections_message in message.detections),
        "points",
    )
    detections = []
    for i, detections_message in enumerate(message.detections):
        with in_field(f"detections[{i}]"):
            detections.append(detections_from_message(detections_message, time))
    return tuple(detections)


def _covariance(message: Any) -> NDArray[np.float64]:
    matrix = np.zeros((ERROR_SIZE, ERROR_SIZE))
    with in_field("pose.covariance"):
        matrix[POSE, POSE] = flat_array(message.pose.covariance, (6, 6))
    with in_field("twist.covariance"):
        matrix[TWIST, TWIST] = flat_array(message.twist.covariance, (6, 6))
    with in_field("pose_twist_covariance"):
        matrix[POSE, TWIST] = flat_array(message.pose_twist_covariance, (6, 6))
    matrix[TWIST, POSE] = matrix[POSE, TWIST].T
    return matrix
