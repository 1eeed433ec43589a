"""`Environment` messages and Ω_e."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.messages.fields import in_field
from intuitive_physics.messages.geometry import (
    MakeMessage,
    header_to_message,
    identity_pose,
    points_array,
    pose_to_message,
    vector_to_message,
    xyz,
    xyzw,
)
from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics.validation import name_string


class PrimitiveKind(IntEnum):
    """Codes of `StaticPrimitive.kind`, as the message's definition has them."""

    PLANE = 1
    BOX = 2


def environment_to_message(
    environment: Environment,
    make: MakeMessage,
    *,
    stamp: Any = None,
    version: int = 0,
    camera_frame_id: str = "",
    camera_pose: Any = None,
) -> Any:
    """Return an environment as a message, its planes before its boxes.

    Parameters
    ----------
    environment : Ω_e
    make : makes messages
    stamp : when it was modelled
    version : how often it was modelled until now
    camera_frame_id, camera_pose : where the camera stands in the environment's frame
    """
    return make("intuitive_physics_msgs/msg/Environment")(
        header=header_to_message(stamp, environment.frame_id, make),
        primitives=[
            *(_plane_to_message(plane, make) for plane in environment.planes),
            *(_box_to_message(box, make) for box in environment.boxes),
        ],
        gravity=vector_to_message(environment.gravity, make),
        camera_frame_id=camera_frame_id,
        camera_pose=camera_pose or identity_pose(make),
        version=version,
    )


def environment_from_message(message: Any) -> Environment:
    """Return the environment that a message describes.

    Raises
    ------
    InvalidInputError
        When a primitive is of no known kind or is not what its kind must be, an id stands twice,
        or gravity is not finite.
    """
    check_limit("most_primitives", len(message.primitives), "planes and boxes")
    frame_id = message.header.frame_id
    if frame_id:
        name_string(frame_id, "frame")
    planes, boxes = [], []
    for i, primitive in enumerate(message.primitives):
        with in_field(f"primitives[{i}]"):
            match primitive.kind:
                case PrimitiveKind.PLANE:
                    planes.append(_plane_from_message(primitive))
                case PrimitiveKind.BOX:
                    boxes.append(_box_from_message(primitive))
                case kind:
                    raise InvalidInputError(
                        f"kind is {kind}; expected {PrimitiveKind.PLANE} (plane) "
                        f"or {PrimitiveKind.BOX} (box)"
                    )
    return Environment(planes, boxes, xyz(message.gravity), frame_id)


def _plane_to_message(plane: Plane, make: MakeMessage) -> Any:
    point = make("geometry_msgs/msg/Point")
    corners = [] if plane.boundary is None else plane.boundary.tolist()
    return make("intuitive_physics_msgs/msg/StaticPrimitive")(
        kind=PrimitiveKind.PLANE.value,
        id=plane.id,
        material=plane.material,
        normal=vector_to_message(plane.normal, make),
        offset=plane.offset,
        boundary=[point(x=x, y=y, z=z) for x, y, z in corners],
        pose=identity_pose(make),
        edge_lengths=make("geometry_msgs/msg/Vector3")(x=0.0, y=0.0, z=0.0),
    )


def _plane_from_message(message: Any) -> Plane:
    check_limit("most_corners", len(message.boundary), f"corners of plane {message.id:.80}")
    corners = points_array(message.boundary) if len(message.boundary) else None
    return Plane(message.id, message.material, xyz(message.normal), message.offset, corners)


def _box_to_message(box: StaticBox, make: MakeMessage) -> Any:
    return make("intuitive_physics_msgs/msg/StaticPrimitive")(
        kind=PrimitiveKind.BOX.value,
        id=box.id,
        material=box.material,
        normal=make("geometry_msgs/msg/Vector3")(x=0.0, y=0.0, z=0.0),
        offset=0.0,
        boundary=[],
        pose=pose_to_message(box.center, box.orientation, make),
        edge_lengths=vector_to_message(box.edge_lengths, make),
    )


def _box_from_message(message: Any) -> StaticBox:
    return StaticBox(
        message.id,
        message.material,
        xyz(message.pose.position),
        xyzw(message.pose.orientation),
        xyz(message.edge_lengths),
    )
