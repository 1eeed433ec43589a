"""Observations as `intuitive_physics_msgs/msg/Observation`, with no ROS on the machine."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.state import ERROR_SIZE, ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_recordings.ros_messages import (
    PACKAGE,
    new_message,
    point_message,
    pose_message,
    suite_types,
    vector_message,
    xyz,
    xyzw,
)

OBSERVATION_TYPE = f"{PACKAGE}/Observation"
"""Name of the message type."""

NANOSECONDS = 1_000_000_000
"""In a second."""

LAST_SECOND = 2**31 - 1
"""s; `builtin_interfaces/Time` counts seconds as a signed 32-bit number."""

POSE, TWIST = slice(0, 6), slice(6, 12)
"""Rows and columns of pose and velocities in the covariance of a state."""


def start_stamp(observation: Observation) -> int:
    """Start of an observation in ns since the epoch of its clock.

    Raises
    ------
    InvalidInputError
        When no stamp of a message reaches that far.
    """
    stamp = round(observation.start_time * NANOSECONDS)
    if not 0 <= stamp <= LAST_SECOND * NANOSECONDS:
        raise InvalidInputError(
            f"observation {observation.id} starts at {observation.start_time:g} s; "
            f"expected 0 to {LAST_SECOND} s, as messages can carry it"
        )
    return stamp


def observation_to_message(observation: Observation) -> Any:
    """Return an observation as a message; its start is rounded to a nanosecond.

    Raises
    ------
    InvalidInputError
        When it has what the message has no field for, such as air drag, or starts before time
        zero.
    """
    stamp = start_stamp(observation)
    seconds, nanoseconds = divmod(stamp, NANOSECONDS)
    header = new_message(
        "std_msgs/msg/Header",
        stamp=new_message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds),
        frame_id=observation.environment.frame_id,
    )
    return new_message(
        OBSERVATION_TYPE,
        header=header,
        id=observation.id,
        environment=_environment_to_message(observation.environment, header),
        objects=[_object_to_message(seen, stamp) for seen in observation.objects],
    )


def observation_from_message(message: Any) -> Observation:
    """Return the observation that a message carries.

    Raises
    ------
    InvalidInputError
        When a part of it is not what it must be.
    """
    try:
        start = message.header.stamp.sec + message.header.stamp.nanosec / NANOSECONDS
        return Observation(
            _environment_from_message(message.environment),
            tuple(_object_from_message(seen, start) for seen in message.objects),
            start,
            message.id,
        )
    except (AttributeError, ValueError) as error:
        raise InvalidInputError(
            f"message is no observation of this version: {error}; "
            f"expected the fields of {OBSERVATION_TYPE}"
        ) from None


def _environment_to_message(environment: Environment, header: Any) -> Any:
    return new_message(
        f"{PACKAGE}/Environment",
        header=header,
        primitives=[
            *map(_plane_to_message, environment.planes),
            *map(_box_to_message, environment.boxes),
        ],
        gravity=vector_message(environment.gravity),
        camera_frame_id="",
        camera_pose=pose_message(),
        version=0,
    )


def _environment_from_message(message: Any) -> Environment:
    plane, box = (
        suite_types()["StaticPrimitive"].PLANE,
        suite_types()["StaticPrimitive"].BOX,
    )
    for one in message.primitives:
        if one.kind not in (plane, box):
            raise InvalidInputError(
                f"kind of primitive {one.id} is {one.kind}; expected {plane} or {box}"
            )
    planes = [
        Plane(one.id, one.material, xyz(one.normal), one.offset, _corners(one.boundary))
        for one in message.primitives
        if one.kind == plane
    ]
    boxes = [
        StaticBox(
            one.id,
            one.material,
            xyz(one.pose.position),
            xyzw(one.pose.orientation),
            xyz(one.edge_lengths),
        )
        for one in message.primitives
        if one.kind == box
    ]
    return Environment(planes, boxes, xyz(message.gravity), message.header.frame_id)


def _plane_to_message(plane: Plane) -> Any:
    corners = () if plane.boundary is None else plane.boundary
    return new_message(
        f"{PACKAGE}/StaticPrimitive",
        kind=suite_types()["StaticPrimitive"].PLANE,
        id=plane.id,
        material=plane.material,
        normal=vector_message(plane.normal),
        offset=plane.offset,
        boundary=[point_message(corner) for corner in corners],
        pose=pose_message(),
        edge_lengths=vector_message((0.0, 0.0, 0.0)),
    )


def _box_to_message(box: StaticBox) -> Any:
    return new_message(
        f"{PACKAGE}/StaticPrimitive",
        kind=suite_types()["StaticPrimitive"].BOX,
        id=box.id,
        material=box.material,
        normal=vector_message((0.0, 0.0, 0.0)),
        offset=0.0,
        boundary=[],
        pose=pose_message(box.center, box.orientation),
        edge_lengths=vector_message(box.edge_lengths),
    )


def _object_to_message(seen: ObservedObject, stamp: int) -> Any:
    thing, state = seen.object, seen.initial_state
    if thing != SceneObject(thing.id, thing.material, thing.shape):
        raise InvalidInputError(
            f"object {thing.id} has a drag or Magnus coefficient or an inertia factor, for which "
            "the message has no field; keep its observation as JSON"
        )
    covariance = np.asarray(state.covariance)
    pose = new_message(
        "geometry_msgs/msg/PoseWithCovariance",
        pose=pose_message(state.position, state.orientation),
        covariance=covariance[POSE, POSE].ravel(),
    )
    twist = new_message(
        "geometry_msgs/msg/TwistWithCovariance",
        twist=new_message(
            "geometry_msgs/msg/Twist",
            linear=vector_message(state.linear_velocity),
            angular=vector_message(state.angular_velocity),
        ),
        covariance=covariance[TWIST, TWIST].ravel(),
    )
    return new_message(
        f"{PACKAGE}/ObservedTrajectory",
        initial_state=new_message(
            f"{PACKAGE}/ObjectState",
            id=thing.id,
            material=thing.material,
            shape=_shape_to_message(thing.shape),
            pose=pose,
            twist=twist,
            pose_twist_covariance=covariance[POSE, TWIST].ravel(),
        ),
        times=seen.trajectory.times - stamp / NANOSECONDS,
        positions=seen.trajectory.positions.ravel(),
    )


def _object_from_message(message: Any, start: float) -> ObservedObject:
    first = message.initial_state
    covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
    covariance[POSE, POSE] = np.reshape(first.pose.covariance, (6, 6))
    covariance[TWIST, TWIST] = np.reshape(first.twist.covariance, (6, 6))
    covariance[POSE, TWIST] = np.reshape(first.pose_twist_covariance, (6, 6))
    covariance[TWIST, POSE] = covariance[POSE, TWIST].T
    state = ObjectState(
        xyz(first.pose.pose.position),
        xyzw(first.pose.pose.orientation),
        xyz(first.twist.twist.linear),
        xyz(first.twist.twist.angular),
        covariance,
    )
    trajectory = Trajectory(
        np.asarray(message.times) + start, np.reshape(message.positions, (-1, 3))
    )
    thing = SceneObject(first.id, first.material, _shape_from_message(first.shape))
    return ObservedObject(thing, trajectory, state)


def _shape_to_message(shape: Shape) -> Any:
    kinds = suite_types()["Shape"]
    dimensions: tuple[float, ...]
    match shape:
        case Sphere():
            kind, dimensions = kinds.SPHERE, (shape.radius,)
        case Box():
            kind, dimensions = kinds.BOX, shape.edge_lengths
        case Capsule():
            kind, dimensions = kinds.CAPSULE, (shape.radius, shape.length)
        case _:
            raise InvalidInputError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")
    return new_message(
        f"{PACKAGE}/Shape", kind=kind, dimensions=np.array(dimensions, dtype=np.float64)
    )


def _shape_from_message(message: Any) -> Shape:
    kinds = suite_types()["Shape"]
    dimensions = tuple(float(number) for number in message.dimensions)
    match (message.kind, len(dimensions)):
        case (kinds.SPHERE, 1):
            return Sphere(*dimensions)
        case (kinds.BOX, 3):
            length, width, height = dimensions
            return Box((length, width, height))
        case (kinds.CAPSULE, 2):
            return Capsule(*dimensions)
    raise InvalidInputError(
        f"shape has the kind {message.kind} and {len(dimensions)} dimensions; expected "
        f"{kinds.SPHERE} (sphere) with 1, {kinds.BOX} (box) with 3, {kinds.CAPSULE} (capsule) "
        "with 2"
    )


def _corners(points: Any) -> NDArray[np.float64] | None:
    return np.array([xyz(point) for point in points]) if len(points) else None
