"""`Observation` messages and Y^i."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from intuitive_physics_msgs.msg import Observation as ObservationMessage
from intuitive_physics_msgs.msg import ObservedTrajectory
from std_msgs.msg import Header

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_ros.conversions.environment import (
    environment_from_message,
    environment_to_message,
)
from intuitive_physics_ros.conversions.fields import flat_array, float64_field, in_field
from intuitive_physics_ros.conversions.object_states import (
    object_state_from_message,
    object_state_to_message,
)
from intuitive_physics_ros.conversions.primitives import seconds_from_stamp, stamp_from_seconds


def observation_to_message(observation: Observation) -> ObservationMessage:
    """Return an observation as a message.

    Raises
    ------
    InvalidInputError
        When it starts before time zero, where no stamp reaches.
    """
    stamp = stamp_from_seconds(observation.start_time)
    return ObservationMessage(
        header=Header(stamp=stamp, frame_id=observation.environment.frame_id),
        id=observation.id,
        environment=environment_to_message(observation.environment, stamp=stamp),
        objects=[_object_to_message(seen, stamp) for seen in observation.objects],
    )


def observation_from_message(message: ObservationMessage) -> Observation:
    """Return the observation that a message carries.

    Raises
    ------
    InvalidInputError
        When a part of it is not what it must be.
    """
    with in_field("environment"):
        environment = environment_from_message(message.environment)
        if environment.frame_id != message.header.frame_id:
            raise InvalidInputError(
                f"is in the frame {environment.frame_id!r}; "
                f"expected that of the observation, {message.header.frame_id!r}"
            )
    start_time = seconds_from_stamp(message.header.stamp)
    objects = []
    for i, seen in enumerate(message.objects):
        with in_field(f"objects[{i}]"):
            objects.append(_object_from_message(seen, start_time))
    return Observation(environment, tuple(objects), start_time, message.id)


def _object_to_message(seen: ObservedObject, stamp: Time) -> ObservedTrajectory:
    return ObservedTrajectory(
        initial_state=object_state_to_message(seen.object, seen.initial_state),
        times=float64_field(seen.trajectory.times - seconds_from_stamp(stamp)),
        positions=float64_field(seen.trajectory.positions),
    )


def _object_from_message(message: ObservedTrajectory, start_time: float) -> ObservedObject:
    with in_field("initial_state"):
        thing, state = object_state_from_message(message.initial_state)
    count = len(message.times)
    with in_field("times"):
        times = flat_array(message.times, (count,)) + start_time
    with in_field("positions"):
        positions = flat_array(message.positions, (count, 3))
    return ObservedObject(thing, Trajectory(times, positions), state)
