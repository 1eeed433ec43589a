"""Shapes, environments, objects and observations as ROS messages; regions and scenes from them."""

from __future__ import annotations

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectState as ObjectStateMessage
from intuitive_physics_msgs.msg import ObjectStates
from intuitive_physics_msgs.msg import Observation as ObservationMessage
from intuitive_physics_msgs.msg import Region as RegionMessage
from intuitive_physics_msgs.msg import Shape as ShapeMessage

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.messages import environment as environments
from intuitive_physics.messages import object_states
from intuitive_physics.messages import observation as observations
from intuitive_physics.messages.fields import in_field
from intuitive_physics.messages.geometry import xyz, xyzw
from intuitive_physics.observation import Detections, Observation
from intuitive_physics.regions import BallRegion, BoxRegion, HalfSpaceRegion, Region
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.shapes import Shape
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions.primitives import make_message


def shape_to_message(shape: Shape) -> ShapeMessage:
    """Return a shape as a message."""
    return object_states.shape_to_message(shape, make_message)


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
    return environments.environment_to_message(
        environment,
        make_message,
        stamp=stamp,
        version=version,
        camera_frame_id=camera_frame_id,
        camera_pose=camera_pose,
    )


def object_state_to_message(scene_object: SceneObject, state: ObjectState) -> ObjectStateMessage:
    """Return one object with its state as a message."""
    return object_states.object_state_to_message(scene_object, state, make_message)


def object_states_to_message(
    scene_objects: Sequence[SceneObject],
    states: Sequence[ObjectState],
    *,
    frame_id: str,
    stamp: Time | None = None,
    detections: Sequence[Detections | None] = (),
) -> ObjectStates:
    """Return objects with their states, in the same order, as one message.

    Parameters
    ----------
    frame_id, stamp : the frame and the time that all states are in and at
    detections : of each object, at this time; None where it was not seen; empty: not known
    """
    return object_states.object_states_to_message(
        scene_objects,
        states,
        make_message,
        frame_id=frame_id,
        stamp=stamp,
        detections=detections,
    )


def observation_to_message(observation: Observation) -> ObservationMessage:
    """Return an observation as a message.

    Raises
    ------
    InvalidInputError
        When it starts before time zero, where no stamp reaches.
    """
    return observations.observation_to_message(observation, make_message)


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
        surroundings = environments.environment_from_message(environment)
    scene_objects, states = object_states.object_states_from_messages(objects)
    return Scene(surroundings, scene_objects, states)


def region_from_message(message: RegionMessage) -> Region:
    """Return the region a message describes.

    Raises
    ------
    InvalidInputError
        When its kind is none of SPHERE, BOX, HALF_SPACE, a number is not finite or a size not
        above zero.
    """
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
