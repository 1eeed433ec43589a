"""Sharing the worlds of a batch among threads, each with scratch memory of its own."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
Room = TypeVar("Room")

PIECES = 2
"""Shares of what is left for each thread: worlds differ in cost."""

MOST_HELPERS = max(1, (os.cpu_count() or 1) - 1)
"""Threads of all batches together beside those that ask for them, one for each other core. Without
a free one the calling thread does the work: shares within shares would wait for each other."""


def run_in_shares(
    roll: Callable[[int, int], None], worlds: int, threads: int, smallest_share: int
) -> None:
    """Call `roll(first, last)` for contiguous shares of the worlds, in several threads.

    A thread that is done takes another share, so that none waits long for another one, be it for
    worlds that cost more or for a core that has other work.

    Parameters
    ----------
    roll : rolls out the worlds `first` to `last` (exclusive), without the GIL
    smallest_share : worlds for which another thread is worth its start
    """
    helpers = min(threads, worlds // smallest_share) - 1
    if helpers < 1:
        roll(0, worlds)
        return
    shares = _shares(worlds, PIECES * (helpers + 1), max(1, smallest_share // 2))
    work = [_helpers().submit(_roll_all, roll, shares) for _ in range(helpers)]
    try:
        _roll_all(roll, shares)
    finally:
        shares.clear()
        # One that has not begun by now would find nothing left.
        begun = [task for task in work if not task.cancel()]
        for task in begun:
            task.exception()
    for task in begun:
        # Raises what a thread has raised.
        task.result()


def mapped_in_shares(
    function: Callable[[Item], Result], items: Sequence[Item], threads: int
) -> list[Result]:
    """Return what a function returns for each item, which several threads work through.

    `function` spends most of its time without the GIL, and each item is worth another thread.
    """
    results: dict[int, Result] = {}

    def work_through(first: int, last: int) -> None:
        for index in range(first, last):
            results[index] = function(items[index])

    run_in_shares(work_through, len(items), threads, 1)
    return [results[index] for index in range(len(items))]


class ThreadScratch(Generic[Room]):
    """Keeps one room for each thread, and makes another only for batches of another size.

    Parameters
    ----------
    make : makes a room of given sizes
    """

    def __init__(self, make: Callable[..., Room]) -> None:
        self._make = make
        self._kept = threading.local()

    def of_size(self, *sizes: int) -> Room:
        """Return this thread's room of these sizes, with whatever was written into it last."""
        if getattr(self._kept, "sizes", None) != sizes:
            self._kept.room, self._kept.sizes = self._make(*sizes), sizes
        room: Room = self._kept.room
        return room


def _shares(worlds: int, parts: int, smallest: int) -> deque[tuple[int, int]]:
    """Return ranges of worlds (first, last exclusive), smaller ones towards the end."""
    shares: deque[tuple[int, int]] = deque()
    first = 0
    while first < worlds:
        left = worlds - first
        last = first + min(left, max(smallest, left // parts))
        shares.append((first, last))
        first = last
    return shares


def _roll_all(roll: Callable[[int, int], None], shares: deque[tuple[int, int]]) -> None:
    """Roll out the shares that no other thread takes."""
    while True:
        try:
            share = shares.popleft()
        except IndexError:
            return
        roll(*share)


_pools: list[ThreadPoolExecutor] = []
_making = threading.Lock()


def _helpers() -> ThreadPoolExecutor:
    """Return this process's threads, which are made as they are needed and kept."""
    with _making:
        if not _pools:
            _pools.append(ThreadPoolExecutor(MOST_HELPERS, thread_name_prefix="simulation"))
        return _pools[0]


def _forget_helpers() -> None:
    """Let a forked process, which has none of its parent's threads, make its own."""
    global _making
    _pools.clear()
    _making = threading.Lock()


os.register_at_fork(after_in_child=_forget_helpers)
