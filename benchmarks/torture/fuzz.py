"""Messages and calls made from the interface definitions, while every node has to answer a ping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import ListParameters
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile

from benchmarks.command import report_progress
from benchmarks.torture.answers import Answers
from benchmarks.torture.bars import bars
from benchmarks.torture.early_end import EarlyEndError, check_deaths, noted
from benchmarks.torture.interfaces import (
    CHANGE_STATE,
    FUZZED,
    OWN_LIMITS,
    SETTERS,
    forgotten,
    full_name,
    start_fuzzed,
)
from benchmarks.torture.nodes import PATIENCE, Nodes
from benchmarks.torture.random_messages import bent, random_message
from benchmarks.torture.valid_messages import valid_messages
from intuitive_physics_ros.qos import LATCHED
from intuitive_physics_ros.scripting import Peer, PeerTimeoutError

CALLS = 0.25  # part of what is sent that are calls. Our choice
# Part that are valid messages with a few fields that are not, where there is a valid one
BENT = 0.5
OWN_NAMES = 0.9  # part of the parameters to set that have the name of one
# Transitions that end where they began, in the active state
PAUSES = (("deactivate", "activate"), ("deactivate", "cleanup", "configure", "activate"))
# Part of the requests for transitions that are such rounds; the others are of nothing that is
PAUSED = 0.3
SHUTDOWNS = (5, 6, 7)  # transitions after which a node does as it was told, and nothing any more
BACK = ("configure", "activate")  # transitions into the active state, whatever a random one led to
CANCELLED = 0.5  # part of the goals that are cancelled as soon as they are accepted
PING_EVERY = 40  # messages between two pings of all nodes
ANSWERS = QoSProfile(depth=1000)  # of a client: more answers than can wait between two looks
DRAIN = 0.01  # s for which answers are taken after each round of pings


@dataclass
class Fuzz:
    """What messages did."""

    sent: int = 0  # messages and calls
    # name of the node and s of each ping that took longer than a node may
    slow: list[tuple[str, float]] = field(default_factory=list)
    # node and service of each request that was not answered in time
    unanswered: list[str] = field(default_factory=list)
    slowest: float = 0.0  # s, of a ping
    deaths: list[str] = field(default_factory=list)  # of nodes, with the last thing each said
    megabytes: float = 0.0  # the most memory that a node has had
    # s that each node took to stop afterwards, and its exit code
    stops: dict[str, tuple[float, int]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)  # what ended it early


# What sends, and what makes what is sent
Send = tuple[Callable[[Any], Any], Callable[[np.random.Generator], Any]]


def measure_fuzz(folder: Path, count: int, rng: np.random.Generator) -> Fuzz:
    """Send messages and calls to all nodes, and stop them."""
    found = Fuzz()
    with (
        noted(found.failures),
        Peer("torturer", timeout=60.0) as peer,
        start_fuzzed(folder, peer) as nodes,
    ):
        found.deaths = nodes.deaths
        with noted(found.failures):
            _send_all(nodes, peer, count, found, rng)
        nodes.revive()
        found.megabytes = nodes.most_megabytes
        found.stops = nodes.stop()
    return found


def _send_all(nodes: Nodes, peer: Peer, count: int, found: Fuzz, rng: np.random.Generator) -> None:
    _check_reach(peer)
    answers = Answers()
    valid = valid_messages()
    topics, calls = _publishers(peer, valid), _callers(peer, answers, valid)
    found.unanswered = answers.hangs
    while found.sent < count:
        kinds = calls if rng.random() < CALLS else topics
        send, make = kinds[int(rng.integers(len(kinds)))]
        send(make(rng))
        found.sent += 1
        if found.sent % PING_EVERY == 0:
            _ping_all(nodes, peer, answers, found)
        if found.sent % 2000 == 0:
            report_progress(f"{found.sent} of {count} messages, {len(nodes.deaths)} deaths")
    while not answers.look():
        _ping_all(nodes, peer, answers, found)


def _check_reach(peer: Peer) -> None:
    try:
        peer.spin_until(lambda: not forgotten(peer), "all topics and services", PATIENCE)
    except PeerTimeoutError:
        raise EarlyEndError(f"fuzz does not reach all: {'; '.join(forgotten(peer))}") from None


def _ping_all(nodes: Nodes, peer: Peer, answers: Answers, found: Fuzz) -> None:
    for name, process in nodes.processes.items():
        took = nodes.ping(name)
        if not process.is_running:  # that is its death, and no hang
            continue
        found.slowest = max(found.slowest, took)
        if took > bars().answer:
            found.slow.append((name, took))
    nodes.measure_memory()
    peer.spin_for(DRAIN)
    for name in nodes.revive():
        answers.leave(name)
    answers.look()
    check_deaths(nodes.deaths)


def _publishers(peer: Peer, valid: dict[type, Any]) -> list[Send]:
    """What sends to each topic."""
    kinds = {
        full_name(topic, name): kind
        for name, node in FUZZED.items()
        for topic, kind in node.topics.items()
    }
    # Subscribers that ask for less than this quality of service hear it as well.
    return [
        (peer.node.create_publisher(kind, topic, LATCHED).publish, _maker(kind, valid.get(kind)))
        for topic, kind in kinds.items()
    ]


def _callers(peer: Peer, answers: Answers, valid: dict[type, Any]) -> list[Send]:
    """What calls each service and action of each node."""
    found: list[Send] = []
    for name, node in FUZZED.items():
        for service, kind in node.all_services().items():
            ask = _asker(peer, answers, name, service, kind)
            if service in SETTERS:
                found.append((ask, _parameter_maker(peer, name, kind)))
            elif service == CHANGE_STATE:
                found.append((partial(_lead, answers, name, ask), _transitions))
            else:
                found.append((ask, _maker(kind.Request, valid.get(kind.Request))))
        for action, kind in node.actions.items():
            send = _goal_sender(peer, answers, name, action, kind)
            found.append((send, _goal_maker(_maker(kind.Goal, valid.get(kind.Goal)))))
    return found


def _asker(
    peer: Peer, answers: Answers, node: str, service: str, kind: Any
) -> Callable[[Any], None]:
    client = peer.node.create_client(kind, full_name(service, node), qos_profile=ANSWERS)

    def ask(request: Any) -> None:
        future = client.call_async(request)
        forget = partial(client.remove_pending_request, future)
        if service != CHANGE_STATE and answers.awaits(node, CHANGE_STATE):
            # A node that is not active offers nothing.
            forget()
        else:
            answers.watch(node, service, future, forget)

    return ask


def _lead(answers: Answers, node: str, ask: Callable[[Any], None], requests: list[Any]) -> None:
    """Lead a node through states, in which what it was asked before may end without an answer."""
    answers.leave(node, but=CHANGE_STATE)
    for request in requests:
        ask(request)


def _goal_sender(
    peer: Peer, answers: Answers, node: str, action: str, kind: Any
) -> Callable[[tuple[Any, bool]], None]:
    client = ActionClient(
        peer.node,
        kind,
        full_name(action, node),
        goal_service_qos_profile=ANSWERS,
        result_service_qos_profile=ANSWERS,
        cancel_service_qos_profile=ANSWERS,
    )

    def watch(step: str, future: Any) -> None:
        if not answers.awaits(node, CHANGE_STATE):
            answers.watch(node, f"{action} {step}", future, lambda: None)

    def go_on(handle: Any, *, is_cancelled: bool) -> None:
        if handle.accepted:
            watch("result", handle.get_result_async())
            if is_cancelled:
                watch("cancel", handle.cancel_goal_async())

    def send(goal: tuple[Any, bool]) -> None:
        message, is_cancelled = goal
        future = client.send_goal_async(message)
        future.add_done_callback(lambda done: go_on(done.result(), is_cancelled=is_cancelled))
        watch("goal", future)

    return send


def _goal_maker(make: Callable[[np.random.Generator], Any]) -> Callable[[np.random.Generator], Any]:
    return lambda rng: (make(rng), rng.random() < CANCELLED)


def _parameter_maker(peer: Peer, node: str, kind: Any) -> Callable[[np.random.Generator], Any]:
    """What makes requests to set parameters, most of them a node's own, to whatever there is."""
    listed = peer.call(ListParameters, f"/{node}/list_parameters", ListParameters.Request())
    names = [name for name in listed.result.names if name not in ("use_sim_time", *OWN_LIMITS)]

    def make(rng: np.random.Generator) -> Any:
        request = random_message(kind.Request, rng)
        for parameter in request.parameters:
            if rng.random() < OWN_NAMES:
                parameter.name = str(rng.choice(names))
            parameter.value.type = int(rng.integers(11))
        return request

    return make


def _transitions(rng: np.random.Generator) -> list[Any]:
    """Requests that lead a node through its states, or ask for a transition that is not."""
    if rng.random() < PAUSED:
        return _led(PAUSES[int(rng.integers(len(PAUSES)))])
    request = random_message(ChangeState.Request, rng)
    if request.transition.id in SHUTDOWNS:
        request.transition.id = 0
    return [request, *_led(BACK)]


def _led(labels: tuple[str, ...]) -> list[Any]:
    return [ChangeState.Request(transition=Transition(label=label)) for label in labels]


def _maker(kind: type, valid: Any) -> Callable[[np.random.Generator], Any]:
    def make(rng: np.random.Generator) -> Any:
        if valid is not None and rng.random() < BENT:
            return bent(valid, rng)
        return random_message(kind, rng)

    return make
