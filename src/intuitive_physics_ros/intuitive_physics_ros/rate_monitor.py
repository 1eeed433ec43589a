"""Whether a timer keeps up with its rate."""

from __future__ import annotations

import time

from intuitive_physics_ros.diagnostics import Level, Status


class RateMonitor:
    """Counts what a timer's callback does; give `check` to `Diagnostics.add`.

    Parameters
    ----------
    what : the node does each time, as a verb ("predicts")
    rate : wanted, 1/s
    """

    def __init__(self, what: str, rate: float) -> None:
        self._what = what
        self._rate = rate
        self._done = 0
        self._late = 0
        self._longest = 0.0
        self._idle_reason = "not started yet"
        self._checked_at = time.monotonic()

    def done(self, seconds: float) -> None:
        """Take note that it was done and how long it took."""
        self._done += 1
        self._late += seconds > 1.0 / self._rate
        self._longest = max(self._longest, seconds)
        self._idle_reason = ""

    def idle(self, reason: str) -> None:
        """Take note that there was nothing to do, and why."""
        self._idle_reason = reason

    def check(self) -> Status:
        """Say how it does; the counts start anew."""
        now = time.monotonic()
        achieved = self._done / max(now - self._checked_at, 1e-3)
        values = {
            "achieved per second": f"{achieved:.1f}",
            "took longer than the period": self._late,
            "longest (ms)": f"{1e3 * self._longest:.1f}",
        }
        self._checked_at, self._done, self._late, self._longest = now, 0, 0, 0.0
        if self._idle_reason:
            return Status(Level.WARN, f"waits: {self._idle_reason}", values)
        sentence = f"{self._what} {achieved:.0f} times a second"
        if achieved < 0.9 * self._rate:
            return Status(Level.WARN, f"{sentence}; expected {self._rate:.0f}", values)
        return Status(Level.OK, sentence, values)
