"""Messages, requests and goals that are as they should be, to be bent."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import LearningOptions
from intuitive_physics_msgs.srv import AddObservation, Predict, SetStaticParameters, Suggest

from benchmarks.torture.interfaces import TF_MESSAGE
from benchmarks.torture.nodes import thrown_ball
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    observation_to_message,
    static_parameters_to_message,
)


def valid_messages() -> dict[type, Any]:
    """Return a valid message of each of our types, and of poses, by its type."""
    observation = thrown_ball(0)
    parameters = static_parameters_to_message(LearnedParameters.defaults(["rubber", "wood"]))
    environment = environment_to_message(observation.environment)
    states = object_states_to_message(
        [observed.object for observed in observation.objects],
        [observed.initial_state for observed in observation.objects],
        frame_id="environment",
    )
    scene = {
        "environment": environment,
        "objects": states.objects,
        "static_parameters": [parameters],
    }
    goal = LearnParameters.Goal(options=LearningOptions(method="random", max_iterations=200))
    messages = [
        environment,
        states,
        parameters,
        observation_to_message(observation),
        AddObservation.Request(observation=observation_to_message(observation)),
        SetStaticParameters.Request(static_parameters=parameters),
        Predict.Request(**scene, horizon=0.5, time_step=0.01, sample_count=20),
        Suggest.Request(),
        goal,
        *_valid_poses(),
    ]
    return {type(message): message for message in messages}


def _valid_poses() -> list[Any]:
    """Return a message of each type that a pose bridge subscribes to."""
    pose, covered, moved = PoseStamped(), PoseWithCovarianceStamped(), TransformStamped()
    for message in (pose, covered, moved):
        message.header.frame_id = "world"
        message.header.stamp.sec = 1
    moved.child_frame_id = "object"
    moved.transform.rotation.w = pose.pose.orientation.w = covered.pose.pose.orientation.w = 1.0
    return [pose, covered, moved, *([TF_MESSAGE(transforms=[moved])] if TF_MESSAGE else [])]
