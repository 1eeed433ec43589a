"""Room for a kernel, which a thread keeps from one batch to the next."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Room = TypeVar("Room")


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
