"""The processes of a run end with it: tests, benchmarks and the demo call `guard_run` first."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

MARKS = "INTUITIVE_PHYSICS_RUNS"
"""Environment variable with a mark of each run that a process belongs to; children inherit it."""

WATCHDOG = "intuitive_physics.processes.watchdog"
"""Module that is the watchdog's program."""

BOUND_PROGRAM = "intuitive_physics.processes.bound_program"
"""Module that binds a program to its parent, and runs it."""

TERMINATED = 128 + signal.SIGTERM
"""Exit code of a run that was ended by SIGTERM."""

_SET_DEATH_SIGNAL = 1
"""PR_SET_PDEATHSIG of prctl(2)."""

_watchdogs: list[subprocess.Popen[bytes]] = []

_forking: list[int] = []
"""Process id of the process that forks."""


def guard_run(terminate: Callable[[], Any] = lambda: sys.exit(TERMINATED)) -> None:
    """Have all that this process starts from now on end with it, whatever ends it.

    A watchdog, a process of its own, waits for the end of this one, even by SIGKILL. Then it kills
    every process that inherited the environment of this one, at whatever remove and in whatever
    session, and removes their shared memory. SIGTERM raises in the main thread, so that `finally`
    runs; a run that has not ended soon after it is killed, and one whose `make` was killed too.

    Call it in the main thread.

    Parameters
    ----------
    terminate : raises when SIGTERM has come
    """
    if _watchdogs:
        return
    mark = uuid.uuid4().hex
    signals, wakeup = os.pipe()
    os.set_blocking(wakeup, False)
    watched = [os.pidfd_open(os.getpid()), signals, *_makes()]
    _watchdogs.append(
        subprocess.Popen(
            [sys.executable, "-m", WATCHDOG, mark, *map(str, watched)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=watched,
            start_new_session=True,
        )
    )
    for descriptor in watched:
        os.close(descriptor)
    os.environ[MARKS] = f"{os.environ.get(MARKS, '')} {mark}".strip()
    signal.signal(signal.SIGTERM, lambda number, frame: terminate())
    # Written to at once, while the handler waits until Python is back from where it is.
    signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
    os.register_at_fork(before=_note_fork, after_in_child=_end_with_parent)


def _makes() -> list[int]:
    """Return a file descriptor of each `make` that runs this process."""
    descriptors: list[int] = []
    pid, level = os.getppid(), int(os.environ.get("MAKELEVEL") or 0)
    while pid > 1 and len(descriptors) < level:
        name, _, rest = Path(f"/proc/{pid}/stat").read_text().partition("(")[2].rpartition(")")
        if name.endswith("make"):
            descriptors.append(os.pidfd_open(pid))
        pid = int(rest.split()[1])
    return descriptors


def bound_command(module: str, *arguments: str) -> list[str]:
    """Return the command of a module that the kernel kills when the thread that starts it ends.

    A program that reads its standard input notices the end of its parent only when it runs. At a
    priority that leaves it no time it would still be importing minutes later.
    """
    return [sys.executable, "-m", BOUND_PROGRAM, str(os.getpid()), module, *arguments]


def die_with_parent(parent: int) -> None:
    """Have the kernel kill this process when the thread that started it ends, on Linux.

    Parameters
    ----------
    parent : process id of that thread's process; if it has ended already, this one does at once
    """
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def _note_fork() -> None:
    _forking[:] = [os.getpid()]


def _end_with_parent() -> None:
    """Be ended with the process that forked this one: its environment has no mark."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    die_with_parent(*_forking)
