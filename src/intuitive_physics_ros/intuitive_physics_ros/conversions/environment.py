"""`Environment` messages and Ω_e."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import StaticPrimitive
from std_msgs.msg import Header

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics_ros.conversions.fields import in_field
from intuitive_physics_ros.conversions.primitives import (
    point_to_message,
    points_array,
    pose_to_message,
    vector_to_message,
    xyz,
    xyzw,
)


def environment_to_message(
    environment: Environment,
    *,
    stamp: Time | None = None,
    version: int = 0,
    camera_frame_id: str = "",
    camera_pose: Pose | None = None,
) -> EnvironmentMessage:
    """Return an environment as a message, its planes before its boxes.

    Parameters
    ----------
    environment : Ω_e
    stamp : when it was modelled
    version : how often it was modelled until now
    camera_frame_id, camera_pose : where the camera stands in the environment's frame
    """
    return EnvironmentMessage(
        header=Header(stamp=stamp or Time(), frame_id=environment.frame_id),
        primitives=[
            *map(_plane_to_message, environment.planes),
            *map(_box_to_message, environment.boxes),
        ],
        gravity=vector_to_message(environment.gravity),
        camera_frame_id=camera_frame_id,
        camera_pose=camera_pose or Pose(),
        version=version,
    )


def environment_from_message(message: EnvironmentMessage) -> Environment:
    """Return the environment that a message describes.

    Raises
    ------
    InvalidInputError
        When a primitive is of no known kind or is not what its kind must be, an id stands twice,
        or gravity is not finite.
    """
    planes, boxes = [], []
    for i, primitive in enumerate(message.primitives):
        with in_field(f"primitives[{i}]"):
            match primitive.kind:
                case StaticPrimitive.PLANE:
                    planes.append(_plane_from_message(primitive))
                case StaticPrimitive.BOX:
                    boxes.append(_box_from_message(primitive))
                case kind:
                    raise InvalidInputError(
                        f"kind is {kind}; expected {StaticPrimitive.PLANE} (plane) "
                        f"or {StaticPrimitive.BOX} (box)"
                    )
    return Environment(planes, boxes, xyz(message.gravity), message.header.frame_id)


def _plane_to_message(plane: Plane) -> StaticPrimitive:
    corners = () if plane.boundary is None else plane.boundary
    return StaticPrimitive(
        kind=StaticPrimitive.PLANE,
        id=plane.id,
        material=plane.material,
        normal=vector_to_message(plane.normal),
        offset=plane.offset,
        boundary=[point_to_message(corner) for corner in corners],
    )


def _plane_from_message(message: StaticPrimitive) -> Plane:
    corners = points_array(message.boundary) if message.boundary else None
    return Plane(message.id, message.material, xyz(message.normal), message.offset, corners)


def _box_to_message(box: StaticBox) -> StaticPrimitive:
    return StaticPrimitive(
        kind=StaticPrimitive.BOX,
        id=box.id,
        material=box.material,
        pose=pose_to_message(box.center, box.orientation),
        edge_lengths=vector_to_message(box.edge_lengths),
    )


def _box_from_message(message: StaticPrimitive) -> StaticBox:
    return StaticBox(
        message.id,
        message.material,
        xyz(message.pose.position),
        xyzw(message.pose.orientation),
        xyz(message.edge_lengths),
    )
