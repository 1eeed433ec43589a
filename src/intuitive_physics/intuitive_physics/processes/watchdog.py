"""Watches a run from outside, and ends what it has started when it ends, whatever ended it.

`guard_run` starts it as a program.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from intuitive_physics.processes.segments import remove_abandoned_segments

GRACE = 1.0
"""s that a run has after SIGTERM to end what it has started in good order."""

SETTLED = 0.2
"""s that a living process has at most to lock a segment that it has just made."""

ENDING = 5.0
"""s within which processes that were killed have to be gone; some wait for a disk."""

EXITING = 0x4
"""PF_EXITING, among the flags of a process in proc(5): it is ending, and still holds its locks."""


def main() -> None:
    """Watch until the run has ended, then kill what is left of it and free its shared memory."""
    mark, run, signals, *makes = sys.argv[1:]
    _await_end(int(run), int(signals), [int(make) for make in makes])
    end_all(mark.encode())
    time.sleep(SETTLED)
    # A process that was starting a program when it was looked at showed no environment.
    end_all(mark.encode())
    remove_abandoned_segments(settled=SETTLED)


def _await_end(run: int, signals: int, makes: list[int]) -> None:
    """Wait for the end of a run.

    A run that has got SIGTERM, or whose `make` has ended before it, is killed after `GRACE`.

    Parameters
    ----------
    run, makes : file descriptors of processes
    signals : file descriptor that the numbers of the run's signals come from
    """
    deadline = None
    poll = select.poll()
    for watched in (run, signals, *makes):
        poll.register(watched, select.POLLIN)
    while True:
        left = None if deadline is None else 1e3 * max(0.0, deadline - time.monotonic())
        ready = [watched for watched, _ in poll.poll(left)]
        if run in ready:
            return
        if deadline is not None and time.monotonic() >= deadline:
            _send(run, signal.SIGKILL)
        is_ending = False
        for watched in ready:
            if watched == signals:
                arrived = os.read(signals, 4096)
                is_ending |= signal.SIGTERM in arrived
                if arrived:
                    continue
            else:
                _send(run, signal.SIGTERM)
            poll.unregister(watched)
        if is_ending and deadline is None:
            deadline = time.monotonic() + GRACE


def _send(process: int, number: int) -> None:
    with suppress(ProcessLookupError):
        signal.pidfd_send_signal(process, number)


def end_all(mark: bytes) -> None:
    """Kill every process whose environment has the mark, until none has it and none is ending.

    A process that is ending has no environment any more, but still its open files, and so the locks
    of its shared memory.
    """
    end = time.monotonic() + ENDING
    while time.monotonic() < end:
        processes = list(_marked_or_exiting(mark))
        if not processes:
            return
        for process, is_marked in processes:
            if is_marked:
                _send(process, signal.SIGKILL)
        # What a marked process has started meanwhile must not wait for the slowest to end.
        time.sleep(0.02)
        for process, _ in processes:
            os.close(process)


def _marked_or_exiting(mark: bytes) -> Iterator[tuple[int, bool]]:
    """Give a file descriptor of each process with the mark or that is ending, and if it has it."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            # Opened before it is looked at: its number may be another's afterwards.
            process = os.pidfd_open(int(folder.name))
        except OSError:
            continue
        is_marked = is_exiting = False
        with suppress(OSError):  # it is ending, or belongs to another user
            is_marked = mark in (folder / "environ").read_bytes()
        with suppress(OSError):  # it has ended
            flags = (folder / "stat").read_text().rpartition(")")[2].split()[6]
            is_exiting = bool(int(flags) & EXITING) and not select.select([process], [], [], 0.0)[0]
        if is_marked or is_exiting:
            yield process, is_marked
        else:
            os.close(process)


if __name__ == "__main__":
    main()
