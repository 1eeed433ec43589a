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

from benchmarks.command import Outcome, report_progress
from benchmarks.results.result import Column
from benchmarks.torture.answers import LIMIT, Answers
from benchmarks.torture.bars import bars
from benchmarks.torture.early_end import EarlyEndError, check_deaths, noted
from benchmarks.torture.interfaces import (
    CHANGE_STATE,
    FUZZED,
    OWN_LIMITS,
    SETTERS,
    full_name,
    start_fuzzed,
    unreached,
)
from benchmarks.torture.nodes import PATIENCE, Nodes
from benchmarks.torture.part import (
    MOST_MEGABYTES,
    Stops,
    missed_stops,
    row_table,
    slowest_stop,
)
from benchmarks.torture.random_messages import bent, random_message
from benchmarks.torture.valid_messages import valid_messages
from intuitive_physics_ros.qos import LATCHED
from intuitive_physics_ros.scripting import Peer, PeerTimeoutError

CALLS = 0.25  # part of the messages that are calls. Our choice
BENT = 0.5  # part that are valid messages with a few wrong fields, where there is a valid one
OWN_NAMES = 0.9  # part of the parameters to set that have the name of a parameter of the node
# Transitions that end where they began, in the active state
PAUSES = (("deactivate", "activate"), ("deactivate", "cleanup", "configure", "activate"))
PAUSED = 0.3  # part of the requests for transitions that are such rounds; the others are random
SHUTDOWNS = (5, 6, 7)  # transitions after which a node rightly does nothing
BACK = ("configure", "activate")  # transitions into the active state after a random one
CANCELLED = 0.5  # part of the goals that are cancelled as soon as they are accepted
PING_EVERY = 40  # messages between two pings of all nodes
ANSWERS = QoSProfile(depth=1000)  # of a client: more answers than can wait between two pings
DRAIN = 0.01  # s for which answers are taken after each round of pings


@dataclass
class Fuzz:
    """The effects of random messages."""

    sent: int = 0  # messages and calls
    slow: list[tuple[str, float]] = field(default_factory=list)  # node and s of each slow ping
    unanswered: list[str] = field(default_factory=list)  # node and service of each hanging request
    slowest: float = 0.0  # s, of a ping
    deaths: list[str] = field(default_factory=list)  # of nodes, with the last words of each
    megabytes: float = 0.0  # the most memory that a node has had
    stops: Stops = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)  # early ends


def fuzz(folder: Path, count: int, rng: np.random.Generator) -> Outcome:
    """Send `count` random messages and calls to all nodes together, and stop the nodes."""
    effects = Fuzz()
    with (
        noted(effects.failures),
        Peer("torturer", timeout=60.0) as peer,
        start_fuzzed(folder, peer) as nodes,
    ):
        effects.deaths = nodes.deaths
        with noted(effects.failures):
            Fuzzer(nodes, peer, effects, rng).send_all(count)
        nodes.revive()
        effects.stops = nodes.stop()
    return _part(effects, count)


def _part(effects: Fuzz, count: int) -> Outcome:
    stop = slowest_stop(effects.stops)
    figures = {
        "fuzzed": effects.sent,
        "deaths": len(effects.deaths),
        "hangs": len(effects.slow) + len(effects.unanswered),
        "answer_s_worst": round(effects.slowest, 2),
        "memory_bound_mb": round(effects.megabytes),
        "stop_s_worst": round(stop, 2),
    }
    table = row_table(
        "Messages and calls made from the interface definitions",
        "Each node is pinged all the while; a ping that is not answered within "
        f"{bars().answer:g} s is a hang, and so is a request to a service or an action that is not "
        f"answered within {LIMIT:g} s.",
        [
            (Column("sent"), effects.sent),
            (Column("deaths"), len(effects.deaths)),
            (Column("slow pings"), len(effects.slow)),
            (Column("requests without an answer"), len(effects.unanswered)),
            (Column("slowest answer", "s", ".2f"), effects.slowest),
            (Column("most memory", "MB", ".0f"), effects.megabytes),
            (Column("slowest stop", "s", ".2f"), stop),
        ],
        [*effects.deaths, *effects.failures],
    )
    missed = [*effects.deaths, *effects.failures, *missed_stops(effects.stops)]
    missed += [f"{name} answered a ping after {took:.1f} s" for name, took in effects.slow]
    missed += [f"{what} was not answered within {LIMIT:g} s" for what in effects.unanswered]
    if effects.megabytes > MOST_MEGABYTES:
        missed.append(f"{effects.megabytes:.0f} MB; expected at most {MOST_MEGABYTES:.0f}")
    if effects.sent < count:
        missed.append(f"{effects.sent} messages; expected {count}")
    return Outcome([table], figures, complaints=missed)


class Fuzzer:
    """Sends random messages to all nodes, pings them, and watches for their answers."""

    def __init__(self, nodes: Nodes, peer: Peer, effects: Fuzz, rng: np.random.Generator) -> None:
        self._nodes = nodes
        self._peer = peer
        self._effects = effects
        self._rng = rng
        self._answers = Answers()
        self._valid = valid_messages()
        effects.unanswered = self._answers.hangs

    def send_all(self, count: int) -> None:
        """Send messages and calls, and wait for the last answers."""
        try:
            self._peer.spin_until(lambda: not unreached(self._peer), "all interfaces", PATIENCE)
        except PeerTimeoutError:
            problems = "; ".join(unreached(self._peer))
            raise EarlyEndError(f"fuzz does not reach all: {problems}") from None
        effects, rng = self._effects, self._rng
        topics, calls = self._publishers(), self._callers()
        while effects.sent < count:
            senders = calls if rng.random() < CALLS else topics
            senders[int(rng.integers(len(senders)))]()
            effects.sent += 1
            if effects.sent % PING_EVERY == 0:
                self._ping_all()
            if effects.sent % 2000 == 0:
                deaths = len(effects.deaths)
                report_progress(f"{effects.sent} of {count} messages, {deaths} deaths")
        while not self._answers.look():
            self._ping_all()

    def _ping_all(self) -> None:
        effects = self._effects
        for name, process in self._nodes.processes.items():
            took = self._nodes.ping(name)
            if not process.is_running:  # that is its death, and no hang
                continue
            effects.slowest = max(effects.slowest, took)
            if took > bars().answer:
                effects.slow.append((name, took))
        effects.megabytes = max(effects.megabytes, self._nodes.peak_megabytes())
        self._peer.spin_for(DRAIN)
        for name in self._nodes.revive():
            self._answers.leave(name)
        self._answers.look()
        check_deaths(effects.deaths)

    def _publishers(self) -> list[Callable[[], None]]:
        """Return a sender for each topic."""
        kinds = {
            full_name(topic, name): kind
            for name, node in FUZZED.items()
            for topic, kind in node.topics.items()
        }
        # Subscribers that ask for less than this quality of service receive it as well.
        return [
            partial(self._publish, self._peer.node.create_publisher(kind, topic, LATCHED), kind)
            for topic, kind in kinds.items()
        ]

    def _callers(self) -> list[Callable[[], None]]:
        """Return a sender for each service and action of each node."""
        senders: list[Callable[[], None]] = []
        for name, node in FUZZED.items():
            for service, kind in node.all_services().items():
                client = self._peer.node.create_client(
                    kind, full_name(service, name), qos_profile=ANSWERS
                )
                call = partial(self._call, name, service, client)
                if service in SETTERS:
                    senders.append(
                        partial(self._set_parameters, call, kind, self._parameters(name))
                    )
                elif service == CHANGE_STATE:
                    senders.append(partial(self._change_states, call, name))
                else:
                    senders.append(partial(self._call_with_message, call, kind))
            for action, kind in node.actions.items():
                actions = ActionClient(
                    self._peer.node,
                    kind,
                    full_name(action, name),
                    goal_service_qos_profile=ANSWERS,
                    result_service_qos_profile=ANSWERS,
                    cancel_service_qos_profile=ANSWERS,
                )
                senders.append(partial(self._send_goal, name, action, actions, kind))
        return senders

    def _message(self, kind: type) -> Any:
        """Return a random message, or a valid one in which a few fields are random."""
        valid = self._valid.get(kind)
        if valid is not None and self._rng.random() < BENT:
            return bent(valid, self._rng)
        return random_message(kind, self._rng)

    def _publish(self, publisher: Any, kind: type) -> None:
        publisher.publish(self._message(kind))

    def _call(self, node: str, service: str, client: Any, request: Any) -> None:
        future = client.call_async(request)
        forget = partial(client.remove_pending_request, future)
        if service != CHANGE_STATE and self._answers.awaits(node, CHANGE_STATE):
            # A node that is not active offers nothing.
            forget()
        else:
            self._answers.watch(node, service, future, forget)

    def _call_with_message(self, call: Callable[[Any], None], kind: Any) -> None:
        call(self._message(kind.Request))

    def _parameters(self, node: str) -> list[str]:
        """Return the names of the parameters of a node that may be set."""
        request = ListParameters.Request()
        listed = self._peer.call(ListParameters, f"/{node}/list_parameters", request)
        return [name for name in listed.result.names if name not in ("use_sim_time", *OWN_LIMITS)]

    def _set_parameters(self, call: Callable[[Any], None], kind: Any, names: list[str]) -> None:
        """Set parameters, most of them a node's own, to random values."""
        rng = self._rng
        request = random_message(kind.Request, rng)
        for parameter in request.parameters:
            if rng.random() < OWN_NAMES:
                parameter.name = str(rng.choice(names))
            parameter.value.type = int(rng.integers(11))
        call(request)

    def _change_states(self, call: Callable[[Any], None], node: str) -> None:
        """Lead a node through its states, or ask for a random transition.

        Requests that the node had before may end without an answer.
        """
        rng = self._rng
        if rng.random() < PAUSED:
            requests = _transitions(PAUSES[int(rng.integers(len(PAUSES)))])
        else:
            request = random_message(ChangeState.Request, rng)
            if request.transition.id in SHUTDOWNS:
                request.transition.id = 0
            requests = [request, *_transitions(BACK)]
        self._answers.leave(node, but=CHANGE_STATE)
        for request in requests:
            call(request)

    def _send_goal(self, node: str, action: str, client: ActionClient, kind: Any) -> None:
        goal = self._message(kind.Goal)
        is_cancelled = self._rng.random() < CANCELLED

        def watch(step: str, future: Any) -> None:
            if not self._answers.awaits(node, CHANGE_STATE):
                self._answers.watch(node, f"{action} {step}", future, lambda: None)

        def go_on(answer: Any) -> None:
            handle = answer.result()
            if handle.accepted:
                watch("result", handle.get_result_async())
                if is_cancelled:
                    watch("cancel", handle.cancel_goal_async())

        future = client.send_goal_async(goal)
        future.add_done_callback(go_on)
        watch("goal", future)


def _transitions(labels: tuple[str, ...]) -> list[Any]:
    return [ChangeState.Request(transition=Transition(label=label)) for label in labels]
