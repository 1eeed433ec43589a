"""The topics, services and actions of the nodes, and how they are started so that all are there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import Environment, ObjectStates, Observation, StaticParameters
from lifecycle_msgs.srv import GetAvailableTransitions
from rclpy.action import get_action_server_names_and_types_by_node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, PointCloud2
from std_srvs.srv import Trigger

from benchmarks.running_nodes import LEARNER, PERCEPTION, PREDICTOR, parameter_arguments
from benchmarks.torture.nodes import Nodes
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

Interfaces = dict[str, Any]
"""Types of topics, services or actions, by their names as in the code of the node."""


def _services(package: str, *types: str) -> Interfaces:
    """Return services in the namespace of a node that are named after their types."""
    kinds = import_module(f"{package}.srv")
    return {f"~/{re.sub('(?<=.)(?=[A-Z])', '_', t).lower()}": getattr(kinds, t) for t in types}


CHANGE_STATE = "~/change_state"  # service that leads a managed node
SETTERS = _services("rcl_interfaces", "SetParameters", "SetParametersAtomically")
# Services of every node
OF_PARAMETERS: Interfaces = {
    **_services("rcl_interfaces", "DescribeParameters", "GetParameters", "GetParameterTypes"),
    **_services("rcl_interfaces", "ListParameters"),
    **SETTERS,
    **_services("type_description_interfaces", "GetTypeDescription"),
}
# Further services of every managed node
OF_STATES: Interfaces = {
    **_services("lifecycle_msgs", "ChangeState", "GetState", "GetAvailableStates"),
    **_services("lifecycle_msgs", "GetAvailableTransitions"),
    "~/get_transition_graph": GetAvailableTransitions,
}

# Parameters of the time in which the nodes themselves end a request, which fuzz does not change
OWN_LIMITS = ("request_time_limit", "suggestion_time_limit", "search_deadline")
OWN_LIMIT = "10.0"  # s, of each of them
# Arguments with which a node subscribes to /clock, unless it uses steady time only
CLOCKED = ("-p", "use_sim_time:=true")
CLOCK: Interfaces = {"/clock": Clock}
# None where tf2_msgs is not installed
TF_MESSAGE: Any = import_module("tf2_msgs.msg").TFMessage if find_spec("tf2_msgs") else None
# Subscriptions of a node that looks up transforms, where tf is installed
TRANSFORMS: Interfaces = (
    {} if TF_MESSAGE is None else dict.fromkeys(("/tf", "/tf_static"), TF_MESSAGE)
)
REPLAYED_IMAGES = 30  # in the bag that is replayed again and again


@dataclass(frozen=True)
class Fuzzed:
    """A node that is fuzzed, and its interfaces while it is active with its arguments."""

    module: str  # Python module that runs it
    arguments: tuple[str, ...] = ()  # of its command line; {folder} stands for that of the run
    topics: Interfaces = field(default_factory=dict)  # that it subscribes to
    services: Interfaces = field(default_factory=dict)  # without those of parameters and states
    actions: Interfaces = field(default_factory=dict)
    managed: bool = True  # whether it has states

    def all_services(self) -> Interfaces:
        """Return its services, with those of parameters and states."""
        return {**self.services, **OF_PARAMETERS, **(OF_STATES if self.managed else {})}


def _limits(*names: str) -> tuple[str, ...]:
    return tuple(parameter_arguments(**dict.fromkeys(names, OWN_LIMIT)))


PREDICTORS_TOPICS: Interfaces = {
    ENVIRONMENT: Environment,
    OBJECT_STATES: ObjectStates,
    STATIC_PARAMETERS: StaticParameters,
}
POSE_BRIDGE = "intuitive_physics_perception.nodes.pose_bridge_node"  # its module
# Type of the poses that a pose bridge subscribes to, by its parameter `input`
POSES: Mapping[str, Any] = {
    "pose": PoseStamped,
    "pose_with_covariance": PoseWithCovarianceStamped,
    "transform": TransformStamped,
}

# All by their names. Where an input excludes another, there is a node for each.
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
        _services(
            "intuitive_physics_msgs",
            *("AddObservation", "DeleteObservations", "ExportObservations", "ListObservations"),
            *("GetStaticParameters", "SetStaticParameters", "SetObservationStatus"),
            *("Learn", "Suggest"),
        ),
        {"~/learn_parameters": LearnParameters},
    ),
    PREDICTOR: Fuzzed(
        module(PREDICTOR),
        _limits("request_time_limit"),
        PREDICTORS_TOPICS,
        _services("intuitive_physics_msgs", "Predict", "Query"),
    ),
    "predictor_by_clock": Fuzzed(
        module(PREDICTOR),
        (*_limits("request_time_limit"), *CLOCKED),
        {**PREDICTORS_TOPICS, **CLOCK},
        _services("intuitive_physics_msgs", "Predict", "Query"),
    ),
    **{
        f"bridge_of_{kind}": Fuzzed(
            POSE_BRIDGE, ("-p", f"input:={kind}"), {"~/object/pose": pose, **TRANSFORMS}
        )
        for kind, pose in POSES.items()
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
    """Start all nodes, with a learner's database and a bag to replay in a folder."""
    camera = Camera.looking_at((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    with DepthBagWriter(folder / "replayed", camera) as bag:
        for k in range(REPLAYED_IMAGES):
            image = np.full((camera.height, camera.width), 1000 + k, np.uint16)
            bag.write(k * 100_000_000, image)
    arguments = {
        name: ["-r", f"__node:={name}", *(word.format(folder=folder) for word in node.arguments)]
        for name, node in FUZZED.items()
    }
    modules = {name: node.module for name, node in FUZZED.items()}
    return Nodes(folder, peer, arguments, modules=modules)


def unreached(peer: Peer) -> list[str]:
    """Return interfaces of running nodes that are not fuzzed, and fuzzed ones that are absent."""
    problems = []
    for name, node in FUZZED.items():
        graph = peer.node
        offered = {
            "topic": (node.topics, graph.get_subscriber_names_and_types_by_node(name, "/")),
            "service": (node.all_services(), graph.get_service_names_and_types_by_node(name, "/")),
            "action": (node.actions, get_action_server_names_and_types_by_node(graph, name, "/")),
        }
        for kind, (fuzzed, present) in offered.items():
            expected = {full_name(interface, name) for interface in fuzzed}
            there = {interface for interface, _ in present if "/_action/" not in interface}
            problems += [f"{name} has the {kind} {extra}" for extra in sorted(there - expected)]
            problems += [f"{name} has no {kind} {absent}" for absent in sorted(expected - there)]
    return problems
