"""Messages, requests and goals that are as they should be, to be bent."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import (
    Environment,
    LearningOptions,
    ObjectStates,
    Observation,
    StaticParameters,
)
from intuitive_physics_msgs.srv import AddObservation, Predict, SetStaticParameters, Suggest

from benchmarks.torture.nodes import thrown_ball
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    observation_to_message,
    static_parameters_to_message,
)

# Type of the messages on /tf; None where tf2_msgs is not installed
TF_MESSAGE: Any = (
    importlib.import_module("tf2_msgs.msg").TFMessage
    if importlib.util.find_spec("tf2_msgs") is not None
    else None
)


def valid_messages() -> dict[type, Any]:
    """One message of each of our types that is as it should be, by its type."""
    seen = thrown_ball(0)
    given = static_parameters_to_message(LearnedParameters.defaults(["rubber", "wood"]))
    states = [one.initial_state for one in seen.objects]
    objects = object_states_to_message(
        [one.object for one in seen.objects], states, frame_id="environment"
    )
    room, observation = environment_to_message(seen.environment), observation_to_message(seen)
    goal = LearnParameters.Goal(options=LearningOptions(method="random", max_iterations=200))
    asked = {"environment": room, "objects": objects.objects, "static_parameters": [given]}
    return {
        Environment: room,
        ObjectStates: objects,
        StaticParameters: given,
        Observation: observation,
        AddObservation.Request: AddObservation.Request(observation=observation),
        SetStaticParameters.Request: SetStaticParameters.Request(static_parameters=given),
        Predict.Request: Predict.Request(**asked, horizon=0.5, time_step=0.01, sample_count=20),
        Suggest.Request: Suggest.Request(),
        LearnParameters.Goal: goal,
        **_valid_poses(),
    }


def _valid_poses() -> dict[type, Any]:
    """One message of each type that a pose bridge hears, in its own frame."""
    pose, covered, moved = PoseStamped(), PoseWithCovarianceStamped(), TransformStamped()
    for message in (pose, covered, moved):
        message.header.frame_id = "world"
        message.header.stamp.sec = 1
    moved.child_frame_id = "object"
    moved.transform.rotation.w = pose.pose.orientation.w = covered.pose.pose.orientation.w = 1.0
    found: dict[type, Any] = {type(one): one for one in (pose, covered, moved)}
    if TF_MESSAGE is not None:
        found[TF_MESSAGE] = TF_MESSAGE(transforms=[moved])
    return found
