"""Starting, watching and stopping the process that learns in the background.

A process of its own and not a thread: a thread of idle priority that holds Python's interpreter
lock while others take its core would hold up the whole node. And a process can be stopped at any
instant.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

from intuitive_physics_learner.online.improvement import OnlineOptions
from intuitive_physics_learner.online.worker import FAILED, WAITING, WorkerReport

LOWEST_NICENESS = 19

PRIORITIES = ("idle", "low", "normal")
"""Idle: only what nobody else wants. Low: the least share, but never none. Normal: as others."""


def step_back(pid: int, priority: str, cores: int) -> None:
    """Give a process a priority, and no more than so many cores.

    To be called before it has started threads; those that it starts later are as it is.

    Parameters
    ----------
    priority : one of `PRIORITIES`
    """
    # It may have ended already, and some containers forbid one or the other.
    with suppress(ProcessLookupError, PermissionError):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(pid, allowed[-cores:])
    with suppress(ProcessLookupError, PermissionError):
        if priority != "normal":
            os.setpriority(os.PRIO_PROCESS, pid, LOWEST_NICENESS)
        if priority == "idle":
            os.sched_setscheduler(pid, os.SCHED_IDLE, os.sched_param(0))


WORKER = "intuitive_physics_learner.online.worker"

LAST_LINES = 3
"""Of what a worker that died has written to standard error, to tell why."""


class BackgroundLearning:
    """Learns from a store in a process of its own. Its methods return at once.

    Parameters
    ----------
    database : file of the store
    simulator : name of the engine
    on_improved : called from another thread when a new version of θ_s was stored
    """

    def __init__(self, database: Path, simulator: str, on_improved: Callable[[], None]) -> None:
        self._database = database
        self._simulator = simulator
        self._on_improved = on_improved
        self._process: subprocess.Popen[str] | None = None
        self._told: tuple[OnlineOptions, int, str] | None = None
        self._lock = threading.Lock()
        self._report = WorkerReport(WAITING)

    @property
    def running(self) -> bool:
        """Whether the process was started and not stopped."""
        return self._process is not None

    @property
    def report(self) -> WorkerReport:
        """How it does."""
        with self._lock:
            return self._report

    def start(self, options: OnlineOptions, cores: int, priority: str = "idle") -> None:
        """Start to learn, anew if it did already.

        Parameters
        ----------
        options : how to learn
        cores : of this machine that it may use
        priority : one of `PRIORITIES`
        """
        self.stop()
        self._told = (options, cores, priority)
        told = {
            "database": str(self._database),
            "simulator": self._simulator,
            "cores": cores,
            "options": asdict(options),
        }
        threads = {name: str(cores) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
        process = subprocess.Popen(
            [sys.executable, "-m", WORKER, json.dumps(told)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **threads},
        )
        step_back(process.pid, priority, cores)
        self._process = process
        with self._lock:
            self._report = WorkerReport(WAITING)
        threading.Thread(target=self._watch, args=(process,), daemon=True).start()

    def look(self) -> None:
        """Say that there may be something new in the store; starts a process that has died."""
        if self._process is None or self._process.stdin is None or self._told is None:
            return
        try:
            self._process.stdin.write("look\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            self.start(*self._told)

    def stop(self) -> None:
        """End the process at once. What it has found so far is in the store."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()

    def _watch(self, process: subprocess.Popen[str]) -> None:
        errors: list[str] = []
        reader = threading.Thread(target=lambda: errors.extend(process.stderr or ()), daemon=True)
        reader.start()
        report = WorkerReport(WAITING)
        for line in process.stdout or ():
            before, report = report, WorkerReport(**json.loads(line))
            if self._take(process, report) and report.version > before.version:
                self._on_improved()
        code = process.wait()
        reader.join()
        last = " | ".join(line.strip() for line in errors[-LAST_LINES:])
        message = last or f"the process that learns in the background ended with code {code}"
        self._take(process, replace(report, state=FAILED, message=message))

    def _take(self, process: subprocess.Popen[str], report: WorkerReport) -> bool:
        """Keep a report, unless the process was stopped and has nothing more to say."""
        with self._lock:
            current = process is self._process
            if current:
                self._report = report
            return current
