"""The policies of SROS2 for each node, made from the nodes' code; `--write` brings the file up.

    .venv/bin/python -m tools.security_policies --write

writes src/intuitive_physics_bringup/security/policy.xml. Each node has an enclave of its own that
allows what its code offers and uses, and nothing else. One more, `operator`, is for people: it may
hear all topics of the suite and call all its services and actions.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from intuitive_physics_bringup import connections
from intuitive_physics_ros.lifecycle.managed_node import ManagedNode

ROOT = Path(__file__).resolve().parent.parent
"""The repository."""

POLICY = ROOT / "src" / "intuitive_physics_bringup" / "security" / "policy.xml"
"""The file that is shipped."""

ENCLAVES = "/intuitive_physics"
"""Path of the enclaves."""

HEADING = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    "<!-- Made by tools/security_policies.py from the code of the nodes. -->\n"
)
"""First lines of the file."""

PARAMETER_SERVICES = (
    "~/describe_parameters",
    "~/get_parameter_types",
    "~/get_parameters",
    "~/get_type_description",
    "~/list_parameters",
    "~/set_parameters",
    "~/set_parameters_atomically",
)
"""Services that rclpy makes for every node."""

LIFECYCLE_SERVICES = (
    "~/change_state",
    "~/get_available_states",
    "~/get_available_transitions",
    "~/get_state",
    "~/get_transition_graph",
)
"""Services that rclpy makes for every managed node."""

TRANSITIONS = "~/transition_event"
"""Topic that rclpy publishes for every managed node."""

LOGGING = ("/parameter_events", "/rosout")
"""Topics that rclpy publishes for every node."""

TRANSFORMS = ("/tf", "/tf_static")
"""Topics that tf2_ros subscribes to for a node that looks up a transform."""

LOOKS_UP = ("perception_node", "pose_bridge_node")
"""Nodes that look up transforms."""

CLOCKS = ("/clock", "clock")
"""Topics of simulated time, for every node; a namespace may have a clock of its own."""

RECORDED_ELSEWHERE = ("/tf", "/tf_static")
"""Topics of a bag that no node of the suite hears and others do."""


@dataclass
class Rules:
    """Names of topics, services and actions that one node may use, by what it does with them."""

    node: str
    publish: set[str] = field(default_factory=set)
    subscribe: set[str] = field(default_factory=set)
    reply: set[str] = field(default_factory=set)
    request: set[str] = field(default_factory=set)
    execute: set[str] = field(default_factory=set)
    call: set[str] = field(default_factory=set)


ELEMENTS = (
    ("topics", "topic", "subscribe"),
    ("topics", "topic", "publish"),
    ("services", "service", "reply"),
    ("services", "service", "request"),
    ("actions", "action", "execute"),
    ("actions", "action", "call"),
)
"""Elements of a policy: of a list, of a name, and the right that the list gives."""


def main() -> int:
    """Print the policies, or write them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"write {POLICY.relative_to(ROOT)}")
    if parser.parse_args().write:
        POLICY.parent.mkdir(exist_ok=True)
        POLICY.write_text(policies(), encoding="utf-8")
    else:
        print(policies(), end="")
    return 0


def policies() -> str:
    """Return the policies of all nodes as XML."""
    policy = ElementTree.Element("policy", version="0.2.0")
    enclaves = ElementTree.SubElement(policy, "enclaves")
    every = rules()
    for name, node_rules in {**every, "operator": operator(every.values())}.items():
        _add(enclaves, name, node_rules)
    ElementTree.indent(policy)
    return f"{HEADING}{ElementTree.tostring(policy, encoding='unicode')}\n"


def rules() -> dict[str, Rules]:
    """Return what each node may do, by the name of its executable."""
    pages, reader = _reader()
    by_module = {}
    for module, node in pages.node_classes(ROOT).items():
        plays_a_bag = module == pages.BAG_TOPICS
        node_rules = Rules(
            pages.node_name(node),
            publish=set(LOGGING),
            subscribe=set(CLOCKS),
            reply=set(PARAMETER_SERVICES),
        )
        for endpoint in reader.endpoints(node, plays_a_bag=plays_a_bag):
            _allow(node_rules, endpoint, module)
        if issubclass(node, ManagedNode):
            node_rules.reply.update(LIFECYCLE_SERVICES)
            node_rules.publish.add(TRANSITIONS)
        if module in LOOKS_UP:
            node_rules.subscribe.update(TRANSFORMS)
        by_module[module] = node_rules
    inputs = {
        name
        for node_rules in by_module.values()
        for name in node_rules.subscribe
        if "~" not in name
    }
    by_module[pages.BAG_TOPICS].publish.update(inputs, RECORDED_ELSEWHERE)
    return by_module


def operator(nodes: Collection[Rules]) -> Rules:
    """Return what people and their tools may do, where nodes have certain rules."""

    def all_of(right: str) -> set[str]:
        return {
            name.replace("~", node_rules.node, 1)
            for node_rules in nodes
            for name in getattr(node_rules, right)
        }

    return Rules(
        # Tools have a node of another name each time, whose parameters nobody asks for.
        "*",
        publish=set(LOGGING),
        subscribe=all_of("publish") | set(CLOCKS),
        reply=set(PARAMETER_SERVICES),
        request=all_of("reply"),
        call=all_of("execute"),
    )


def _reader() -> tuple[Any, Any]:
    """Return what reads the nodes' code for the reference."""
    extensions = str(ROOT / "docs" / "_extensions")
    if extensions not in sys.path:
        sys.path.insert(0, extensions)
    return importlib.import_module("node_pages"), importlib.import_module("ros_endpoints")


def _allow(node_rules: Rules, endpoint: Any, module: str) -> None:
    rights = {"publishes": "publish", "subscribes": "subscribe", "service": "reply"}
    if "{" in endpoint.name:
        # Only who starts the node knows such names, and allows them.
        return
    names = {endpoint.name, *_connected(endpoint.name, module)}
    getattr(node_rules, rights.get(endpoint.role, "execute")).update(names)


def _connected(name: str, module: str) -> Iterator[str]:
    """Yield the topics that the launch file connects an input to, for each camera it knows."""
    if module == "perception_node":
        for camera in connections.CAMERAS.values():
            for registered in (False, True):
                topics = connections.with_compressed(camera.topics(color=registered))
                if name in topics:
                    yield topics[name]


def _add(enclaves: ElementTree.Element, enclave: str, node_rules: Rules) -> None:
    element = ElementTree.SubElement(enclaves, "enclave", path=f"{ENCLAVES}/{enclave}")
    profiles = ElementTree.SubElement(element, "profiles")
    profile = ElementTree.SubElement(profiles, "profile", ns="/", node=node_rules.node)
    for several, one, right in ELEMENTS:
        _add_names(profile, several, one, right, getattr(node_rules, right))


def _add_names(
    profile: ElementTree.Element, several: str, one: str, right: str, names: Iterable[str]
) -> None:
    expressions = sorted(names)
    if expressions:
        parent = ElementTree.SubElement(profile, several, {right: "ALLOW"})
        for name in expressions:
            ElementTree.SubElement(parent, one).text = name


if __name__ == "__main__":
    sys.exit(main())
