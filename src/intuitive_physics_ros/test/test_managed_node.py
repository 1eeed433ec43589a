"""A managed node has the states of ROS 2, answers each transition, and leaves nothing behind."""

from __future__ import annotations

import gc
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from intuitive_physics.processes import ChildProcess
from intuitive_physics_ros.scripting import Peer

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


class Manager(Peer):
    """Leads the small node."""

    def state(self) -> str:
        return self.call(GetState, "/small/get_state", GetState.Request()).current_state.label

    def change(self, label: str) -> bool:
        """Ask once: a second request would find the next state."""
        self.state()
        request = ChangeState.Request(transition=Transition(label=label))
        future = self.send(ChangeState, "/small/change_state", request)
        self.spin_until(future.done, f"an answer to {label}")
        return future.result().success

    def change_by_number(self, number: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=number))
        return self.call(ChangeState, "/small/change_state", request).success

    def offered(self) -> tuple[set[str], set[str], set[str]]:
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

    def start_one(*arguments):
        run = [sys.executable, "-u", str(SMALL_NODE), "--ros-args", *arguments]
        started.append(ChildProcess(run))
        return started[-1]

    yield start_one
    for process in started:
        process.stop(signal.SIGKILL)


def end(process) -> str:
    assert process.stop(signal.SIGTERM) == 0, process.output
    return process.output


@pytest.fixture
def manager():
    with Manager("manager", timeout=30.0) as peer:
        yield peer


def test_it_starts_itself_unless_a_manager_does(start, manager):
    process = start()
    manager.spin_until(lambda: manager.state() == "active", "the active state")
    output = end(process)
    assert "Traceback" not in output
    process = start("-p", "autostart:=false")
    manager.spin_until(lambda: manager.state() == "unconfigured", "the unconfigured state")
    assert not manager.offered()[0] & {"/total", "/number", "/small/sleep"}
    assert "waits to be configured" in end(process)


def test_each_transition_is_answered_and_leads_where_the_standard_says(start, manager):
    process = start("-p", "autostart:=false")
    # Whether a label is allowed in a state, and where it leads, is a table: walked at random.
    random, state = np.random.default_rng(0), manager.state()
    labels = ["configure", "activate", "deactivate", "cleanup", "nonsense"]
    walked = set()
    for label in [*random.choice(labels, 60), "shutdown", *labels]:
        expected = TRANSITIONS.get((state, label))
        assert manager.change(label) is (expected is not None), (state, label)
        walked.add((state, label))
        state = expected or state
        assert manager.state() == state
    assert len(walked) > 12
    for number in (0, 255, Transition.TRANSITION_ACTIVATE):
        assert not manager.change_by_number(number)
    output = end(process)
    assert "refused; expected one of ~/get_available_transitions" in output
    assert "Traceback" not in output


def test_only_what_is_active_hears_and_speaks_and_what_it_knows_stays(start, manager):
    process = start()
    manager.spin_until(lambda: manager.state() == "active", "the active state")
    totals = manager.listen(Float64, "total")
    events = manager.listen(TransitionEvent, "small/transition_event")
    diagnostics = manager.listen(DiagnosticArray, "/diagnostics")
    numbers = manager.publisher(Float64, "number")
    manager.spin_until(lambda: totals, "a total")
    numbers.publish(Float64(data=2.0))
    manager.spin_until(lambda: totals[-1].data == 2.0, "the number")
    active = manager.offered()

    assert manager.change("deactivate")
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

    assert manager.change("activate")
    manager.spin_until(lambda: totals, "a total")
    assert totals[-1].data == 2.0
    assert manager.offered() == active
    assert [event.goal_state.label for event in events][-2:] == ["activating", "active"]
    assert manager.change("deactivate")
    assert manager.change("cleanup")
    assert manager.change("configure")
    assert manager.change("activate")
    totals.clear()
    manager.spin_until(lambda: totals, "a total")
    assert totals[-1].data == 0.0
    assert "Traceback" not in end(process)


def test_a_request_under_way_is_answered_when_the_node_is_deactivated(start, manager):
    process = start()
    manager.spin_until(lambda: manager.state() == "active", "the active state")
    under_way = manager.send(Trigger, "/small/sleep", Trigger.Request())
    manager.spin_for(0.5)
    assert not under_way.done()
    assert manager.change("deactivate")
    manager.spin_until(under_way.done, "the answer")
    assert "the request is cancelled" in under_way.result().message
    # At once again: the services that stayed to answer are new ones then.
    assert manager.change("activate")
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
        assert len(whole) == 1
        node.trigger_deactivate()
        node.trigger_activate()
        assert len(whole) == 1
    finally:
        gc.callbacks.remove(note)
        gc.unfreeze()
        node.destroy_node()
        rclpy.shutdown()


@pytest.mark.parametrize(
    ("fails", "why", "state"),
    [
        ("ours", "configuring failed: the file is missing; expected one", "unconfigured"),
        ("bug", "configuring failed: ZeroDivisionError: 1 / 0", "unconfigured"),
    ],
)
def test_what_cannot_be_configured_can_be_mended(start, manager, fails, why, state):
    process = start("-p", "autostart:=false", "-p", f"fails:={fails}")
    assert not manager.change("configure")
    assert manager.state() == state
    output = end(process)
    assert why in output
    assert ("please report this" in output) is (fails == "bug")


def test_what_cannot_start_itself_ends_with_one_line(start):
    process = start("-p", "fails:=ours")
    assert process.wait(30.0) == 1
    output = process.output
    assert output.strip().splitlines()[-1].endswith("error: the file is missing; expected one")
    assert "Traceback" not in output
