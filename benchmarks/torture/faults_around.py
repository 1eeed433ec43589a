"""Faults around the nodes: clocks that jump, a camera that goes, others that take or take away."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus

from benchmarks.command import Outcome
from benchmarks.results.result import Column, Table
from benchmarks.running_nodes import LEARNER, PERCEPTION, PREDICTOR, parameter_arguments
from benchmarks.torture.bars import bars
from benchmarks.torture.early_end import FaultError, in_one_line, noted, result_of, traceback_in
from benchmarks.torture.faults_of_learner import measure_faults_of_learner
from benchmarks.torture.nodes import PATIENCE, Nodes, megabytes
from benchmarks.torture.part import SEED
from benchmarks.torture.suite import Suite, running_suite
from intuitive_physics.processes import ChildProcess, ProcessFailedError
from intuitive_physics_bringup.connections import module
from intuitive_physics_ros.scripting import NodeProcess, PeerTimeoutError

JUMP = 3600.0  # s by which a clock jumps: an hour, as of a wrong time zone
# s of a fault in a full run and in a first look: without a camera or with a second node, where
# /diagnostics come once a second; with a slow subscriber or with other busy processes
ABSENCE, SHORT_ABSENCE = 6.0, 3.0
PRESSURE, SHORT_PRESSURE = 10.0, 3.0
REST, SHORT_REST = 5.0, 2.0  # s from the end of starvation to the measurement of the rate
# MB by which the predictor may grow for a subscriber that takes nothing: its queue of 10 messages
# of up to 6 MB
SLOW_SUBSCRIBER_MEGABYTES = 60.0
# s after which the rate counts beside a subscriber that was stopped. About one stop of 400 is of a
# subscriber that holds a lock in shared memory: who writes to it waits for a second, and for one
# more in which Fast DDS asks whether it lives, and there are no predictions for 2 s.
LOCKED = 5.0
HOGS_A_CORE = 4  # processes that want each core, at the priority of the nodes
LONGEST_HOG = 120.0  # s after which such a process is ended at the latest

# A reliable subscriber with a long queue
SUBSCRIBER = """
import sys, time
from intuitive_physics_msgs.msg import TrajectoryDistribution
from rclpy.qos import QoSProfile
from intuitive_physics_ros.scripting import Peer
from intuitive_physics_ros.topics import PREDICTIONS
with Peer("slow") as peer:
    heard = peer.listen(TrajectoryDistribution, PREDICTIONS, QoSProfile(depth=1000))
    peer.spin_until(lambda: heard, "a prediction", 30.0)
    print("hears", flush=True)
    time.sleep(600.0)
"""


def bear_faults(folder: Path, *, quick: bool) -> Outcome:
    """Bring about faults of the machine and of what is around the nodes."""
    faults = {**measure_faults_of_learner(folder), **_measure_faults_around(folder, quick=quick)}
    table = Table(
        title="Faults of the machine and of what is around",
        note="README.md says what has to be true for each.",
        columns=[Column("fault"), Column("found")],
        rows=list(faults.items()),
    )
    missed = [f"{name}: {result}" for name, result in faults.items() if result != "ok"]
    return Outcome([table], {"faults": faults}, complaints=missed)


def _measure_faults_around(folder: Path, *, quick: bool) -> dict[str, str]:
    """Return for each fault "ok" or a description of what was wrong."""
    absence, pressure, rest = (
        (SHORT_ABSENCE, SHORT_PRESSURE, SHORT_REST) if quick else (ABSENCE, PRESSURE, REST)
    )
    faults: dict[bool, dict[str, Callable[[Suite], None]]] = {
        True: {"clock_back": partial(_clock, -JUMP), "clock_forward": partial(_clock, JUMP)},
        False: {
            "camera_gone_and_back": partial(_camera_gone, absence),
            "node_twice": partial(_node_twice, absence),
            "slow_subscriber": partial(_slow_subscriber, pressure),
            "cpu_starved": partial(_cpu_starved, pressure, rest),
        },
    }
    results: dict[str, str] = {}
    for has_clock, group in faults.items():
        failures: list[str] = []
        with noted(failures), running_suite(folder, SEED, has_clock=has_clock) as suite:
            for name, fault in group.items():
                results[name] = _result(fault, suite)
        for name in group if failures else ():
            results.setdefault(name, f"not tried: {failures[0]}")
    return results


def _result(fault: Callable[[Suite], None], suite: Suite) -> str:
    """Return "ok", or in one line what is wrong; the next fault finds all nodes alive again."""
    before = len(suite.nodes.deaths)
    result = result_of(partial(fault, suite))
    traces = [
        f"{name} wrote {trace}"
        for name, process in suite.nodes.processes.items()
        if (trace := traceback_in(process.output))
    ]
    suite.nodes.revive()
    if wrong := suite.nodes.deaths[before:] or traces:
        return "; ".join(wrong)
    return result if result != "ok" else result_of(partial(_check_pings, suite.nodes))


def _check_pings(nodes: Nodes, share: float = 1.0) -> None:
    """Each node has to answer a ping in time, with its share of a processor."""
    for name in nodes.processes:
        took = nodes.ping(name)
        if took > bars().answer / share:
            raise FaultError(f"{name} answered a ping after {took:.1f} s")


def _expect_recovery(suite: Suite, after: str) -> None:
    """The images from this moment on have to be predicted from soon."""
    limit = bars().recovery
    if not suite.predictions.wait(suite.camera.time, limit):
        raise FaultError(f"no prediction within {limit:g} s after {after}")


def _expect_report(
    suite: Suite, what: str, since: int, node: str, *levels: bytes, text: str = ""
) -> None:
    """A node has to report something on /diagnostics soon, after the first `since` messages."""

    def is_reported() -> bool:
        reports = [report for level in levels for report in suite.reports(node, level, since)]
        return any(text in report for report in reports)

    try:
        suite.peer.spin_until(is_reported, what, bars().recovery)
    except PeerTimeoutError:
        raise FaultError(f"/diagnostics did not say that {what}") from None


def _clock(jump: float, suite: Suite) -> None:
    suite.camera.jump(jump)
    _expect_recovery(suite, f"the clock went {'back' if jump < 0.0 else 'forward'}")


def _camera_gone(absence: float, suite: Suite) -> None:
    suite.camera.unplug()
    earlier = len(suite.diagnostics)
    suite.peer.spin_for(absence)
    levels = DiagnosticStatus.WARN, DiagnosticStatus.ERROR
    _expect_report(suite, "no images come", earlier, PERCEPTION, *levels)
    suite.camera.plug_in()
    _expect_recovery(suite, "the camera was there again")


def _node_twice(absence: float, suite: Suite) -> None:
    earlier = len(suite.diagnostics)
    twins = {LEARNER: parameter_arguments(database=suite.nodes.database), PREDICTOR: []}
    for name, arguments in twins.items():
        with NodeProcess(module(name), arguments) as twin:
            suite.peer.spin_for(absence)
            if not twin.is_running and (trace := traceback_in(twin.output)):
                raise FaultError(f"a second {name} ended with {trace}")
            what, text = f"there are two of {name}", "nodes have the name"
            _expect_report(suite, what, earlier, name, DiagnosticStatus.WARN, text=text)
    _expect_recovery(suite, "the second nodes ended")


def _slow_subscriber(pressure: float, suite: Suite) -> None:
    usual = suite.predictions.rate(pressure / 2)
    pid = suite.nodes.processes[PREDICTOR].pid
    memory = megabytes(pid)
    with ExitStack() as killed:
        subscriber = ChildProcess([sys.executable, "-c", SUBSCRIBER], name="the slow subscriber")
        killed.callback(subscriber.stop, signal.SIGKILL)
        try:
            subscriber.wait_for("hears", PATIENCE)
        except ProcessFailedError as error:
            raise FaultError(in_one_line(error)) from None
        subscriber.send_signal(signal.SIGSTOP)
        time.sleep(LOCKED)
        rate = suite.predictions.rate(pressure)
        grown = megabytes(pid) - memory
    kept = bars().kept_rate
    if rate < kept * usual:
        raise FaultError(f"{rate:.0f} predictions a second; expected {kept:g} of {usual:.0f}")
    if grown > SLOW_SUBSCRIBER_MEGABYTES:
        raise FaultError(f"the predictor grew by {grown:.0f} MB")


def _cpu_starved(pressure: float, rest: float, suite: Suite) -> None:
    usual = suite.predictions.rate(pressure / 2)
    with ExitStack() as killed:
        for _ in range(HOGS_A_CORE * len(os.sched_getaffinity(0))):
            hog = ChildProcess([sys.executable, "-c", "while True: pass"], longest=LONGEST_HOG)
            killed.callback(hog.stop, signal.SIGKILL)
        starved = suite.predictions.rate(pressure)
        _check_pings(suite.nodes, share=1.0 / HOGS_A_CORE)
    if not starved:
        raise FaultError("no prediction while others took the processor")
    time.sleep(rest)
    rate = suite.predictions.rate(pressure / 2)
    if rate < bars().kept_rate * usual:
        raise FaultError(f"{rate:.0f} predictions a second afterwards, {usual:.0f} before")
