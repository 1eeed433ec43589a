"""Threads beside a node: long work of its callbacks, and how they are woken."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.task import Future


class Background:
    """Does one piece of work after the other in a thread of its own.

    Parameters
    ----------
    node : whose callbacks wait for it; they have to be of a `ReentrantCallbackGroup`, else others
        of their group wait with them
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="background")

    async def run(self, work: Callable[[], Any]) -> Any:
        """Await this in an `async` callback: what `work()` answers or raises."""
        done = Future()
        work_under_way = self._pool.submit(work)
        work_under_way.add_done_callback(lambda _: _complete(done, self._node))
        await done
        return work_under_way.result()

    def stop(self) -> None:
        """Wait for the work under way; what waits is left out."""
        self._pool.shutdown(cancel_futures=True)


class WorkerSignal:
    """Lets callbacks of a node wait, without blocking it, for what happens in another thread."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._future = Future()

    def next(self) -> Future:
        """Return what to await; take it before looking at the state that may change."""
        return self._future

    def set(self) -> None:
        """Wake all that wait; from any thread."""
        happened, self._future = self._future, Future()
        _complete(happened, self._node)


def _complete(future: Future, node: Node) -> None:
    """Set a future's result, from any thread, and wake the callbacks that await it."""
    future.set_result(None)
    executor = node.executor
    if executor is not None:
        # An executor that is just shutting down has nobody left to wake.
        with suppress(InvalidHandle):
            executor.wake()
