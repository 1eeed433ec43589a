"""The launch file and its configuration agree with the nodes."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest
import yaml

from intuitive_physics_bringup.connections import CAMERAS, NODES, module
from intuitive_physics_learner.nodes import learner_node
from intuitive_physics_perception.nodes import frame_input, perception_node
from intuitive_physics_predictor.nodes import predictor_node
from intuitive_physics_ros.scripting import NodeProcess, Peer
from intuitive_physics_ros.topics import ENVIRONMENT, OBJECT_STATES, OBSERVATIONS, STATIC_PARAMETERS

PACKAGE = Path(__file__).parent.parent
PARAMETERS = {
    "perception_node": perception_node.PARAMETERS,
    "learner_node": learner_node.node_parameters(),
    "predictor_node": predictor_node.PARAMETERS,
}


def test_configuration_names_parameters_the_nodes_have():
    configured = yaml.safe_load((PACKAGE / "config" / "nodes.yaml").read_text(encoding="utf-8"))
    assert set(configured) <= {f"/**/{node}" for node in NODES}
    for key, entries in configured.items():
        node = key.rpartition("/")[2]
        known = {parameter.name: parameter for parameter in PARAMETERS[node]}
        for name, value in entries["ros__parameters"].items():
            assert known[name].accepts(value), (node, name)
            assert type(value) is type(known[name].default), (node, name)


def test_arguments_that_warnings_name_are_those_of_the_launch_file():
    """Read from its text: launch is not everywhere where the nodes are."""
    text = (PACKAGE / "launch" / "intuitive_physics.launch.py").read_text(encoding="utf-8")
    assigned = {
        target.id: statement.value
        for statement in ast.parse(text).body
        if isinstance(statement, ast.Assign)
        for target in statement.targets
        if isinstance(target, ast.Name)
    }
    declared = {ast.literal_eval(key) for key in assigned["ARGUMENTS"].keys}
    named = {*frame_input.LAUNCH_ARGUMENTS.values(), "camera", "camera_info", "color", "imu"}
    assert named | {"namespace", "discovery", "bag", "use_sim_time"} <= declared


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


def test_the_nodes_find_one_another_under_any_namespace(tmp_path):
    """Started plain, each of them hears what another publishes, with the same type."""
    namespace = "/somewhere/else"
    processes = []
    try:
        for node in NODES:
            arguments = ["-r", f"__ns:={namespace}"]
            if node == "learner_node":
                arguments += ["-p", f"database:={tmp_path / 'learner.sqlite3'}"]
            processes.append(NodeProcess(module(node), arguments))
        with Peer("inspector") as peer:
            for topic in (ENVIRONMENT, OBJECT_STATES, OBSERVATIONS, STATIC_PARAMETERS):
                name = f"{namespace}/{topic}"
                peer.spin_until(
                    lambda name=name: (
                        peer.node.get_publishers_info_by_topic(name)
                        and peer.node.get_subscriptions_info_by_topic(name)
                    ),
                    f"both ends of {name}",
                    180.0,
                )
                ends = peer.node.get_publishers_info_by_topic(name)
                ends += peer.node.get_subscriptions_info_by_topic(name)
                assert len({end.topic_type for end in ends}) == 1
            # Colour and an IMU are heard only where they are asked for.
            for topic in CAMERAS["generic"].topics().keys() - {"~/imu", "~/color/image"}:
                name = topic.replace("~", f"{namespace}/perception_node")
                peer.spin_until(
                    lambda name=name: peer.node.get_subscriptions_info_by_topic(name),
                    f"perception to hear {name}",
                    180.0,
                )
    finally:
        for process in processes:
            process.stop()
