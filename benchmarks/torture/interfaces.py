"""What the nodes hear and offer, and how they are started so that all of it is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import Environment, ObjectStates, Observation, StaticParameters
from intuitive_physics_msgs.srv import (
    AddObservation,
    DeleteObservations,
    ExportObservations,
    GetStaticParameters,
    Learn,
    ListObservations,
    Predict,
    Query,
    SetObservationStatus,
    SetStaticParameters,
    Suggest,
)
from lifecycle_msgs.srv import (
    ChangeState,
    GetAvailableStates,
    GetAvailableTransitions,
    GetState,
)
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.action import get_action_server_names_and_types_by_node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, PointCloud2
from std_srvs.srv import Trigger
from type_description_interfaces.srv import GetTypeDescription

from benchmarks.torture.nodes import LEARNER, PERCEPTION, PREDICTOR, Nodes
from benchmarks.torture.valid_messages import TF_MESSAGE
from intuitive_physics_bringup.connections import module
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_recordings.depth_bag_writer import DepthBagWriter
from intuitive_physics_ros.scripting import Peer
from intuitive_physics_ros.topics import (
    ENVIRONMENT,
    OBJECT_STATES,
    OBSERVATIONS,
    STATIC_PARAMETERS,
)

CHANGE_STATE = "~/change_state"  # service that leads a managed node
# Services that set parameters of a node
SETTERS: dict[str, Any] = {
    "~/set_parameters": SetParameters,
    "~/set_parameters_atomically": SetParametersAtomically,
}

# Services of every node
OF_PARAMETERS: dict[str, Any] = {
    "~/describe_parameters": DescribeParameters,
    "~/get_parameters": GetParameters,
    "~/get_parameter_types": GetParameterTypes,
    "~/list_parameters": ListParameters,
    **SETTERS,
    "~/get_type_description": GetTypeDescription,
}

# Further ones of every managed node
OF_STATES: dict[str, Any] = {
    CHANGE_STATE: ChangeState,
    "~/get_state": GetState,
    "~/get_available_states": GetAvailableStates,
    "~/get_available_transitions": GetAvailableTransitions,
    "~/get_transition_graph": GetAvailableTransitions,
}

# Parameters of the time in which the nodes themselves end a request, which fuzz leaves alone
OWN_LIMITS = ("request_time_limit", "suggestion_time_limit", "search_deadline")
OWN_LIMIT = "10.0"  # s, of each of them
# Arguments with which a node hears /clock, as far as its time is not steady
CLOCKED = ("-p", "use_sim_time:=true")
CLOCK: dict[str, Any] = {"/clock": Clock}  # what it then hears
# What a node hears that looks transforms up, where tf is installed
TRANSFORMS: dict[str, Any] = (
    {} if TF_MESSAGE is None else {"/tf": TF_MESSAGE, "/tf_static": TF_MESSAGE}
)

REPLAYED_IMAGES = 30  # in the bag that is replayed again and again


@dataclass(frozen=True)
class Fuzzed:
    """A node that is fuzzed, and what of it is there with its arguments."""

    module: str  # Python module that runs it
    arguments: tuple[str, ...] = ()  # of its command line; {folder} stands for that of the run
    # topics, services, actions: types of what it hears and offers when it is active, by their names
    # as in its code; beside those of parameters and states
    topics: Mapping[str, Any] = field(default_factory=dict)
    services: Mapping[str, Any] = field(default_factory=dict)
    actions: Mapping[str, Any] = field(default_factory=dict)
    managed: bool = True  # whether it has states

    def all_services(self) -> dict[str, Any]:
        """Return the types of its services, of parameters and states too, by their names."""
        return {**self.services, **OF_PARAMETERS, **(OF_STATES if self.managed else {})}


def _limits(*names: str) -> tuple[str, ...]:
    return tuple(word for name in names for word in ("-p", f"{name}:={OWN_LIMIT}"))


# What a predictor hears
PREDICTORS_TOPICS: dict[str, Any] = {
    ENVIRONMENT: Environment,
    OBJECT_STATES: ObjectStates,
    STATIC_PARAMETERS: StaticParameters,
}

POSE_BRIDGE = "intuitive_physics_perception.nodes.pose_bridge_node"  # its module
# What a pose bridge hears of its object, by its parameter `input`
POSES: dict[str, Any] = {
    "pose": PoseStamped,
    "pose_with_covariance": PoseWithCovarianceStamped,
    "transform": TransformStamped,
}

# All by their names. Where an input excludes another, there is a node for each
FUZZED: dict[str, Fuzzed] = {
    PERCEPTION: Fuzzed(
        module(PERCEPTION),
        ("-p", "use_color:=true"),
        {
            "~/depth/image": Image,
            "~/depth/camera_info": CameraInfo,
            "~/points": PointCloud2,
            "~/color/image": Image,
        },
        {"~/rebuild_environment": Trigger},
    ),
    "perception_of_compressed": Fuzzed(
        module(PERCEPTION),
        ("-p", "use_color:=true", "-p", "input:=compressed", "-p", "gravity_source:=imu", *CLOCKED),
        {
            "~/depth/image/compressedDepth": CompressedImage,
            "~/depth/camera_info": CameraInfo,
            "~/color/image/compressed": CompressedImage,
            "~/imu": Imu,
            **CLOCK,
            **TRANSFORMS,
        },
        {"~/rebuild_environment": Trigger},
    ),
    LEARNER: Fuzzed(
        module(LEARNER),
        _limits(*OWN_LIMITS),
        {OBSERVATIONS: Observation},
        {
            "~/add_observation": AddObservation,
            "~/delete_observations": DeleteObservations,
            "~/export_observations": ExportObservations,
            "~/get_static_parameters": GetStaticParameters,
            "~/learn": Learn,
            "~/list_observations": ListObservations,
            "~/set_observation_status": SetObservationStatus,
            "~/set_static_parameters": SetStaticParameters,
            "~/suggest": Suggest,
        },
        {"~/learn_parameters": LearnParameters},
    ),
    PREDICTOR: Fuzzed(
        module(PREDICTOR),
        _limits("request_time_limit"),
        PREDICTORS_TOPICS,
        {"~/predict": Predict, "~/query": Query},
    ),
    "predictor_by_clock": Fuzzed(
        module(PREDICTOR),
        (*_limits("request_time_limit"), *CLOCKED),
        {**PREDICTORS_TOPICS, **CLOCK},
        {"~/predict": Predict, "~/query": Query},
    ),
    **{
        f"bridge_of_{wanted}": Fuzzed(
            POSE_BRIDGE, ("-p", f"input:={wanted}"), {"~/object/pose": kind, **TRANSFORMS}
        )
        for wanted, kind in POSES.items()
    },
    "replay": Fuzzed(
        "intuitive_physics_recordings.nodes.replay_node",
        (
            *("-p", "bag:={folder}/replayed", "-p", "loop:=true"),
            *("-p", "topic_prefix:=/replayed", "-p", "wait_timeout:=0.0"),
        ),
        managed=False,
    ),
}

if TRANSFORMS:
    FUZZED["bridge_of_tf"] = Fuzzed(POSE_BRIDGE, ("-p", "input:=tf"), TRANSFORMS)


def full_name(name: str, node: str) -> str:
    """Return the name of a topic or service of a node in the root, as others have to use it."""
    return name.replace("~", f"/{node}") if name[0] in "~/" else f"/{name}"


def start_fuzzed(folder: Path, peer: Peer) -> Nodes:
    """Start all nodes."""
    camera = Camera.looking_at((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    with DepthBagWriter(folder / "replayed", camera) as bag:
        for k in range(REPLAYED_IMAGES):
            image = np.full((camera.height, camera.width), 1000 + k, np.uint16)
            bag.write(k * 100_000_000, image)
    arguments = {
        name: ["-r", f"__node:={name}", *(one.format(folder=folder) for one in node.arguments)]
        for name, node in FUZZED.items()
    }
    modules = {name: node.module for name, node in FUZZED.items()}
    return Nodes(folder, peer, arguments, modules=modules)


def forgotten(peer: Peer) -> list[str]:
    """Return what running nodes hear or offer that is not fuzzed, or is and is not there."""
    found = []
    for name, node in FUZZED.items():
        own = {
            "topic": (node.topics, peer.node.get_subscriber_names_and_types_by_node(name, "/")),
            "service": (
                node.all_services(),
                peer.node.get_service_names_and_types_by_node(name, "/"),
            ),
            "action": (
                node.actions,
                get_action_server_names_and_types_by_node(peer.node, name, "/"),
            ),
        }
        for kind, (fuzzed, offered) in own.items():
            expected = {full_name(one, name) for one in fuzzed}
            there = {one for one, _ in offered if "/_action/" not in one}
            found += [f"{name} has the {kind} {one}" for one in sorted(there - expected)]
            found += [f"{name} has no {kind} {one}" for one in sorted(expected - there)]
    return found
