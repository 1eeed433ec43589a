"""A thread that ticks at a steady rate, and does posted work in the gaps between its ticks."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable

LATEST = 0.5
"""Largest delay of a tick, in periods: a tick that took slightly too long makes the next one late
instead of leaving it out. Our choice."""

WORK_TIME = 5e-3
"""s before the next tick in which no posted work is begun any more; decoding an input takes less.
Measured with the predictor's inputs."""

DELAY = 0.3
"""Part of a period by which urgent work may delay the tick that follows on it: else it waits for
that tick, and the one after it is the first that is made of it. Our choice, so that a tick of half
a period still is over within a period of when it was due."""

REMEMBERED = 0.9
"""Part of the longest time that urgent work took by which it is shorter after the next one."""


class Pacer:
    """Calls `tick` at whole periods and posted work between two ticks, all in one thread.

    After each tick the work posted until then is done, then `rest` is called. Work posted later is
    done at once where the next tick is at least `WORK_TIME` away, else after that tick; `rest`
    follows. Urgent work is done at once where the next tick will not be late by more than `DELAY`
    periods, going by how long urgent work took lately, else right after that tick. The tick after
    it is made at once, without `rest` and at most a period early; later ones are due when they
    were. Urgent work that answers False has posted what is left of it, and brings no tick forward.

    So whatever ticks, work and `rest` share needs no lock. An executor's timer costs several times
    as much, and waits for every other callback.

    Parameters
    ----------
    tick : called with the delay of this tick, in s, up to half a period unless work delays it more,
        and the number of periods left out before it because the tick before took too long; must
        not raise
    rate : 1/s
    rest : called when all posted work is done; must not raise
    """

    def __init__(
        self,
        tick: Callable[[float, int], None],
        rate: float,
        rest: Callable[[], None] = lambda: None,
    ) -> None:
        self._tick = tick
        self._rest = rest
        self._rate = rate
        self._posted: dict[Hashable, Callable[[], bool | None]] = {}
        self._urgent = False
        self._urgent_time = 0.0
        self._stopping = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="pacer", daemon=True)

    def start(self) -> None:
        """Begin, with the first tick at once."""
        self._thread.start()

    def post(
        self, work: Callable[[], bool | None], key: Hashable = None, *, urgent: bool = False
    ) -> None:
        """Have work done in the next gap, in the order of the posts; any thread may call this.

        Parameters
        ----------
        work : must not raise
        key : work of the same key that was not begun yet is dropped, so that what comes faster
            than it can be done does not pile up; None: nothing is dropped
        urgent : whether the next tick is to follow at once
        """
        key = object() if key is None else key
        with self._changed:
            self._urgent |= urgent
            self._posted.pop(key, None)
            self._posted[key] = work
            self._changed.notify()

    def set_rate(self, rate: float) -> None:
        """Continue at another rate (1/s), with a tick at once; any thread may call this."""
        with self._changed:
            self._rate = rate
            self._changed.notify()

    def stop(self, patience: float | None = None) -> bool:
        """End the thread after the call under way; return whether it ends within `patience` s."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(patience)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._stopping:
            self._run_at(1.0 / self._rate)

    def _run_at(self, period: float) -> None:
        """Tick and work until the rate is changed or the thread stops."""
        start = time.monotonic()
        number = left_out = 0
        early = False
        while not self._is_over(period):
            due = start + number * period
            if self._wait_until(due - period if early else due, period):
                self._tick(max(0.0, time.monotonic() - due), left_out)
                behind = time.monotonic() - due - period
                left_out = max(0, math.floor(behind / period - LATEST) + 1)
                number += 1 + left_out
                early = False
            early |= self._work()

    def _wait_until(self, due: float, period: float) -> bool:
        """Wait for the tick; False where something else is to be done before it."""
        with self._changed:
            return not self._changed.wait_for(
                lambda: self._is_over(period) or self._may_work(due, period),
                max(0.0, due - time.monotonic()),
            )

    def _is_over(self, period: float) -> bool:
        return self._stopping or period != 1.0 / self._rate

    def _may_work(self, due: float, period: float) -> bool:
        needed = self._urgent_time - DELAY * period if self._urgent else WORK_TIME
        return bool(self._posted) and due - time.monotonic() >= needed

    def _work(self) -> bool:
        """Do what is posted; return whether any of it is urgent."""
        with self._changed:
            posted, self._posted = self._posted, {}
            urgent, self._urgent = self._urgent, False
        begun = time.monotonic()
        done = True
        for work in posted.values():
            if self._stopping:
                return urgent
            done &= work() is not False
        if urgent:
            took = time.monotonic() - begun
            self._urgent_time = max(took, REMEMBERED * self._urgent_time)
        elif not self._stopping:
            self._rest()
        return urgent and done
