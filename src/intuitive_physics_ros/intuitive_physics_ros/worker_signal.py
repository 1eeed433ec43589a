"""How another thread wakes the callbacks of a node that wait for it."""

from __future__ import annotations

from contextlib import suppress

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.task import Future


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
        happened.set_result(None)
        executor = self._node.executor
        if executor is not None:
            # An executor that is just shutting down has nobody left to wake.
            with suppress(InvalidHandle):
                executor.wake()
