"""Observations as `intuitive_physics_msgs/msg/Observation`, with no ROS on the machine.

The types are made from the message definitions themselves, as rosbags reads them.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.state import ERROR_SIZE, ObjectState
from intuitive_physics.trajectory import Trajectory

PACKAGE = "intuitive_physics_msgs/msg"
OBSERVATION_TYPE = f"{PACKAGE}/Observation"

DEFINITIONS = Path(__file__).parent / "message_definitions"

NANOSECONDS = 1_000_000_000
LAST_SECOND = 2**31 - 1

POSE, TWIST = slice(0, 6), slice(6, 12)


@lru_cache(maxsize=1)
def observation_typestore() -> Typestore:
    """ROS 2 Jazzy's own types and those of this suite."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in sorted(DEFINITIONS.glob("*.msg")):
        text = path.read_text(encoding="utf-8")
        types.update(get_types_from_msg(text, f"{PACKAGE}/{path.stem}"))
    store.register(types)
    return store


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
        When it has what the message has no field for: air drag, or a start before time zero.
    """
    stamp = start_stamp(observation)
    seconds, nanoseconds = divmod(stamp, NANOSECONDS)
    header = _new(
        "std_msgs/msg/Header",
        stamp=_new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds),
        frame_id=observation.environment.frame_id,
    )
    return _new(
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
    return _new(
        f"{PACKAGE}/Environment",
        header=header,
        primitives=[
            *map(_plane_to_message, environment.planes),
            *map(_box_to_message, environment.boxes),
        ],
        gravity=_vector(environment.gravity),
        camera_frame_id="",
        camera_pose=_pose(),
        version=0,
    )


def _environment_from_message(message: Any) -> Environment:
    plane, box = _types()["StaticPrimitive"].PLANE, _types()["StaticPrimitive"].BOX
    for one in message.primitives:
        if one.kind not in (plane, box):
            raise InvalidInputError(
                f"kind of primitive {one.id} is {one.kind}; expected {plane} or {box}"
            )
    planes = [
        Plane(one.id, one.material, _xyz(one.normal), one.offset, _corners(one.boundary))
        for one in message.primitives
        if one.kind == plane
    ]
    boxes = [
        StaticBox(
            one.id,
            one.material,
            _xyz(one.pose.position),
            _xyzw(one.pose.orientation),
            _xyz(one.edge_lengths),
        )
        for one in message.primitives
        if one.kind == box
    ]
    return Environment(planes, boxes, _xyz(message.gravity), message.header.frame_id)


def _plane_to_message(plane: Plane) -> Any:
    corners = () if plane.boundary is None else plane.boundary
    return _new(
        f"{PACKAGE}/StaticPrimitive",
        kind=_types()["StaticPrimitive"].PLANE,
        id=plane.id,
        material=plane.material,
        normal=_vector(plane.normal),
        offset=plane.offset,
        boundary=[_new("geometry_msgs/msg/Point", **_named(corner)) for corner in corners],
        pose=_pose(),
        edge_lengths=_vector((0.0, 0.0, 0.0)),
    )


def _box_to_message(box: StaticBox) -> Any:
    return _new(
        f"{PACKAGE}/StaticPrimitive",
        kind=_types()["StaticPrimitive"].BOX,
        id=box.id,
        material=box.material,
        normal=_vector((0.0, 0.0, 0.0)),
        offset=0.0,
        boundary=[],
        pose=_pose(box.center, box.orientation),
        edge_lengths=_vector(box.edge_lengths),
    )


def _object_to_message(seen: ObservedObject, stamp: int) -> Any:
    thing, state = seen.object, seen.initial_state
    if thing.drag_coefficient or thing.magnus_coefficient:
        raise InvalidInputError(
            f"object {thing.id} has a drag or Magnus coefficient, for which the message has no "
            "field; keep its observation as JSON"
        )
    covariance = np.asarray(state.covariance)
    pose = _new(
        "geometry_msgs/msg/PoseWithCovariance",
        pose=_pose(state.position, state.orientation),
        covariance=covariance[POSE, POSE].ravel(),
    )
    twist = _new(
        "geometry_msgs/msg/TwistWithCovariance",
        twist=_new(
            "geometry_msgs/msg/Twist",
            linear=_vector(state.linear_velocity),
            angular=_vector(state.angular_velocity),
        ),
        covariance=covariance[TWIST, TWIST].ravel(),
    )
    return _new(
        f"{PACKAGE}/ObservedTrajectory",
        initial_state=_new(
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
        _xyz(first.pose.pose.position),
        _xyzw(first.pose.pose.orientation),
        _xyz(first.twist.twist.linear),
        _xyz(first.twist.twist.angular),
        covariance,
    )
    trajectory = Trajectory(
        np.asarray(message.times) + start, np.reshape(message.positions, (-1, 3))
    )
    thing = SceneObject(first.id, first.material, _shape_from_message(first.shape))
    return ObservedObject(thing, trajectory, state)


def _shape_to_message(shape: Shape) -> Any:
    kinds = _types()["Shape"]
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
    return _new(f"{PACKAGE}/Shape", kind=kind, dimensions=np.array(dimensions, dtype=np.float64))


def _shape_from_message(message: Any) -> Shape:
    kinds = _types()["Shape"]
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


def _types() -> dict[str, Any]:
    """Message classes of this suite by their names."""
    return {
        name.rpartition("/")[2]: made
        for name, made in observation_typestore().types.items()
        if name.startswith(PACKAGE)
    }


def _new(type_name: str, **fields: Any) -> Any:
    return observation_typestore().types[type_name](**fields)


def _named(numbers: ArrayLike) -> dict[str, float]:
    return dict(zip("xyzw", np.asarray(numbers, dtype=np.float64).tolist(), strict=False))


def _vector(numbers: ArrayLike) -> Any:
    return _new("geometry_msgs/msg/Vector3", **_named(numbers))


def _pose(position: ArrayLike = (0, 0, 0), orientation: ArrayLike = (0, 0, 0, 1)) -> Any:
    return _new(
        "geometry_msgs/msg/Pose",
        position=_new("geometry_msgs/msg/Point", **_named(position)),
        orientation=_new("geometry_msgs/msg/Quaternion", **_named(orientation)),
    )


def _xyz(message: Any) -> tuple[float, float, float]:
    return message.x, message.y, message.z


def _xyzw(message: Any) -> tuple[float, float, float, float]:
    return message.x, message.y, message.z, message.w


def _corners(points: Any) -> NDArray[np.float64] | None:
    return np.array([_xyz(point) for point in points]) if len(points) else None
