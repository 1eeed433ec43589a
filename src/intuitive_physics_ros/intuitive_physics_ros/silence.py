"""Reports on a topic on which nothing arrives: who publishes it, and how to choose another."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from difflib import SequenceMatcher
from math import inf

from rclpy.node import Node, NodeNameNonExistentError
from rosgraph_msgs.msg import Clock

from intuitive_physics_ros.diagnostics import Level, Status

AFTER = 5.0
"""s without a message after which a node says so. Our choice: discovery takes one or two."""

WARN_AGAIN = 60.0
"""s after which the same warning is logged again."""

NEAREST = 5
"""Largest number of topics that are named."""

SAME_NAMESPACE = (
    "start what publishes it in the same namespace, as the launch argument namespace:= does, or "
    "remap the topic"
)
"""Remedy for a topic by which the suite's nodes meet."""

CLOCK = "/clock"
"""Topic of simulated time before remapping rules."""


class Silence:
    """Looks for publishers while nothing arrives; warns in the log after 5 s, then every minute.

    It begins when it is made and asks the graph at most when `report` is called, which
    diagnostics do once a second.

    Parameters
    ----------
    node : that subscribes
    topics : type of each topic by its name, as the node subscribes to it; with several, a message
        on any of them is enough
    remedy : what its user can do, as the end of a sentence
    patience : s of silence before a warning is logged where somebody does publish on one of them;
        diagnostics say it after 5 s in any case
    """

    def __init__(
        self, node: Node, topics: Mapping[str, type], remedy: str, patience: float = AFTER
    ) -> None:
        self._node = node
        self._topics = topics
        self._remedy = remedy
        self._patience = patience
        self._since = time.monotonic()
        self._warned_at = -inf
        self._broken = False

    def end(self) -> None:
        """Take note that a message arrived."""
        self._broken = True

    def report(self) -> str:
        """Return a sentence on a silence of 5 s or more, else an empty text; log it when due."""
        now = time.monotonic()
        lasted = now - self._since
        if self._broken or lasted < AFTER:
            return ""
        expected = {
            self._node.resolve_topic_name(name): _type_name(kind)
            for name, kind in self._topics.items()
        }
        published = _published(self._node)
        heads = [_head(name, kind, published.get(name, [])) for name, kind in expected.items()]
        text = (
            f"nothing arrived for {lasted:.0f} s on {' nor on '.join(heads)}; "
            f"{_others(expected, published)}; {self._remedy}"
        )
        is_published = any(kind in published.get(name, []) for name, kind in expected.items())
        # A bag waits for all nodes, of which another may be compiling.
        patience = max(self._patience, WARN_AGAIN) if _stands_still(self._node) else self._patience
        is_due = not is_published or lasted >= patience
        if is_due and now - self._warned_at >= WARN_AGAIN:
            self._warned_at = now
            self._node.get_logger().warning(text)
        return text


class ClockCheck:
    """Whether time goes on, where it comes from a topic; a check for /diagnostics.

    Parameters
    ----------
    node : whose time it is
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._silence: Silence | None = None

    def __call__(self) -> Status:
        """Say where time comes from; warns in the log when simulated time never comes."""
        if not self._node.get_parameter("use_sim_time").value:
            self._silence = None
            return Status(Level.OK, "time is that of the machine")
        name = self._node.resolve_topic_name(CLOCK)
        if not _stands_still(self._node):
            self._silence = None
            return Status(Level.OK, f"time is that of {name}")
        if self._silence is None:
            self._silence = Silence(
                self._node,
                {CLOCK: Clock},
                "use_sim_time is true, so time stands still: start the simulator or the bag, or "
                "set use_sim_time:=false",
            )
        return Status(Level.WARN, self._silence.report() or f"no time arrived yet on {name}")


def nearest(names: Iterable[str], expected: Iterable[str]) -> list[str]:
    """Return the few names that are most like one of those expected, most alike first."""
    wanted = list(expected)

    def likeness(name: str) -> float:
        return max(SequenceMatcher(None, name, other).ratio() for other in wanted)

    return sorted(names, key=lambda name: (-likeness(name), name))[:NEAREST]


def launch_arguments(*names: str) -> str:
    """Return the remedy for a topic that arguments of the launch file choose."""
    *first, last = [f"{name}:=" for name in names]
    given = f"{', '.join(first)} or {last}" if first else last
    plural = "s" if first else ""
    verb = "choose" if first else "chooses"
    return f"the launch argument{plural} {given} {verb} the topic"


def _stands_still(node: Node) -> bool:
    """Whether time comes from a topic and has not come yet."""
    return node.get_parameter("use_sim_time").value and node.get_clock().now().nanoseconds == 0


def _published(node: Node) -> dict[str, list[str]]:
    """Return the type of each other node's publisher by topic.

    Nodes are asked, because a question for a topic would go through this one's remapping rules.
    """
    types: dict[str, list[str]] = {}
    this_node = (node.get_name(), node.get_namespace())
    for name, namespace in node.get_node_names_and_namespaces():
        if (name, namespace) == this_node:
            continue
        # One that has left meanwhile publishes nothing.
        with suppress(NodeNameNonExistentError):
            for topic, kinds in node.get_publisher_names_and_types_by_node(name, namespace):
                types.setdefault(topic, []).extend(kinds)
    return types


def _others(expected: Mapping[str, str], published: Mapping[str, list[str]]) -> str:
    """Return which other topics of the types there are, near names first."""
    wanted = set(expected.values())
    which = "of the same type" if len(wanted) == 1 else "of these types"
    names = [
        name
        for name, kinds in published.items()
        if name not in expected and wanted.intersection(kinds)
    ]
    if not names:
        return (
            f"no other topic {which} is published where this node looks, as the launch "
            "argument discovery:= says"
        )
    return f"published {which}: {', '.join(nearest(names, expected))}"


def _head(name: str, expected: str, publishers: list[str]) -> str:
    """Return a topic with its type and who publishes on it."""
    good = publishers.count(expected)
    wrong = sorted(set(publishers) - {expected})
    said = [f"{good or 'no'} publisher{'' if good in (0, 1) else 's'}"]
    if wrong:
        said.append(f"but {len(publishers) - good} of {' and '.join(wrong)}")
    return f"{name} ({expected}, {', '.join(said)})"


def _type_name(kind: type) -> str:
    return f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
