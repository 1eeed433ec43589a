"""Faults of the learner's storage, and of the cluster that works for it."""

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
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

from intuitive_physics_msgs.msg import LearningOptions, Observation, ResultCode
from intuitive_physics_msgs.srv import ListObservations

from benchmarks.running_nodes import LEARNER, parameter_arguments
from benchmarks.torture.bars import bars
from benchmarks.torture.early_end import FaultError, result_of, traceback_in
from benchmarks.torture.learner import Learner, lost_observations, running_learner
from benchmarks.torture.nodes import PATIENCE, family, ping, thrown_ball
from intuitive_physics.processes import ChildProcess
from intuitive_physics_bringup.connections import module
from intuitive_physics_ros.conversions import observation_to_message
from intuitive_physics_ros.qos import OBSERVATIONS as OBSERVATIONS_QOS
from intuitive_physics_ros.scripting import NodeProcess
from intuitive_physics_ros.topics import OBSERVATIONS

SMALL_DISK, LARGER_DISK = "2m", "64m"  # sizes of a file system in memory, before and after
NEW_MOUNTS = 0x20000  # CLONE_NEWNS of unshare(2)
MOST_OBSERVATIONS = 3000  # that are tried until a disk is full
LOCKED = 8.0  # s for which another program holds the database: longer than the learner tries
LONGEST_SEARCH = 60.0  # s that a search may last in which a worker died
UNPLUGGED_ANSWER = 30.0  # s in which a search has to end whose scheduler died

SEARCH = LearningOptions(method="random", max_iterations=20_000, time_limit=5.0)
SHORT_SEARCH = LearningOptions(method="random", max_iterations=200)


def measure_faults_of_learner(folder: Path) -> dict[str, str]:
    """Return for each fault "ok" or a description of what was wrong."""
    faults: dict[str, Callable[[Path], None]] = {
        "disk_full": _disk_full,
        "database_locked": _database_locked,
        "database_truncated": _database_truncated,
        "dask_worker_dies": _worker_dies,
        "scheduler_dies": _scheduler_dies,
    }
    results = {}
    for name, fault in faults.items():
        (folder / name).mkdir()
        results[name] = result_of(partial(fault, folder / name / "learner.sqlite3"))
    return results


def _expect(result: Any, when: str, *codes: int) -> None:
    """Raise `FaultError` for a result with another code, or a refusal without a sentence."""
    if result.value not in codes:
        raise FaultError(f"{when}: answered {result.value} ({result.message})")
    if result.value != ResultCode.OK and len(result.message) < 20:
        raise FaultError(f"{when}: refused with no more than {result.message!r}")


def _add(learner: Learner, when: str, *numbers: int) -> None:
    """Add observations, none of which may be refused."""
    for number in numbers:
        _expect(learner.add_ball(number), when, ResultCode.OK)


def _publish(learner: Learner, number: int) -> None:
    """Send an observation by topic."""
    publisher = learner.peer.publisher(Observation, f"/{OBSERVATIONS}", OBSERVATIONS_QOS)
    publisher.publish(observation_to_message(thrown_ball(number)))
    learner.peer.spin_for(1.0)


def _wait_until_stored(learner: Learner, number: int) -> None:
    """Wait for an observation that came by topic."""
    name, request = thrown_ball(number).id, ListObservations.Request()

    def stored() -> bool:
        answer = learner.peer.call(ListObservations, f"/{LEARNER}/list_observations", request)
        return name in {observation.id for observation in answer.observations}

    learner.peer.spin_until(stored, "an observation that waited to be stored", 10.0)
    learner.acknowledged.ids.add(name)


def _check_ping(learner: Learner, when: str) -> None:
    """Raise `FaultError` for a slow answer to a ping."""
    learner.process.check_running()
    begin = time.monotonic()
    ping(learner.peer, LEARNER, PATIENCE)
    took = time.monotonic() - begin
    if took > bars().answer:
        raise FaultError(f"{when}: answered a ping after {took:.1f} s")


def _search(learner: Learner, when: str, timeout: float) -> None:
    """Search for a short time, which has to succeed."""
    _, search = learner.search(SHORT_SEARCH)
    _expect(learner.end_of(search, timeout), when, ResultCode.OK)


def _check_kept(learner: Learner, database: Path) -> None:
    """Stop a learner, and raise `FaultError` for acknowledged observations that are lost."""
    if learner.process.is_running and (code := learner.process.stop()):
        raise FaultError(f"ended with code {code}")
    if trace := traceback_in(learner.process.output):
        raise FaultError(f"wrote {trace}")
    if lost := lost_observations(database, learner.acknowledged):
        raise FaultError(f"{len(lost)} of {len(learner.acknowledged.ids)} answered are lost")


def _disk_full(database: Path) -> None:
    # Mounts of this process, and of those that it starts, end with them.
    if ctypes.CDLL(None).unshare(NEW_MOUNTS):
        raise FaultError("not tried: only root may mount a small disk")
    folder = str(database.parent)
    subprocess.run(["mount", "--make-rprivate", "/"], check=True)
    small = ["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK}", "tmpfs", folder]
    subprocess.run(small, check=True)
    try:
        with running_learner(database) as learner:
            number = _fill(learner)
            _check_ping(learner, "on a full disk")
            _publish(learner, number + 1)
            _check_ping(learner, "with an observation that waits for a full disk")
            larger = ["mount", "-o", f"remount,size={LARGER_DISK}", folder]
            subprocess.run(larger, check=True)
            _wait_until_stored(learner, number + 1)
            _add(learner, "with room again", number + 2)
            _check_kept(learner, database)
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def _fill(learner: Learner) -> int:
    """Add observations until one is refused; return how many there were."""
    for number in range(MOST_OBSERVATIONS):
        result = learner.add_ball(number)
        if result.value != ResultCode.OK:
            _expect(result, "on a full disk", ResultCode.STORAGE_FAILED)
            if "full" not in result.message:
                raise FaultError(f"the refusal does not say that it is full: {result.message}")
            return number
    raise FaultError(f"the disk was not full after {MOST_OBSERVATIONS} observations")


def _database_locked(database: Path) -> None:
    with running_learner(database) as learner:
        _add(learner, "before the lock", 0)
        with closing(sqlite3.connect(database, isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            end = time.monotonic() + LOCKED
            _publish(learner, 1)
            refused = learner.add_ball(2)
            _expect(refused, "locked", ResultCode.STORAGE_FAILED, ResultCode.BUSY)
            while time.monotonic() < end:
                _check_ping(learner, "with a locked database")
                learner.peer.spin_for(0.5)
            other.execute("ROLLBACK")
        _wait_until_stored(learner, 1)
        _add(learner, "after the lock", 3)
        _check_kept(learner, database)


def _database_truncated(database: Path) -> None:
    with running_learner(database) as learner:
        _add(learner, "before the damage", *range(20))
        _check_kept(learner, database)
        acknowledged = learner.acknowledged
    whole = Path(shutil.copy(database, database.with_name("whole.sqlite3")))
    with running_learner(database, online="false") as learner:
        _add(learner, "before the damage", 20)
        os.truncate(database, database.stat().st_size // 2)
        learner.peer.spin_for(1.0)
        result = learner.add_ball(21)
        _expect(result, "truncated while open", ResultCode.OK, ResultCode.STORAGE_FAILED)
        _check_ping(learner, "with a truncated database")
        if code := learner.process.stop():
            raise FaultError(f"ended with code {code}")
    _check_start_on_half(database, whole)
    shutil.copy(whole, database)
    with running_learner(database, acknowledged) as learner:
        _add(learner, "with the whole file again", 22)
        _check_kept(learner, database)


def _check_start_on_half(database: Path, whole: Path) -> None:
    """A start on half a file has to end at once with the reason, and leave the file as it is."""
    for rest in database.parent.glob(f"{database.name}-*"):
        rest.unlink()
    half = whole.read_bytes()[: whole.stat().st_size // 2]
    database.write_bytes(half)
    with NodeProcess(module(LEARNER), parameter_arguments(database=database)) as process:
        code = process.wait(PATIENCE)
    line = process.output.strip().splitlines()[-1:]
    if code != 1 or not line or not re.search(f"error: .*{re.escape(database.name)}", line[0]):
        raise FaultError(f"started on half a file: code {code}, {line}")
    if database.read_bytes() != half:
        raise FaultError("the damaged file was changed")


def _worker_dies(database: Path) -> None:
    with running_learner(database, cluster="local:2", online="false") as learner:
        _add(learner, "before the fault", *range(3))
        _search(learner, "before a worker dies", PATIENCE)
        _, search = learner.search(SEARCH)
        learner.peer.spin_for(2.0)
        processes = family(learner.process.pid)
        workers = [pid for pid, command in processes.items() if "spawn_main" in command]
        if not workers:
            raise FaultError("there was no worker to kill")
        os.kill(workers[0], signal.SIGKILL)
        _check_ping(learner, "after a worker's death")
        result = learner.end_of(search, LONGEST_SEARCH)
        _expect(result, "a worker died", ResultCode.OK, ResultCode.CLUSTER_FAILED)
        _search(learner, "afterwards", LONGEST_SEARCH)
        _check_kept(learner, database)


def _scheduler_dies(database: Path) -> None:
    with closing(socket.socket()) as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
    with ExitStack() as killed:
        scheduler = _start_cluster(port, killed)
        with running_learner(database, cluster=f"127.0.0.1:{port}", online="false") as learner:
            _add(learner, "before the fault", *range(3))
            _search(learner, "before it dies", PATIENCE)
            _, search = learner.search(SEARCH)
            learner.peer.spin_for(2.0)
            scheduler.stop(signal.SIGKILL)
            _check_ping(learner, "after the scheduler's death")
            result = learner.end_of(search, UNPLUGGED_ANSWER)
            _expect(result, "the scheduler died", ResultCode.CLUSTER_FAILED)
            _add(learner, "afterwards", 50)
            _start_cluster(port, killed)
            _search(learner, "with a new one", LONGEST_SEARCH)
            begin = time.monotonic()
            _check_kept(learner, database)
            took = time.monotonic() - begin
            if took > 0.5 + bars().stop:
                raise FaultError(f"stopped after {took:.1f} s")


def _start_cluster(port: int, killed: ExitStack) -> ChildProcess:
    """Start a scheduler and a worker, which are killed in the end; return the scheduler."""
    scheduler = ["dask_scheduler", "--host", "127.0.0.1", "--port", str(port)]
    worker = ["dask_worker", f"127.0.0.1:{port}", "--nthreads", "1", "--no-nanny"]
    started = [
        ChildProcess(
            [sys.executable, "-m", f"distributed.cli.{program}", *options, "--no-dashboard"]
        )
        for program, *options in (scheduler, worker)
    ]
    for process in started:
        killed.callback(process.stop, signal.SIGKILL)
    return started[0]
