"""A thread that ticks at a steady rate, skips what it is late for, and works in between."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable

LATEST_START = 0.5
"""Of a period, that a tick may begin late: one that took a little too long costs no later ones."""

Job = Callable[[], None]


class Pacer:
    """Calls `tick` at whole periods in a thread of its own, and does jobs in the gaps between.

    Python runs one thread at a time, so what another thread does delays a tick. A job given to
    this thread is done right after a tick, or before the next one where enough time is left.
    An executor's timer costs several times as much, and waits for every other callback.

    Parameters
    ----------
    tick : called with the s it comes late, up to half a period, and how many periods were left out
        before it because the work before took too long; must not raise
    rate : 1/s
    job_time : s before the next tick in which no job is begun
    """

    def __init__(
        self, tick: Callable[[float, int], None], rate: float, job_time: float = 0.0
    ) -> None:
        self._tick = tick
        self._rate = rate
        self._job_time = job_time
        self._changed = threading.Condition()
        self._stopping = False
        self._jobs: dict[Hashable, Job] = {}
        self._working = False
        self._thread = threading.Thread(target=self._run, name="pacer", daemon=True)

    def start(self) -> None:
        """Begin: jobs that wait, then the first tick at once."""
        self._thread.start()

    def set_rate(self, rate: float) -> None:
        """Go on at another rate (1/s), with a tick at once."""
        with self._changed:
            self._rate = rate
            self._changed.notify_all()

    def stop(self) -> None:
        """End the thread once the tick or job under way is done; jobs that wait are left out."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def submit(self, key: Hashable, job: Job) -> None:
        """Have a job done in the next gap, instead of one of the same key that was not begun yet.

        Parameters
        ----------
        job : must not raise
        """
        with self._changed:
            self._jobs[key] = job
            self._changed.notify_all()

    def wait_for_jobs(self, longest: float) -> bool:
        """Wait until no job waits or is under way, `longest` s at most; whether it is so."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._jobs or self._working), longest)

    @property
    def has_jobs(self) -> bool:
        """Whether a job waits."""
        return bool(self._jobs)

    def _run(self) -> None:
        self._do_jobs()
        while not self._stopping:
            self._run_at(1.0 / self._rate)

    def _run_at(self, period: float) -> None:
        """Tick until the rate is changed or the thread is to end."""
        due = time.monotonic()
        left_out = 0
        while not self._stopping and period == 1.0 / self._rate:
            # Work that ended long after the next tick was due covers the ticks in between.
            missed = max(0, math.floor((time.monotonic() - due) / period - LATEST_START) + 1)
            left_out += missed
            due += missed * period
            if self._gap_ended(due, period):
                self._tick(time.monotonic() - due, left_out)
                left_out = 0
                due += period
                self._do_jobs()

    def _gap_ended(self, due: float, period: float) -> bool:
        """Wait for a tick; False: something else was done first, so look at the clock again."""
        with self._changed:
            while not (self._stopping or period != 1.0 / self._rate):
                left = due - time.monotonic()
                if left <= 0.0:
                    return True
                may_work = left > self._job_time
                if self._jobs and may_work:
                    break
                # A job may be begun until shortly before the tick.
                self._changed.wait(left - self._job_time if may_work else left)
            else:
                return False
        self._do_jobs()
        return False

    def _do_jobs(self) -> None:
        """Do each job that waits now; what comes meanwhile waits for the next gap."""
        with self._changed:
            jobs, self._jobs = self._jobs, {}
            self._working = bool(jobs)
        for job in jobs.values():
            if not self._stopping:
                job()
        if jobs:
            with self._changed:
                self._working = False
                self._changed.notify_all()
