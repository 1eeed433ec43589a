"""`Observation` messages and Y^i."""

from __future__ import annotations

from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.messages.detections import detections_from_message, detections_to_message
from intuitive_physics.messages.environment import (
    environment_from_message,
    environment_to_message,
)
from intuitive_physics.messages.fields import flat_array, float64_field, in_field
from intuitive_physics.messages.geometry import (
    MakeMessage,
    header_to_message,
    seconds_from_stamp,
    stamp_from_seconds,
)
from intuitive_physics.messages.object_states import (
    object_state_from_message,
    object_state_to_message,
)
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.trajectory import Trajectory


def observation_to_message(observation: Observation, make: MakeMessage) -> Any:
    """Return an observation as a message; its start is rounded to a nanosecond.

    Raises
    ------
    InvalidInputError
        When it starts before time zero, where no stamp reaches.
    """
    stamp = stamp_from_seconds(observation.start_time, make)
    return make("intuitive_physics_msgs/msg/Observation")(
        header=header_to_message(stamp, observation.environment.frame_id, make),
        id=observation.id,
        environment=environment_to_message(observation.environment, make, stamp=stamp),
        objects=[_object_to_message(item, stamp, make) for item in observation.objects],
    )


def observation_from_message(message: Any) -> Observation:
    """Return the observation that a message carries.

    A message of the definition that had no detections is read too.

    Raises
    ------
    InvalidInputError
        When a part of it is not what it must be.
    """
    check_limit("most_objects", len(message.objects), "objects")
    check_limit("most_points", sum(map(_point_count, message.objects)), "points")
    with in_field("environment"):
        environment = environment_from_message(message.environment)
        if environment.frame_id != message.header.frame_id:
            raise InvalidInputError(
                f"is in the frame {environment.frame_id!r}; "
                f"expected that of the observation, {message.header.frame_id!r}"
            )
    start_time = seconds_from_stamp(message.header.stamp)
    objects = []
    for i, item in enumerate(message.objects):
        with in_field(f"objects[{i}]"):
            objects.append(_object_from_message(item, start_time))
    observation = Observation(environment, tuple(objects), start_time, message.id)
    observation.check_limits()
    return observation


def _point_count(message: Any) -> int:
    detections = getattr(message, "detections", None)
    return len(message.times) + (0 if detections is None else len(detections.times))


def _object_to_message(item: ObservedObject, stamp: Any, make: MakeMessage) -> Any:
    start_time = seconds_from_stamp(stamp)
    return make("intuitive_physics_msgs/msg/ObservedTrajectory")(
        initial_state=object_state_to_message(item.object, item.initial_state, make),
        times=float64_field(item.trajectory.times - start_time),
        positions=float64_field(item.trajectory.positions),
        detections=detections_to_message(item.detections, start_time, make),
    )


def _object_from_message(message: Any, start_time: float) -> ObservedObject:
    with in_field("initial_state"):
        scene_object, state = object_state_from_message(message.initial_state)
    count = len(message.times)
    with in_field("times"):
        times = flat_array(message.times, (count,)) + start_time
    with in_field("positions"):
        positions = flat_array(message.positions, (count, 3))
    with in_field("detections"):
        detections = detections_from_message(getattr(message, "detections", None), start_time)
    return ObservedObject(scene_object, Trajectory(times, positions), state, detections)
