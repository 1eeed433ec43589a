"""The state of a node on /diagnostics, once a second."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from intuitive_physics_ros.unexpected_errors import MOST_OF_A_KIND, unexpected_errors

PERIOD = 1.0
"""Seconds between two messages, of real time: diagnostics go on when simulated time stands."""


class Level(Enum):
    """State of a node or of a part of it."""

    OK = DiagnosticStatus.OK
    WARN = DiagnosticStatus.WARN
    ERROR = DiagnosticStatus.ERROR


@dataclass(frozen=True)
class Status:
    """Answer of one check.

    Parameters
    ----------
    level : how it does
    message : one line
    values : details by name, shown as text
    """

    level: Level
    message: str
    values: Mapping[str, Any] = field(default_factory=dict)


Check = Callable[[], Status]


class Diagnostics:
    """Publishes the answers of a node's checks on /diagnostics.

    Two checks come with it: that no other node has the same full name, and that nothing unexpected
    was raised.

    Parameters
    ----------
    node : whose diagnostics these are
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._checks: dict[str, Check] = {
            "name": NameCheck(node),
            "unexpected errors": partial(check_unexpected_errors, node),
        }
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD, self._publish, clock=self._steady_clock)

    def add(self, name: str, check: Check) -> None:
        """Ask `check` once a second from now on, published as `namespace/node: name`."""
        self._checks[name] = check

    @property
    def names(self) -> frozenset[str]:
        """Names of the checks."""
        return frozenset(self._checks)

    def keep(self, names: Collection[str]) -> None:
        """Ask no other checks from now on than those of these names."""
        self._checks = {name: self._checks[name] for name in self._checks if name in names}

    def _publish(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [self._status_message(name, self._answer(name)) for name in self._checks]
        self._publisher.publish(message)

    def _answer(self, name: str) -> Status:
        try:
            return self._checks[name]()
        except Exception as error:
            # One check that fails must not take the others along.
            return Status(
                Level.ERROR, unexpected_errors(self._node).report(error, f"the check {name!r}")
            )

    def _status_message(self, name: str, status: Status) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=status.level.value,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: {name}",
            message=status.message,
            hardware_id=self._node.get_fully_qualified_name(),
            values=[KeyValue(key=key, value=str(value)) for key, value in status.values.items()],
        )


class NameCheck:
    """Whether this node is the only one of its full name; warns in the log when it is not."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._alone = True

    def __call__(self) -> Status:
        full_name = self._node.get_fully_qualified_name()
        count = sum(
            f"{namespace.rstrip('/')}/{name}" == full_name
            for name, namespace in self._node.get_node_names_and_namespaces()
        )
        alone = count <= 1
        sentence = (
            f"{full_name} is the only node of this name"
            if alone
            else f"{count} nodes have the name {full_name}: they answer each other's callers and "
            "publish on the same topics; stop one or start it with -r __node:=another_name "
            "(one that died without a farewell is still counted for 20 s)"
        )
        if alone != self._alone:
            log = self._node.get_logger()
            log.info(sentence) if alone else log.warning(sentence)
        self._alone = alone
        return Status(Level.OK if alone else Level.WARN, sentence)


def check_unexpected_errors(node: Node) -> Status:
    """Say how many errors nobody expected there were; several of a kind are an error state."""
    counts = unexpected_errors(node).counts
    if not counts:
        return Status(Level.OK, "none")
    kind, most = max(counts.items(), key=lambda item: item[1])
    if most < MOST_OF_A_KIND:
        return Status(
            Level.WARN, f"{sum(counts.values())}, the newest kind: {[*counts][-1]}", counts
        )
    return Status(Level.ERROR, f"{most} of one kind: {kind}; restart the node", counts)
