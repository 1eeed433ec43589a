"""ROS messages by the names of their types; vectors, points, quaternions, poses and stamps."""

from __future__ import annotations

from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from intuitive_physics_msgs.msg import (
    Detections,
    Environment,
    ObjectState,
    ObjectStates,
    Observation,
    ObservedTrajectory,
    Shape,
    StaticPrimitive,
)
from numpy.typing import ArrayLike
from std_msgs.msg import Header

from intuitive_physics.messages import geometry

MESSAGE_CLASSES: dict[str, Any] = {
    "builtin_interfaces/msg/Time": Time,
    "geometry_msgs/msg/Point": Point,
    "geometry_msgs/msg/Pose": Pose,
    "geometry_msgs/msg/PoseWithCovariance": PoseWithCovariance,
    "geometry_msgs/msg/Quaternion": Quaternion,
    "geometry_msgs/msg/Twist": Twist,
    "geometry_msgs/msg/TwistWithCovariance": TwistWithCovariance,
    "geometry_msgs/msg/Vector3": Vector3,
    "intuitive_physics_msgs/msg/Detections": Detections,
    "intuitive_physics_msgs/msg/Environment": Environment,
    "intuitive_physics_msgs/msg/ObjectState": ObjectState,
    "intuitive_physics_msgs/msg/ObjectStates": ObjectStates,
    "intuitive_physics_msgs/msg/Observation": Observation,
    "intuitive_physics_msgs/msg/ObservedTrajectory": ObservedTrajectory,
    "intuitive_physics_msgs/msg/Shape": Shape,
    "intuitive_physics_msgs/msg/StaticPrimitive": StaticPrimitive,
    "std_msgs/msg/Header": Header,
}
"""Classes of the messages that the library's mapping makes, by the names of their types."""


make_message = MESSAGE_CLASSES.__getitem__
"""Gives the class of a message by the name of its type, as the library's mapping asks for it."""


vector_to_message = partial(geometry.vector_to_message, make=make_message)
"""Returns a vector of shape (3,) as a message."""

point_to_message = partial(geometry.point_to_message, make=make_message)
"""Returns a point of shape (3,), m, as a message."""

quaternion_to_message = partial(geometry.quaternion_to_message, make=make_message)
"""Returns a quaternion (x, y, z, w), shape (4,), as a message."""

stamp_from_seconds = partial(geometry.stamp_from_seconds, make=make_message)
"""Returns the stamp nearest to a time in s, from 0 to 2038-01-19 as the message allows."""


def pose_to_message(position: ArrayLike, orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    """Return a pose as a message: position (3,) in m, orientation (4,) as (x, y, z, w)."""
    return geometry.pose_to_message(position, orientation, make_message)
