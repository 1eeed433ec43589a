"""The policies of SROS2 allow what the nodes do, and nothing else."""

from __future__ import annotations

import os
import stat
import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from tools import security_policies

from intuitive_physics_bringup.connections import CAMERAS, NODES, TRANSPORTS, module
from intuitive_physics_ros.scripting import NodeProcess, Peer, PeerTimeoutError

PACKAGE = Path(__file__).parent.parent
POLICY = PACKAGE / "security" / "policy.xml"
MAKE_KEYSTORE = PACKAGE / "security" / "make_keystore"

ONLY_WHEN_ASKED = {
    "perception_node": {
        *("imu", "/tf", "color/image", "/tf_static", "/intuitive_physics/detections"),
        *TRANSPORTS.values(),
    },
}
"""What a node uses with certain parameters or packages only, by the end of its name."""

NOT_BY_DEFAULT = {"/clock"} | {
    f"/{topic}"
    for camera in CAMERAS.values()
    for color in (False, True)
    for topic in camera.topics(color=color).values()
}
"""What nodes hear of cameras that a launch file connects, or with simulated time."""


def allowed(node: str, right: str) -> set[str]:
    """Full names that the shipped policy allows a node in the root namespace."""
    root = ElementTree.parse(POLICY).getroot()
    names = root.findall(f".//enclave[@path='/intuitive_physics/{node}']//*[@{right}='ALLOW']/*")
    return {full_name(element.text, node) for element in names}


def full_name(name: str, node: str) -> str:
    if name.startswith("~"):
        return f"/{node}{name[1:]}"
    return name if name.startswith("/") else f"/{name}"


def action_servers(services: set[str]) -> set[str]:
    end = "/_action/send_goal"
    return {name.removesuffix(end) for name in services if name.endswith(end)}


def outside_actions(names: set[str]) -> set[str]:
    return {name for name in names if "/_action/" not in name}


def test_policy_file_agrees_with_the_code():
    expected = security_policies.policies()
    assert POLICY.read_text(encoding="utf-8") == expected, (
        "the nodes have changed: bring the policies up with "
        "`python -m tools.security_policies --write`, and read what changed"
    )


def test_policies_are_of_the_form_that_sros2_reads():
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    elements = {several: (one, set()) for several, one, _ in security_policies.ELEMENTS}
    for several, _, right in security_policies.ELEMENTS:
        elements[several][1].add(right)
    for profile in root.iterfind("enclaves/enclave/profiles/profile"):
        assert profile.keys() == ["ns", "node"]
        for rules in profile:
            one, rights = elements[rules.tag]
            assert set(rules.keys()) <= rights
            assert set(rules.attrib.values()) == {"ALLOW"}
            names = [name.text for name in rules]
            assert {name.tag for name in rules} == {one}
            assert len(set(names)) == len(names)
            # Nothing is allowed by a pattern.
            assert not [name for name in names if set(name) & set("*?[]")]


def test_nobody_but_an_operator_asks_and_no_node_can_set_parameters_of_another():
    root = ElementTree.parse(POLICY).getroot()
    asking = root.findall(".//enclave//*[@request]/../../..") + root.findall(
        ".//enclave//*[@call]/../../.."
    )
    assert {enclave.get("path") for enclave in asking} == {"/intuitive_physics/operator"}


def used(peer: Peer, node: str) -> dict[str, set[str]]:
    """Full names that a node uses, by what it does with them, as another one sees it."""
    if node not in peer.node.get_node_names():
        return {right: set() for right in ("publish", "subscribe", "reply", "request")}
    see = peer.node
    found = {
        "publish": see.get_publisher_names_and_types_by_node(node, "/"),
        "subscribe": see.get_subscriber_names_and_types_by_node(node, "/"),
        "reply": see.get_service_names_and_types_by_node(node, "/"),
        "request": see.get_client_names_and_types_by_node(node, "/"),
    }
    return {right: {name for name, _ in names} for right, names in found.items()}


def unused(peer: Peer, node: str) -> set[str]:
    """Names that a node may use and does not."""
    optional = tuple(ONLY_WHEN_ASKED.get(node, ()))
    return {
        f"{right} {name}"
        for right, names in used(peer, node).items()
        for name in allowed(node, right) - names - NOT_BY_DEFAULT
        if not name.endswith(optional)
    }


@pytest.fixture(scope="module")
def graph(tmp_path_factory) -> Iterator[Peer]:
    """The nodes as processes, and a peer that sees them."""
    folder = tmp_path_factory.mktemp("security")
    arguments = {
        "learner_node": ["-p", f"database:={folder / 'learner.sqlite3'}"],
    }
    processes = []
    try:
        for node in NODES:
            processes.append(NodeProcess(module(node), arguments.get(node, [])))
        with Peer("inspector") as peer:
            yield peer
    finally:
        for process in processes:
            process.stop()


@pytest.mark.parametrize("node", NODES)
def test_a_running_node_uses_what_it_is_allowed_and_nothing_else(graph, node):
    # A node begins to hear cameras when its kernels are loaded.
    with suppress(PeerTimeoutError):
        graph.spin_until(lambda: not unused(graph, node), "the whole node", 90.0)
    assert not unused(graph, node)
    names = used(graph, node)
    assert action_servers(names["reply"]) == allowed(node, "execute")
    for right, found in names.items():
        assert outside_actions(found) <= allowed(node, right), f"{node} may not {right} these"


def test_a_node_never_runs_without_the_security_that_is_asked_for(tmp_path):
    asked = {
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(tmp_path),
    }
    # There are no keys.
    process = NodeProcess(module("predictor_node"), environment={**os.environ, **asked})
    assert process.wait(60.0) == 1
    assert "SECURITY ERROR" in process.output
    assert "Traceback" not in process.output


def run_make_keystore(tmp_path: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Run the script with a ros2 that keeps what it is given."""
    program = tmp_path / "bin" / "ros2"
    program.parent.mkdir(exist_ok=True)
    program.write_text(
        '#!/bin/bash\nif [ "$1" = pkg ]; then echo "$PACKAGE"; exit; fi\n'
        'mkdir -p "$4" && cp "$6" "$4/policy.xml" && echo "$@" > "$4/arguments"\n'
    )
    program.chmod(0o755)
    path = f"{program.parent}:{os.environ['PATH']}"
    return subprocess.run(
        [str(MAKE_KEYSTORE), *arguments],
        env={**os.environ, "PATH": path, "PACKAGE": str(PACKAGE)},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize(
    ("namespace", "prefix"), [("", ""), ("robot_1", "/robot_1"), ("/lab/robot", "/lab/robot")]
)
def test_the_script_makes_enclaves_for_a_namespace(tmp_path, namespace, prefix):
    folder = tmp_path / "key store"
    done = run_make_keystore(tmp_path, str(folder), *([namespace] if namespace else []))
    assert done.returncode == 0, done.stderr
    assert (folder / "arguments").read_text().startswith("security generate_artifacts -k ")
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    made = ElementTree.parse(folder / "policy.xml").getroot()
    shipped = ElementTree.parse(POLICY).getroot()
    for enclave, original in zip(made.iter("enclave"), shipped.iter("enclave"), strict=True):
        assert enclave.get("path") == f"{prefix}{original.get('path')}"
    assert {profile.get("ns") for profile in made.iter("profile")} == {prefix or "/"}
    assert f"ROS_SECURITY_KEYSTORE='{folder}'" in done.stdout
    assert f"{prefix}/intuitive_physics/operator" in done.stdout


@pytest.mark.parametrize(
    "arguments", [(), ("--help",), ("a", "b", "c"), ("a", "b c"), ("a", "1/b")]
)
def test_the_script_refuses_what_it_cannot_use(tmp_path, arguments):
    done = run_make_keystore(tmp_path, *arguments)
    assert done.returncode == 2
    assert "expected" in done.stderr or "usage" in done.stderr
    assert not list(tmp_path.glob("*/policy.xml"))
