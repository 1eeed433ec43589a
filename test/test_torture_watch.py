"""How `make torture` watches nodes: all that is a node's counts, is reached, and has to answer."""

from __future__ import annotations

import importlib
import sys
import time
from pathlib import Path

import pytest
from benchmarks.torture.answers import Answers
from benchmarks.torture.interfaces import FUZZED
from benchmarks.torture.nodes import megabytes, peak_megabytes

from intuitive_physics.processes import ChildProcess

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs" / "_extensions"))
node_pages, ros_endpoints = (
    importlib.import_module(name) for name in ("node_pages", "ros_endpoints")
)

TAKEN = 100_000_000
"""Bytes that a grandchild of this test takes."""

GRANDCHILD = f"held = b'x' * {TAKEN}; import time; print('holds', flush=True); time.sleep(60)"

ALONE = "import time; print('runs', flush=True); time.sleep(60)"

CHILD = f"""
import subprocess, sys
subprocess.run([sys.executable, "-c", {GRANDCHILD!r}])
"""


@pytest.mark.parametrize("measured", [megabytes, peak_megabytes])
def test_memory_of_a_node_includes_that_of_its_children(measured):
    with ChildProcess(
        [sys.executable, "-c", "print('runs', flush=True); import time; time.sleep(60)"]
    ) as alone:
        alone.wait_for("runs")
        without = measured(alone.pid)
    with ChildProcess([sys.executable, "-c", CHILD]) as parent:
        parent.wait_for("holds")
        assert measured(parent.pid) > without + TAKEN / 1e6


def type_name(kind: type) -> str:
    package, role = kind.__module__.split(".")[:2]
    return f"{package}/{role}/{kind.__name__}"


def test_all_that_the_reference_says_of_the_nodes_is_fuzzed():
    """The reference is made from the nodes' code; `measure_fuzz` asks the running nodes too."""
    fuzzed: set[tuple[str, str, str]] = set()
    for node in FUZZED.values():
        name = node.module.rpartition(".")[2]
        for kinds in (node.topics, node.all_services(), node.actions):
            fuzzed |= {(name, one, type_name(kind)) for one, kind in kinds.items()}
    nodes = node_pages.node_classes(ROOT)
    assert {name for name, _, _ in fuzzed} == set(nodes)
    for module, node_class in nodes.items():
        plays = module == node_pages.BAG_TOPICS
        for one in ros_endpoints.endpoints(node_class, plays_a_bag=plays):
            known = one.name.replace("{name}", "object")
            # The packages of tf need not be installed.
            if one.role != "publishes" and known != "/tf":
                assert (module, known, one.type) in fuzzed


@pytest.mark.needs("tf2_msgs")
def test_transforms_are_fuzzed():
    assert any("/tf" in node.topics for node in FUZZED.values())


class Future:
    """An answer that comes when it is told to."""

    def __init__(self) -> None:
        self.has_come = False

    def done(self) -> bool:
        return self.has_come


def watched(answers: Answers, *, node: str = "node", what: str = "~/ask") -> Future:
    future = Future()
    answers.watch(node, what, future, lambda: None)
    return future


def test_request_that_is_never_answered_is_a_hang():
    answers = Answers(limit=0.05)
    watched(answers).has_come = True
    assert answers.look()
    watched(answers)
    watched(answers).has_come = True
    assert not answers.look()
    assert not answers.hangs
    time.sleep(0.1)
    assert answers.look()
    assert answers.hangs == ["node ~/ask"]


def test_service_that_never_answers_at_all_hangs():
    answers = Answers(limit=0.05)
    watched(answers)
    time.sleep(0.1)
    assert answers.look()
    assert answers.hangs == ["node ~/ask"]


def test_first_answers_to_a_client_may_be_lost():
    answers = Answers(limit=0.05)
    watched(answers)
    watched(answers).has_come = True
    time.sleep(0.1)
    assert answers.look()
    assert not answers.hangs


def test_node_that_has_ended_owes_no_answer():
    answers = Answers(limit=0.05)
    watched(answers)
    watched(answers, what="~/change_state")
    watched(answers, node="other")
    answers.leave("node", but="~/change_state")
    time.sleep(0.1)
    assert answers.look()
    assert answers.hangs == ["node ~/change_state", "other ~/ask"]
