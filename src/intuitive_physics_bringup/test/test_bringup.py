"""What the launch file and its configuration say of the nodes is true of them."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest
import yaml

from intuitive_physics_bringup.connections import CAMERA_TOPICS, NODES, module, remappings
from intuitive_physics_learner.nodes import learner_node
from intuitive_physics_perception.nodes import perception_node
from intuitive_physics_predictor.nodes import predictor_node
from intuitive_physics_ros.scripting import NodeProcess, Peer

PACKAGE = Path(__file__).parent.parent
PARAMETERS = {
    "perception_node": perception_node.PARAMETERS,
    "learner_node": learner_node.node_parameters(),
    "predictor_node": predictor_node.PARAMETERS,
}


def test_configuration_names_parameters_the_nodes_have():
    configured = yaml.safe_load((PACKAGE / "config" / "nodes.yaml").read_text(encoding="utf-8"))
    assert set(configured) <= set(NODES)
    for node, entries in configured.items():
        known = {parameter.name: parameter for parameter in PARAMETERS[node]}
        for name, value in entries["ros__parameters"].items():
            assert known[name].accepts(value), (node, name)
            assert type(value) is type(known[name].default), (node, name)


@pytest.mark.parametrize("node", NODES)
def test_each_node_can_be_started(node):
    assert callable(importlib.import_module(module(node)).main)


@pytest.mark.parametrize("path", sorted((PACKAGE / "launch").glob("*.py")))
def test_launch_files_are_python_with_a_description(path):
    functions = {
        node.name
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef)
    }
    assert "generate_launch_description" in functions


def test_every_connection_has_two_ends(tmp_path):
    """Each topic a node is told to hear is published by another node with the same type."""
    processes = []
    try:
        for node in NODES:
            arguments = [part for a, b in remappings(node) for part in ("-r", f"{a}:={b}")]
            if node == "learner_node":
                arguments += ["-p", f"database:={tmp_path / 'learner.sqlite3'}"]
            processes.append(NodeProcess(module(node), arguments))
        with Peer("inspector") as peer:
            for node in NODES:
                for _, topic in remappings(node):
                    name = f"/{topic}"
                    peer.spin_until(
                        lambda name=name: (
                            peer.node.get_publishers_info_by_topic(name)
                            and peer.node.get_subscriptions_info_by_topic(name)
                        ),
                        f"both ends of {name}",
                    )
                    ends = peer.node.get_publishers_info_by_topic(name)
                    ends += peer.node.get_subscriptions_info_by_topic(name)
                    assert len({end.topic_type for end in ends}) == 1
            # An IMU is heard only where it is asked for.
            for topic in CAMERA_TOPICS.keys() - {"~/imu"}:
                name = topic.replace("~", "/perception_node")
                peer.spin_until(
                    lambda name=name: peer.node.get_subscriptions_info_by_topic(name),
                    f"perception to hear {name}",
                )
    finally:
        for process in processes:
            process.stop()
