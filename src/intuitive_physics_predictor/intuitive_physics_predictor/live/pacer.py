"""A thread that does something at a steady rate and leaves out what it comes too late for."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

LATEST = 0.5
"""Of a period, that a tick may begin late: one that took a little too long costs none of those that
take less."""


class Pacer:
    """Calls `tick` at whole periods, in a thread of its own.

    An executor's timer costs several times as much, and waits for every other callback.

    Parameters
    ----------
    tick : called with the s it comes late, up to half a period, and how many periods were left out
        before it because the one before took too long; must not raise
    rate : 1/s
    """

    def __init__(self, tick: Callable[[float, int], None], rate: float) -> None:
        self._tick = tick
        self._rate = rate
        self._changed = threading.Condition()
        self._stopping = False
        self._gap = threading.Condition()
        self._ended = self._waiting = 0
        self._free_until = math.inf
        self._thread = threading.Thread(target=self._run, name="pacer", daemon=True)

    def start(self) -> None:
        """Begin, with the first tick at once."""
        self._thread.start()

    def set_rate(self, rate: float) -> None:
        """Go on at another rate (1/s), with a tick at once."""
        with self._changed:
            self._rate = rate
            self._changed.notify()

    def stop(self) -> None:
        """End the thread once the tick under way is done."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join()

    def wait_for_gap(self, length: float, most: float) -> None:
        """Wait until a tick has just ended; not at all where the next one is far.

        Python runs one thread at a time: what another one does meanwhile delays a tick.

        Parameters
        ----------
        length : s before the next tick that make it far
        most : s to wait
        """
        with self._gap:
            ended = self._ended
            self._waiting += 1
            self._gap.wait_for(
                lambda: self._ended != ended or self._free_until - time.monotonic() >= length, most
            )
            self._waiting -= 1

    @property
    def is_awaited(self) -> bool:
        """Whether somebody waits for the tick under way to end."""
        return self._waiting > 0

    def _run(self) -> None:
        while not self._stopping:
            self._run_at(1.0 / self._rate)

    def _run_at(self, period: float) -> None:
        """Tick until the rate is changed or all is over."""
        start = time.monotonic()
        number = 0
        left_out = 0
        while not self._waited_until(start + number * period, period):
            self._free_until = -math.inf
            self._tick(time.monotonic() - start - number * period, left_out)
            behind = time.monotonic() - start - (number + 1) * period
            left_out = max(0, math.floor(behind / period - LATEST) + 1)
            number += 1 + left_out
            self._end_tick(start + number * period)

    def _end_tick(self, due: float) -> None:
        with self._gap:
            self._free_until = due
            self._ended += 1
            self._gap.notify_all()

    def _waited_until(self, due: float, period: float) -> bool:
        """Wait; answer whether something changed, so that what was waited for is not due."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._stopping or period != 1.0 / self._rate,
                max(0.0, due - time.monotonic()),
            )
