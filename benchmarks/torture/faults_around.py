"""Faults around the nodes: clocks that jump, a camera that goes, others that take or take away."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus

from benchmarks.torture.bars import bars
from benchmarks.torture.early_end import in_one_line, noted, traceback_in
from benchmarks.torture.nodes import LEARNER, PATIENCE, PERCEPTION, PREDICTOR, Nodes, megabytes
from benchmarks.torture.suite import Suite, running_suite
from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.processes import ChildProcess, ProcessFailedError
from intuitive_physics_bringup.connections import module
from intuitive_physics_ros.scripting import NodeProcess, PeerTimeoutError

JUMP = 3600.0  # s by which a clock jumps: an hour, as of a wrong time zone
# s without a camera, or with a second node, in a full run and in a first look: /diagnostics come
# once a second
ABSENCE, SHORT_ABSENCE = 6.0, 4.0

# s for which a subscriber does not take, or others take the processor; as above
PRESSURE, SHORT_PRESSURE = 10.0, 4.0
REST = 5.0  # s from the end of starvation to the look at the rate of predictions
# By which the predictor may grow for a subscriber that takes nothing: its queue of 10 messages of
# up to 6 MB
SLOW_SUBSCRIBER_MEGABYTES = 60.0

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

HOGS_A_CORE = 4  # processes that want each core, at the priority of the nodes


LONGEST_HOG = 120.0  # s after which such a process is ended, should nobody have done so


class FaultError(IntuitivePhysicsError):
    """The nodes did not bear a fault as they should."""


def measure_faults_around(folder: Path, seed: int, *, quick: bool = False) -> dict[str, str]:
    """Return for each fault "ok" or what was wrong."""
    absence, pressure = (SHORT_ABSENCE, SHORT_PRESSURE) if quick else (ABSENCE, PRESSURE)
    found: dict[str, str] = {}
    faults: dict[bool, dict[str, Callable[[Suite], None]]] = {
        True: {"clock_back": _clock_back, "clock_forward": _clock_forward},
        False: {
            "camera_gone_and_back": partial(_camera_gone, absence),
            "node_twice": partial(_node_twice, absence),
            "slow_subscriber": partial(_slow_subscriber, pressure),
            "cpu_starved": partial(_cpu_starved, pressure),
        },
    }
    for has_clock, some in faults.items():
        failures: list[str] = []
        with noted(failures), running_suite(folder, seed, has_clock=has_clock) as suite:
            for name, fault in some.items():
                found[name] = _borne(fault, suite)
        for name in some if failures else ():
            found.setdefault(name, f"not tried: {failures[0]}")
    return found


def result_of(check: Callable[[], None]) -> str:
    """Return "ok", or in one line what a check complains of or cannot do."""
    try:
        check()
    except Exception as error:
        return in_one_line(error)
    return "ok"


def _borne(fault: Callable[[Suite], None], suite: Suite) -> str:
    """Return "ok", or in one line what is wrong; the next fault finds all nodes alive again."""
    known = len(suite.nodes.deaths)
    found = result_of(partial(fault, suite))
    wrote = [
        f"{name} wrote {traceback}"
        for name, process in suite.nodes.processes.items()
        if (traceback := traceback_in(process.output))
    ]
    suite.nodes.revive()
    if died := suite.nodes.deaths[known:]:
        return "; ".join(died)
    if wrote:
        return "; ".join(wrote)
    return found if found != "ok" else result_of(partial(check_pings, suite.nodes))


def check_pings(nodes: Nodes, share: float = 1.0) -> None:
    """Complain of a node that takes too long for an answer with its share of a processor."""
    for name in nodes.processes:
        took = nodes.ping(name)
        if took > bars().answer / share:
            raise FaultError(f"{name} answered a ping after {took:.1f} s")


def _recovers(suite: Suite, after: str) -> None:
    """Complain unless what is seen from now on is predicted from soon."""
    limit = bars().recovery
    if not suite.predictions.wait(suite.camera.time, limit):
        raise FaultError(f"no prediction within {limit:g} s after {after}")


def _is_said(suite: Suite, node: str, text: str, since: int) -> bool:
    return any(text in one for one in suite.said(node, _WARN, since))


def _expect_said(said: Callable[[], bool], what: str, suite: Suite) -> None:
    """Complain unless /diagnostics say something soon."""
    try:
        suite.peer.spin_until(said, what, bars().recovery)
    except PeerTimeoutError:
        raise FaultError(f"/diagnostics did not say that {what}") from None


def _clock_back(suite: Suite) -> None:
    suite.camera.jump(-JUMP)
    _recovers(suite, "the clock went back")


def _clock_forward(suite: Suite) -> None:
    suite.camera.jump(JUMP)
    _recovers(suite, "the clock went forward")


def _camera_gone(absence: float, suite: Suite) -> None:
    suite.camera.unplug()
    earlier = len(suite.diagnostics)
    suite.peer.spin_for(absence)
    _expect_said(
        lambda: any(suite.said(PERCEPTION, level, earlier) for level in (_WARN, _ERROR)),
        "no images come",
        suite,
    )
    suite.camera.plug_in()
    _recovers(suite, "the camera was there again")


_WARN, _ERROR = DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def _node_twice(absence: float, suite: Suite) -> None:
    earlier = len(suite.diagnostics)
    twins = {LEARNER: ["-p", f"database:={suite.nodes.database}"], PREDICTOR: []}
    for name, arguments in twins.items():
        with NodeProcess(module(name), arguments) as twin:
            suite.peer.spin_for(absence)
            if not twin.is_running and (wrote := traceback_in(twin.output)):
                raise FaultError(f"a second {name} ended with {wrote}")
            told = partial(_is_said, suite, name, "nodes have the name", earlier)
            _expect_said(told, f"there are two of {name}", suite)
    _recovers(suite, "the second nodes ended")


def _slow_subscriber(pressure: float, suite: Suite) -> None:
    usual = suite.predictions.rate(pressure / 2)
    pid = suite.nodes.processes[PREDICTOR].pid
    memory = megabytes(pid)
    with _subscriber():
        rate = suite.predictions.rate(pressure)
        grown = megabytes(pid) - memory
    kept = bars().kept_rate
    if rate < kept * usual:
        raise FaultError(f"{rate:.0f} predictions a second; expected {kept:g} of {usual:.0f}")
    if grown > SLOW_SUBSCRIBER_MEGABYTES:
        raise FaultError(f"the predictor grew by {grown:.0f} MB")


@contextmanager
def _subscriber() -> Iterator[None]:
    """Let a process subscribe to the predictions and stand still."""
    process = ChildProcess([sys.executable, "-c", SUBSCRIBER], name="the slow subscriber")
    try:
        process.wait_for("hears", PATIENCE)
        process.send_signal(signal.SIGSTOP)
        yield
    except ProcessFailedError as error:
        raise FaultError(in_one_line(error)) from None
    finally:
        process.stop(signal.SIGKILL)


@contextmanager
def _hogs() -> Iterator[None]:
    """Let processes want every core several times."""
    command = [sys.executable, "-c", "while True: pass"]
    hogs = [
        ChildProcess(command, longest=LONGEST_HOG)
        for _ in range(HOGS_A_CORE * len(os.sched_getaffinity(0)))
    ]
    try:
        yield
    finally:
        for hog in hogs:
            hog.stop(signal.SIGKILL)


def _cpu_starved(pressure: float, suite: Suite) -> None:
    usual = suite.predictions.rate(pressure / 2)
    with _hogs():
        starved = suite.predictions.rate(pressure)
        check_pings(suite.nodes, share=1.0 / HOGS_A_CORE)
    if not starved:
        raise FaultError("no prediction while others took the processor")
    time.sleep(REST)
    rate = suite.predictions.rate(pressure / 2)
    if rate < bars().kept_rate * usual:
        raise FaultError(f"{rate:.0f} predictions a second afterwards, {usual:.0f} before")
