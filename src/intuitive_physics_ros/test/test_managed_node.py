"""A managed node has the states of ROS 2, answers each transition, and leaves nothing behind."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from intuitive_physics.processes import ChildProcess
from intuitive_physics_ros.lifecycle import run_node as run_node_module
from intuitive_physics_ros.rclpy_internals import AnsweringLifecycleNode
from intuitive_physics_ros.scripting import LifecycleManager

from .small_managed_node import SmallManagedNode

SMALL_NODE = Path(__file__).parent / "small_managed_node.py"

TRANSITIONS = {
    ("unconfigured", "configure"): "inactive",
    ("unconfigured", "shutdown"): "finalized",
    ("inactive", "activate"): "active",
    ("inactive", "cleanup"): "unconfigured",
    ("inactive", "shutdown"): "finalized",
    ("active", "deactivate"): "inactive",
    ("active", "shutdown"): "finalized",
}
"""State after a transition from a state; https://design.ros2.org/articles/node_lifecycle.html."""


class SmallManager(LifecycleManager):
    """Leads the small node."""

    def offered(self) -> tuple[set[str], set[str], set[str]]:
        """Names that the small node publishes, subscribes to and serves."""
        # A service may be found before the node that offers it.
        self.spin_until(lambda: "small" in self.node.get_node_names(), "the small node")
        names = ("publisher", "subscriber", "service")
        kinds = [
            getattr(self.node, f"get_{name}_names_and_types_by_node")("small", "/")
            for name in names
        ]
        published, heard, services = [{name for name, _ in found} for found in kinds]
        return published, heard, services


@pytest.fixture
def start():
    """Start small nodes; none outlives its test."""
    started = []

    def start_one(*arguments, environment=None):
        run = [sys.executable, "-u", str(SMALL_NODE), "--ros-args", *arguments]
        started.append(ChildProcess(run, environment=environment))
        return started[-1]

    yield start_one
    for process in started:
        process.stop(signal.SIGKILL)


def end(process) -> str:
    assert process.stop(signal.SIGTERM) == 0, process.output
    return process.output


@pytest.fixture
def manager():
    with SmallManager("manager", timeout=30.0) as peer:
        yield peer


def test_autostart_activates_the_node(start, manager):
    process = start()
    manager.spin_until(lambda: manager.state("small") == "active", "the active state")
    output = end(process)
    assert "Traceback" not in output
    process = start("-p", "autostart:=false")
    manager.spin_until(lambda: manager.state("small") == "unconfigured", "the unconfigured state")
    assert not manager.offered()[0] & {"/total", "/number", "/small/sleep"}
    assert "waits to be configured" in end(process)


def test_transitions_lead_to_the_states_of_the_standard(start, manager):
    process = start("-p", "autostart:=false")
    # Whether a label is allowed in a state, and where it leads, is a table: walked at random.
    random, state = np.random.default_rng(0), manager.state("small")
    labels = ["configure", "activate", "deactivate", "cleanup", "nonsense"]
    walked = set()
    for label in [*random.choice(labels, 60), "shutdown", *labels]:
        expected = TRANSITIONS.get((state, label))
        assert manager.change("small", label) is (expected is not None), (state, label)
        walked.add((state, label))
        state = expected or state
        assert manager.state("small") == state
    assert len(walked) > 12
    for number in (0, 255, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request(transition=Transition(id=number))
        assert not manager.call(ChangeState, "/small/change_state", request).success
    output = end(process)
    assert "refused; expected one of ~/get_available_transitions" in output
    assert "Traceback" not in output


def test_only_an_active_node_subscribes_and_publishes(start, manager):
    process = start()
    manager.spin_until(lambda: manager.state("small") == "active", "the active state")
    totals = manager.listen(Float64, "total")
    events = manager.listen(TransitionEvent, "small/transition_event")
    diagnostics = manager.listen(DiagnosticArray, "/diagnostics")
    numbers = manager.publisher(Float64, "number")
    manager.spin_until(lambda: totals, "a total")
    numbers.publish(Float64(data=2.0))
    manager.spin_until(lambda: totals[-1].data == 2.0, "the number")
    active = manager.offered()

    assert manager.change("small", "deactivate")
    manager.spin_until(lambda: numbers.get_subscription_count() == 0, "the end of hearing")
    numbers.publish(Float64(data=5.0))
    totals.clear()
    diagnostics.clear()
    manager.spin_until(lambda: len(diagnostics) > 1, "diagnostics of what is inactive")
    assert not totals
    told = {status.name: status.message for status in diagnostics[-1].status}
    assert told["small: state"] == "inactive"
    assert "small: total" not in told
    published, heard, services = manager.offered()
    assert active[0] - published == {"/total"}
    assert active[1] - heard == {"/number"}
    assert active[2] - services == {"/small/sleep"}

    assert manager.change("small", "activate")
    manager.spin_until(lambda: totals, "a total")
    assert totals[-1].data == 2.0
    assert manager.offered() == active
    assert [event.goal_state.label for event in events][-2:] == ["activating", "active"]
    assert manager.change("small", "deactivate")
    assert manager.change("small", "cleanup")
    assert manager.change("small", "configure")
    assert manager.change("small", "activate")
    totals.clear()
    manager.spin_until(lambda: totals, "a total")
    assert totals[-1].data == 0.0
    assert "Traceback" not in end(process)


def test_a_request_under_way_is_answered_when_the_node_is_deactivated(start, manager):
    process = start()
    manager.spin_until(lambda: manager.state("small") == "active", "the active state")
    under_way = manager.send(Trigger, "/small/sleep", Trigger.Request())
    manager.spin_for(0.5)
    assert not under_way.done()
    assert manager.change("small", "deactivate")
    manager.spin_until(under_way.done, "the answer")
    assert "the request is cancelled" in under_way.result().message
    # At once again: the services that stayed to answer are new ones then.
    assert manager.change("small", "activate")
    manager.spin_for(0.5)
    assert "/small/sleep" in manager.offered()[2]
    assert "Traceback" not in end(process)


def test_only_the_first_activation_looks_through_all_memory():
    whole = []

    def note(phase, info):
        if phase == "start" and info["generation"] == 2:
            whole.append(info)

    rclpy.init()
    node = SmallManagedNode()
    gc.callbacks.append(note)
    try:
        node.trigger_configure()
        node.trigger_activate()
        while not node.kernels.is_loaded:
            time.sleep(0.01)
        assert 1 <= len(whole) <= 2
        whole.clear()
        node.trigger_deactivate()
        node.trigger_activate()
        assert not whole
    finally:
        gc.callbacks.remove(note)
        gc.unfreeze()
        node.destroy_node()
        rclpy.shutdown()


def kernels_status(heard):
    return [s for message in heard for s in message.status if s.name == "small: kernels"]


def test_node_answers_while_its_kernels_are_compiled(start, manager, tmp_path):
    done = tmp_path / "done"
    process = start("-p", "autostart:=false", environment={**os.environ, "COMPILED": str(done)})
    heard = manager.listen(DiagnosticArray, "/diagnostics")
    totals = manager.listen(Float64, "total")
    # Each is answered though nothing is compiled before this test says so.
    assert manager.change("small", "configure")
    assert manager.change("small", "activate")
    assert manager.change("small", "deactivate")
    assert manager.change("small", "activate")
    assert manager.state("small") == "active"
    heard.clear()
    manager.spin_until(lambda: len(kernels_status(heard)) > 1, "diagnostics")
    last = kernels_status(heard)[-1]
    assert last.message.startswith("compiling kernels, about a minute, once; for ")
    assert last.level == DiagnosticStatus.WARN
    assert not totals
    assert process.output.count("compiling kernels, about a minute, once") == 1
    done.touch()
    manager.spin_until(lambda: totals, "a total")
    heard.clear()
    manager.spin_until(lambda: kernels_status(heard), "diagnostics")
    assert kernels_status(heard)[-1].level == DiagnosticStatus.OK
    output = end(process)
    assert "kernels are compiled, after" in output
    assert "Traceback" not in output


def test_node_ends_while_its_kernels_are_compiled(start, manager, tmp_path):
    process = start(environment={**os.environ, "COMPILED": str(tmp_path / "never")})
    manager.spin_until(lambda: "compiling kernels" in process.output, "what is said")
    assert "Traceback" not in end(process)


def test_kernels_that_are_there_are_loaded_without_a_word(start, manager):
    process = start()
    totals = manager.listen(Float64, "total")
    manager.spin_until(lambda: totals, "a total")
    assert "kernels" not in end(process)


@pytest.mark.parametrize(
    ("fails", "why", "state"),
    [
        ("ours", "configuring failed: the file is missing; expected one", "unconfigured"),
        ("bug", "configuring failed: ZeroDivisionError: 1 / 0", "unconfigured"),
    ],
)
def test_failed_configuration_leaves_the_node_unconfigured(start, manager, fails, why, state):
    process = start("-p", "autostart:=false", "-p", f"fails:={fails}")
    assert not manager.change("small", "configure")
    assert manager.state("small") == state
    output = end(process)
    assert why in output
    assert ("please report this" in output) is (fails == "bug")


@pytest.mark.parametrize("fails", ["ours", "elsewhere"])
def test_failed_start_leaves_the_middleware(monkeypatch, capsys, fails):
    destroyed = []
    destroy = AnsweringLifecycleNode.destroy_node

    def record(node):
        destroyed.append(node.get_name())
        destroy(node)

    monkeypatch.setattr(AnsweringLifecycleNode, "destroy_node", record)
    # It runs in this process, whose signals and threads stay as they are.
    monkeypatch.setattr(run_node_module, "StopSignal", lambda: None)
    assert run_node_module.run_node(SmallManagedNode, ["--ros-args", "-p", f"fails:={fails}"]) == 1
    assert destroyed == ["small"]
    assert "error: " in capsys.readouterr().err


def test_failed_start_ends_with_one_line(start):
    process = start("-p", "fails:=ours")
    assert process.wait(30.0) == 1
    output = process.output
    assert output.strip().splitlines()[-1].endswith("error: the file is missing; expected one")
    assert "Traceback" not in output
