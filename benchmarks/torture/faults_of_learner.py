"""Faults of what the learner keeps things in, and of the cluster that works for it."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import LearningOptions, Observation, ResultCode
from intuitive_physics_msgs.srv import AddObservation, ListObservations
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient

from benchmarks.torture.bars import bars
from benchmarks.torture.early_end import traceback_in
from benchmarks.torture.faults_around import FaultError, result_of
from benchmarks.torture.nodes import (
    LEARNER,
    PATIENCE,
    blamed_on_death,
    family,
    thrown_ball,
)
from intuitive_physics.processes import ChildProcess
from intuitive_physics_bringup.connections import module
from intuitive_physics_learner import ObservationStore
from intuitive_physics_ros.conversions import observation_to_message
from intuitive_physics_ros.qos import OBSERVATIONS as OBSERVATIONS_QOS
from intuitive_physics_ros.scripting import NodeProcess, Peer
from intuitive_physics_ros.topics import OBSERVATIONS

# Sizes of a file system in memory, before and after it is full
SMALL_DISK, LARGER_DISK = "2m", "64m"
NEW_MOUNTS = 0x20000  # CLONE_NEWNS of unshare(2)
MOST_OBSERVATIONS = 3000  # that are tried until a disk is full
LOCKED = 8.0  # s for which another program holds the database: longer than the learner tries
LONGEST_SEARCH = 60.0  # s that a search may last that a worker died in
UNPLUGGED_ANSWER = 30.0  # s in which a search has to end whose scheduler died
# Long enough to be hurt
SEARCH = LearningOptions(method="random", max_iterations=20_000, time_limit=20.0)
SHORT_SEARCH = LearningOptions(method="random", max_iterations=200)  # to see that it works again
ENDS = (ResultCode.OK, ResultCode.CLUSTER_FAILED)  # results of a search whose worker died


def measure_faults_of_learner(folder: Path) -> dict[str, str]:
    """Return for each fault "ok" or what was wrong."""
    faults: dict[str, Callable[[Path], None]] = {
        "disk_full": _disk_full,
        "database_locked": _database_locked,
        "database_truncated": _database_truncated,
        "dask_worker_dies": _worker_dies,
        "scheduler_dies": _scheduler_dies,
    }
    found = {}
    for name, fault in faults.items():
        own = folder / name
        own.mkdir()
        found[name] = result_of(partial(fault, own))
    return found


@dataclass
class Learner:
    """A learner that is tormented, and what it has answered."""

    process: NodeProcess  # of the node
    peer: Peer  # that calls it
    answered: set[str] = field(default_factory=set)  # ids of observations that it has stored

    def add(self, number: int, timeout: float = PATIENCE) -> Any:
        """Add an observation, and return the result of the call."""
        one = thrown_ball(number)
        request = AddObservation.Request(observation=observation_to_message(one))
        answer = self.peer.call(
            AddObservation, f"/{LEARNER}/add_observation", request, timeout
        ).result
        if answer.value == ResultCode.OK:
            self.answered.add(one.id)
        return answer

    def expect(self, answer: Any, what: str, *codes: int) -> None:
        """Complain of a result that has none of the codes, or a refusal without a sentence."""
        if answer.value not in codes:
            raise FaultError(f"{what}: answered {answer.value} ({answer.message})")
        if answer.value != ResultCode.OK and len(answer.message) < 20:
            raise FaultError(f"{what}: refused with no more than {answer.message!r}")

    def check_ping(self, doing: str) -> None:
        """Complain unless it answers within the time of a ping."""
        self.process.check_running()
        begun = time.monotonic()
        request = GetParameters.Request(names=["use_sim_time"])
        self.peer.call(GetParameters, f"/{LEARNER}/get_parameters", request, PATIENCE)
        took = time.monotonic() - begun
        if took > bars().answer:
            raise FaultError(f"{doing}: answered a ping after {took:.1f} s")

    def learn(self, options: LearningOptions) -> Any:
        """Begin a search, and return the future of its result."""
        client = ActionClient(self.peer.node, LearnParameters, f"/{LEARNER}/learn_parameters")
        self.peer.spin_until(client.server_is_ready, "the action", PATIENCE)
        sent = client.send_goal_async(LearnParameters.Goal(options=options))
        self.peer.spin_until(sent.done, "the goal's answer", PATIENCE)
        return sent.result().get_result_async()

    def end_of(self, search: Any, timeout: float) -> Any:
        """Return the result of a search."""
        self.peer.spin_until(search.done, "the end of a search", timeout)
        return search.result().result.result

    def check_kept(self, database: Path) -> None:
        """Stop it, and complain of what was answered and is not there."""
        if self.process.is_running and (code := self.process.stop()):
            raise FaultError(f"ended with code {code}")
        if wrote := traceback_in(self.process.output):
            raise FaultError(f"wrote {wrote}")
        with ObservationStore(database) as store:
            lost = self.answered - {entry.id for entry in store.entries()}
        if lost:
            raise FaultError(f"{len(lost)} of {len(self.answered)} answered are lost")


@contextmanager
def _learner(database: Path, *arguments: str) -> Iterator[Learner]:
    """Run a learner; what it does not answer in time is a fault."""
    parameters = [f"database:={database}", *arguments]
    given = [word for one in parameters for word in ("-p", one)]
    with (
        NodeProcess(module(LEARNER), given) as process,
        Peer("torturer", PATIENCE) as peer,
        blamed_on_death(LEARNER, process),
    ):
        yield Learner(process, peer)


def _disk_full(folder: Path) -> None:
    _use_own_mounts()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK}", "tmpfs", str(folder)]
    subprocess.run(mount, check=True)
    database = folder / "learner.sqlite3"
    try:
        with _learner(database) as learner:
            number = _fill(learner)
            learner.check_ping("on a full disk")
            _publish(learner.peer, number + 1)
            learner.check_ping("with an observation that waits for a full disk")
            larger = ["mount", "-o", f"remount,size={LARGER_DISK}", str(folder)]
            subprocess.run(larger, check=True)
            _wait_until_stored(learner, thrown_ball(number + 1).id)
            learner.expect(learner.add(number + 2), "with room again", ResultCode.OK)
            learner.check_kept(database)
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def _use_own_mounts() -> None:
    """Have this process, and those it starts, see mounts that end with them."""
    if ctypes.CDLL(None).unshare(NEW_MOUNTS):
        raise FaultError("not tried: only root may mount a small disk")
    subprocess.run(["mount", "--make-rprivate", "/"], check=True)


def _fill(learner: Learner) -> int:
    """Add observations until one is refused; return how many there were."""
    for number in range(MOST_OBSERVATIONS):
        answer = learner.add(number)
        if answer.value != ResultCode.OK:
            learner.expect(answer, "on a full disk", ResultCode.STORAGE_FAILED)
            if "full" not in answer.message:
                raise FaultError(f"the refusal does not say that it is full: {answer.message}")
            return number
    raise FaultError(f"the disk was not full after {MOST_OBSERVATIONS} observations")


def _publish(peer: Peer, number: int) -> None:
    """Send an observation by topic."""
    publisher = peer.publisher(Observation, f"/{OBSERVATIONS}", OBSERVATIONS_QOS)
    publisher.publish(observation_to_message(thrown_ball(number)))
    peer.spin_for(1.0)


def _wait_until_stored(learner: Learner, name: str) -> None:
    request = ListObservations.Request()

    def stored() -> bool:
        answer = learner.peer.call(ListObservations, f"/{LEARNER}/list_observations", request)
        return name in {one.id for one in answer.observations}

    learner.peer.spin_until(stored, "an observation that waited to be stored", 10.0)
    learner.answered.add(name)


def _database_locked(folder: Path) -> None:
    database = folder / "learner.sqlite3"
    with _learner(database) as learner:
        learner.expect(learner.add(0), "before the lock", ResultCode.OK)
        with closing(sqlite3.connect(database, isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            end = time.monotonic() + LOCKED
            _publish(learner.peer, 1)
            refused = learner.add(2)
            learner.expect(refused, "locked", ResultCode.STORAGE_FAILED, ResultCode.BUSY)
            while time.monotonic() < end:
                learner.check_ping("with a locked database")
                learner.peer.spin_for(0.5)
            other.execute("ROLLBACK")
        _wait_until_stored(learner, thrown_ball(1).id)
        learner.expect(learner.add(3), "after the lock", ResultCode.OK)
        learner.check_kept(database)


def _database_truncated(folder: Path) -> None:
    database = folder / "learner.sqlite3"
    with _learner(database) as learner:
        for number in range(20):
            learner.expect(learner.add(number), "before the damage", ResultCode.OK)
        learner.check_kept(database)
        answered = learner.answered
    whole = shutil.copy(database, folder / "whole.sqlite3")
    with _learner(database, "online:=false") as learner:
        learner.expect(learner.add(20), "before the damage", ResultCode.OK)
        with database.open("r+b") as file:
            file.truncate(database.stat().st_size // 2)
        learner.peer.spin_for(1.0)
        anything = (ResultCode.OK, ResultCode.STORAGE_FAILED)
        learner.expect(learner.add(21), "truncated while open", *anything)
        learner.check_ping("with a truncated database")
        if code := learner.process.stop():
            raise FaultError(f"ended with code {code}")
    _check_start_on_half(database, Path(whole))
    shutil.copy(whole, database)
    with _learner(database) as learner:
        learner.answered = answered
        learner.expect(learner.add(22), "with the whole file again", ResultCode.OK)
        learner.check_kept(database)


def _check_start_on_half(database: Path, whole: Path) -> None:
    """Complain unless a start on half a file ends at once and says why, leaving it as it is."""
    for rest in database.parent.glob(f"{database.name}-*"):
        rest.unlink()
    half = whole.read_bytes()[: whole.stat().st_size // 2]
    database.write_bytes(half)
    with NodeProcess(module(LEARNER), ["-p", f"database:={database}"]) as process:
        code = process.wait(PATIENCE)
    said = process.output.strip().splitlines()[-1:]
    if code != 1 or not said or not re.search(f"error: .*{re.escape(database.name)}", said[0]):
        raise FaultError(f"started on half a file: code {code}, {said}")
    if database.read_bytes() != half:
        raise FaultError("the damaged file was changed")


def _worker_dies(folder: Path) -> None:
    database = folder / "learner.sqlite3"
    with _learner(database, "cluster:=local:2", "online:=false") as learner:
        _add_some(learner)
        first = learner.learn(SHORT_SEARCH)
        learner.expect(learner.end_of(first, PATIENCE), "before a worker dies", ResultCode.OK)
        search = learner.learn(SEARCH)
        learner.peer.spin_for(2.0)
        started = family(learner.process.pid)
        workers = [pid for pid, command in started.items() if "spawn_main" in command]
        if not workers:
            raise FaultError("there was no worker to kill")
        os.kill(workers[0], signal.SIGKILL)
        learner.check_ping("after a worker's death")
        learner.expect(learner.end_of(search, LONGEST_SEARCH), "a worker died", *ENDS)
        again = learner.learn(SHORT_SEARCH)
        learner.expect(learner.end_of(again, LONGEST_SEARCH), "afterwards", ResultCode.OK)
        learner.check_kept(database)


def _scheduler_dies(folder: Path) -> None:
    database, port = folder / "learner.sqlite3", _free_port()
    scheduler = _start_cluster(port)
    try:
        with _learner(database, f"cluster:=127.0.0.1:{port}", "online:=false") as learner:
            _add_some(learner)
            first = learner.learn(SHORT_SEARCH)
            learner.expect(learner.end_of(first, PATIENCE), "before it dies", ResultCode.OK)
            search = learner.learn(SEARCH)
            learner.peer.spin_for(2.0)
            scheduler[0].stop(signal.SIGKILL)
            learner.check_ping("after the scheduler's death")
            ended = learner.end_of(search, UNPLUGGED_ANSWER)
            learner.expect(ended, "the scheduler died", ResultCode.CLUSTER_FAILED)
            learner.expect(learner.add(50), "afterwards", ResultCode.OK)
            scheduler += _start_cluster(port)
            again = learner.learn(SHORT_SEARCH)
            learner.expect(learner.end_of(again, LONGEST_SEARCH), "with a new one", ResultCode.OK)
            begun = time.monotonic()
            learner.check_kept(database)
            if time.monotonic() - begun > 0.5 + bars().stop:
                raise FaultError(f"stopped after {time.monotonic() - begun:.1f} s")
    finally:
        for process in scheduler:
            process.stop(signal.SIGKILL)


def _add_some(learner: Learner) -> None:
    for number in range(3):
        learner.expect(learner.add(number), "before the fault", ResultCode.OK)


def _start_cluster(port: int) -> list[ChildProcess]:
    """Start a scheduler and a worker, the scheduler first."""
    scheduler = ["dask_scheduler", "--host", "127.0.0.1", "--port", str(port)]
    worker = ["dask_worker", f"127.0.0.1:{port}", "--nthreads", "1", "--no-nanny"]
    return [
        ChildProcess(
            [sys.executable, "-m", f"distributed.cli.{program}", *options, "--no-dashboard"]
        )
        for program, *options in (scheduler, worker)
    ]


def _free_port() -> int:
    with closing(socket.socket()) as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
    return port
