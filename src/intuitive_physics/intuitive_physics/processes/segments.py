"""Abandoned shared memory of Fast DDS: segments that no process holds.

Each participant has segments of some megabytes in /dev/shm, and beside each a file whose lock its
process holds for as long as it lives. A process that is killed leaves both; nobody removes them.

As a program (`python3 segments.py`) it removes all of the machine's that are left, and says how
much that was.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

FOLDER = Path("/dev/shm")
"""Folder in which Linux keeps shared memory."""

SETTLED = 10.0
"""s after which a segment whose lock nobody holds is not one whose process is about to take it."""

SEGMENT = re.compile(r"fastrtps_[0-9a-f]{16}")
"""Names of segments, drawn by chance."""

PORT = re.compile(r"fastrtps_port\d+")
"""Names of ports, which come again."""


def remove_abandoned_segments(*, ports: bool = False, settled: float = SETTLED) -> int:
    """Remove this user's segments that no process holds, and return their size.

    Parameters
    ----------
    ports : whether to remove ports too. Their names are used again, so that a node that starts at
        this moment on the same port would not be heard; their size is 50 kB each
    settled : s since which a segment has to be there

    Returns
    -------
    bytes that are free again
    """
    freed = 0
    for segment in FOLDER.glob("fastrtps_*"):
        if not (SEGMENT.fullmatch(segment.name) or (ports and PORT.fullmatch(segment.name))):
            continue
        with suppress(OSError), _abandoned(segment, settled) as files:
            for file in files:
                freed += file.stat().st_size
                file.unlink()
    return freed


@contextmanager
def _abandoned(segment: Path, settled: float) -> Iterator[list[Path]]:
    """Hold the lock of a segment, and give the files that belong to it; none if it is in use.

    The lock is made before its segment. One segment has none: that by which a participant that
    starts measures what an allocation takes, for a millisecond.
    """
    lock = segment.with_name(f"{segment.name}_el")
    mutex = segment.with_name(f"sem.{segment.name}_mutex")
    try:
        status = lock.stat()
    except FileNotFoundError:
        status = segment.stat()
    if status.st_uid != os.getuid() or time.time() - status.st_mtime < settled:
        yield []
        return
    with ExitStack() as held:
        if lock.exists():
            try:
                fcntl.flock(held.enter_context(lock.open()), fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield []
                return
        yield [file for file in (segment, mutex, lock) if file.exists()]


if __name__ == "__main__":
    print(f"{remove_abandoned_segments(ports=True) / 1e6:.0f} MB of shared memory removed")
