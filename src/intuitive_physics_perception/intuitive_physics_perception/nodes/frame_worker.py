"""Handles what arrives, one after the other, in a thread of its own."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class FrameWorker(Generic[Item]):
    """Calls `handle` for one item after the other in a thread of its own.

    Parameters
    ----------
    handle : called with each item; must not raise
    waiting : items that may wait; when more come the oldest is dropped
    idle : called in the same thread whenever nothing has come for `pause` s; must not raise
    """

    def __init__(
        self,
        handle: Callable[[Item], None],
        waiting: int = 3,
        *,
        idle: Callable[[], None] | None = None,
        pause: float | None = None,
    ) -> None:
        self.dropped = 0
        self._handle = handle
        self._idle, self._pause = idle, pause
        self._items: deque[Item] = deque()
        self._waiting = waiting
        self._changed = threading.Condition()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="frames", daemon=True)
        self._thread.start()

    def put(self, item: Item) -> None:
        """Hand over an item and return at once."""
        with self._changed:
            if len(self._items) == self._waiting:
                self._items.popleft()
                self.dropped += 1
            self._items.append(item)
            self._changed.notify()

    def stop(self, patience: float | None = None) -> bool:
        """End the thread once the item under way is done; those that wait are dropped.

        `patience` in s to wait for it at most; None: no limit. Returns whether it has ended.
        """
        with self._changed:
            self._stopping = True
            self._changed.notify()
        self._thread.join(patience)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                has_come = self._changed.wait_for(
                    lambda: self._stopping or self._items, self._pause
                )
                if self._stopping:
                    return
                item = self._items.popleft() if has_come else None
            if item is not None:
                self._handle(item)
            elif self._idle is not None:
                self._idle()
