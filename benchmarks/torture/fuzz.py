"""Messages and calls made from the interface definitions, while every node has to answer a ping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
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
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import ListParameters, SetParameters
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, PointCloud2

from benchmarks.command import report_progress
from benchmarks.torture.bars import bars
from benchmarks.torture.nodes import Nodes, thrown_ball
from benchmarks.torture.random_messages import bent, random_message
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    observation_to_message,
    static_parameters_to_message,
)
from intuitive_physics_ros.qos import LATCHED
from intuitive_physics_ros.scripting import Peer

TOPICS: dict[str, type] = {
    "/perception_node/depth/image": Image,
    "/perception_node/depth/image/compressedDepth": CompressedImage,
    "/perception_node/depth/camera_info": CameraInfo,
    "/perception_node/points": PointCloud2,
    "/perception_node/imu": Imu,
    "/environment": Environment,
    "/object_states": ObjectStates,
    "/static_parameters": StaticParameters,
    "/observations": Observation,
}
"""Topics that are sent to."""

SERVICES: dict[str, Any] = {
    "/learner_node/add_observation": AddObservation,
    "/learner_node/delete_observations": DeleteObservations,
    "/learner_node/export_observations": ExportObservations,
    "/learner_node/get_static_parameters": GetStaticParameters,
    "/learner_node/learn": Learn,
    "/learner_node/list_observations": ListObservations,
    "/learner_node/set_observation_status": SetObservationStatus,
    "/learner_node/set_static_parameters": SetStaticParameters,
    "/learner_node/suggest": Suggest,
    "/predictor_node/predict": Predict,
    "/predictor_node/query": Query,
}
"""Services that are called; nobody waits for the answers."""

CALLS = 0.25
"""Part of what is sent that are calls. Our choice."""

BENT = 0.5
"""Part that are valid messages with a few fields that are not, where there is a valid one."""

OWN_NAMES = 0.9
"""Part of the parameters to set that have the name of one."""

PAUSES = (("deactivate", "activate"), ("deactivate", "cleanup", "configure", "activate"))
"""Transitions that end where they began, in the active state."""

PAUSED = 0.3
"""Part of the requests for transitions that are such rounds; the others are of nothing that is."""

SHUTDOWNS = (5, 6, 7)
"""Transitions after which a node does as it was told, and nothing any more."""

PING_EVERY = 40
"""Messages between two pings of all nodes."""


@dataclass
class Fuzz:
    """What messages did.

    Parameters
    ----------
    sent : messages and calls
    slow : name of the node and s of each ping that took longer than a node may
    slowest : s, of a ping
    """

    sent: int = 0
    slow: list[tuple[str, float]] = field(default_factory=list)
    slowest: float = 0.0


def measure_fuzz(nodes: Nodes, peer: Peer, count: int, rng: np.random.Generator) -> Fuzz:
    """Send `count` messages and calls to running nodes."""
    send = _senders(peer)
    send["calls"] += [_parameter_sender(peer, name) for name in nodes.processes]
    send["calls"] += [_transition_sender(peer, name) for name in nodes.processes]
    found = Fuzz()
    while found.sent < count:
        kinds = list(send["calls"] if rng.random() < CALLS else send["topics"])
        target, make = kinds[int(rng.integers(len(kinds)))]
        target(make(rng))
        found.sent += 1
        if found.sent % PING_EVERY == 0:
            _ping_all(nodes, found)
        if found.sent % 2000 == 0:
            report_progress(f"{found.sent} of {count} messages, {len(nodes.deaths)} deaths")
    return found


def _ping_all(nodes: Nodes, found: Fuzz) -> None:
    for name in nodes.processes:
        took = nodes.ping(name)
        found.slowest = max(found.slowest, took)
        if took > bars().answer:
            found.slow.append((name, took))
    nodes.measure_memory()
    nodes.revive()


Send = tuple[Callable[[Any], Any], Callable[[np.random.Generator], Any]]


def _senders(peer: Peer) -> dict[str, list[Send]]:
    """What sends, and what makes what is sent."""
    valid = _valid_messages()
    topics: list[Send] = []
    # Subscribers that ask for less than this quality of service hear it as well.
    for name, kind in TOPICS.items():
        publisher = peer.node.create_publisher(kind, name, LATCHED)
        topics.append((publisher.publish, _maker(kind, valid.get(kind))))
    calls: list[Send] = []
    for name, kind in SERVICES.items():
        client = peer.node.create_client(kind, name)

        def call(request: Any, client: Any = client) -> None:
            # The answer of an earlier call need not be kept.
            client.remove_pending_request(client.call_async(request))

        calls.append((call, _maker(kind.Request, valid.get(kind.Request))))
    return {"topics": topics, "calls": calls}


def _parameter_sender(peer: Peer, node: str) -> Send:
    """What sets parameters of a node, most of them its own, to whatever there is."""
    listed = peer.call(ListParameters, f"/{node}/list_parameters", ListParameters.Request())
    names = [name for name in listed.result.names if name != "use_sim_time"]
    client = peer.node.create_client(SetParameters, f"/{node}/set_parameters")

    def make(rng: np.random.Generator) -> Any:
        request = random_message(SetParameters.Request, rng)
        for parameter in request.parameters:
            if rng.random() < OWN_NAMES:
                parameter.name = str(rng.choice(names))
            parameter.value.type = int(rng.integers(11))
        return request

    return lambda request: client.remove_pending_request(client.call_async(request)), make


def _transition_sender(peer: Peer, node: str) -> Send:
    """What leads a node through its states, and asks for transitions that do not exist."""
    client = peer.node.create_client(ChangeState, f"/{node}/change_state")

    def make(rng: np.random.Generator) -> list[Any]:
        if rng.random() < PAUSED:
            pause = PAUSES[int(rng.integers(len(PAUSES)))]
            return [ChangeState.Request(transition=Transition(label=label)) for label in pause]
        request = random_message(ChangeState.Request, rng)
        if request.transition.id in SHUTDOWNS:
            request.transition.id = 0
        return [request]

    def send(requests: list[Any]) -> None:
        for request in requests:
            client.remove_pending_request(client.call_async(request))

    return send, make


def _maker(kind: type, valid: Any) -> Callable[[np.random.Generator], Any]:
    def make(rng: np.random.Generator) -> Any:
        if valid is not None and rng.random() < BENT:
            return bent(valid, rng)
        return random_message(kind, rng)

    return make


def _valid_messages() -> dict[type, Any]:
    """One message of each of our types that is as it should be, by its type."""
    seen = thrown_ball(0)
    given = static_parameters_to_message(LearnedParameters.defaults(["rubber", "wood"]))
    states = [one.initial_state for one in seen.objects]
    objects = object_states_to_message(
        [one.object for one in seen.objects], states, frame_id="environment"
    )
    room, observation = environment_to_message(seen.environment), observation_to_message(seen)
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
    }
