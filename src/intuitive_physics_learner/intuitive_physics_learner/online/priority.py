"""Making a process leave the cores of this machine to others."""

from __future__ import annotations

import os
from contextlib import suppress

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
