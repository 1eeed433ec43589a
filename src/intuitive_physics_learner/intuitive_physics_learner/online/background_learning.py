"""Starting, watching and stopping the process that learns in the background.

It is a process and not a thread: a thread of idle priority that holds Python's interpreter lock
while others take its core would block the whole node. And a process can be stopped at any instant.
"""

from __future__ import annotations

import json
import os
import subprocess
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from intuitive_physics.limits import limits
from intuitive_physics.processes import bound_command
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.worker import FAILED, WAITING, WorkerReport

LOWEST_NICENESS = 19
"""The niceness of POSIX that leaves the most to other processes."""

PRIORITIES = ("idle", "low", "normal")
"""Idle: only time that no other process wants. Low: the smallest share, but never none. Normal: as
others."""


def limit_process(pid: int, priority: str, cores: int) -> None:
    """Give a process a priority and a largest number of cores.

    To be called before it has started threads, which inherit both.
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
"""Module that the process runs."""

LAST_LINES = 3
"""Lines of the standard error of a worker that died that its report quotes."""


class BackgroundLearning:
    """Learns from a store in a process of its own. Its methods return at once, in any thread."""

    def __init__(self, database: Path, simulator: str, on_improved: Callable[[], None]) -> None:
        self._database = database
        self._simulator = simulator
        self._on_improved = on_improved
        self._process: subprocess.Popen[str] | None = None
        self._started_with: tuple[OnlineOptions, int, str] | None = None
        self._lock = threading.RLock()
        self._report = WorkerReport(WAITING)

    @property
    def running(self) -> bool:
        """Whether the process was started and not stopped."""
        return self._process is not None

    @property
    def report(self) -> WorkerReport:
        """The newest report of the process."""
        with self._lock:
            return self._report

    def start(self, options: OnlineOptions, cores: int, priority: str = "idle") -> None:
        """Start to learn; a process that runs already is replaced."""
        task = {
            "database": str(self._database),
            "simulator": self._simulator,
            "cores": cores,
            "limits": asdict(limits()),
            "options": asdict(options),
        }
        with self._lock:
            self.stop()
            started: Future[subprocess.Popen[str]] = Future()
            threading.Thread(
                target=self._run, args=(task, cores, priority, started), daemon=True
            ).start()
            self._process = started.result()
            self._started_with = (options, cores, priority)
            self._report = WorkerReport(WAITING)

    def _run(
        self,
        task: dict[str, Any],
        cores: int,
        priority: str,
        started: Future[subprocess.Popen[str]],
    ) -> None:
        """Start the process, and watch it; it is bound to this thread, which outlasts it."""
        threads = {name: str(cores) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
        try:
            process = subprocess.Popen(
                bound_command(WORKER, json.dumps(task)),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env={**os.environ, **threads},
            )
        except OSError as error:
            started.set_exception(error)
            return
        limit_process(process.pid, priority, cores)
        started.set_result(process)
        self._watch(process)

    def notify(self) -> None:
        """Make the process read the store again; starts one that has died."""
        with self._lock:
            if self._process is None or self._process.stdin is None or self._started_with is None:
                return
            try:
                self._process.stdin.write("notify\n")
                self._process.stdin.flush()
            except BrokenPipeError:
                self.start(*self._started_with)

    def stop(self) -> None:
        """End the process at once. What it has found so far is in the store."""
        with self._lock:
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
        """Take over a report unless it is of a process that was stopped; return whether it was."""
        with self._lock:
            current = process is self._process
            if current:
                self._report = report
            return current
