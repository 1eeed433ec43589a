"""Whether what a node does again and again keeps up with its rate."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from intuitive_physics_ros.diagnostics import Level, Status


@dataclass
class _Counts:
    """What happened since the last check: s from tick to done of each, and periods left out."""

    seconds: list[float] = field(default_factory=list)
    left_out: int = 0


class RateMonitor:
    """Counts what is done at a rate; give `check` to `Diagnostics.add`.

    One thread may tell it while another checks.

    Parameters
    ----------
    what : the node does each time, as a verb ("predicts")
    rate : wanted, 1/s; may be changed
    """

    def __init__(self, what: str, rate: float) -> None:
        self.rate = rate
        self._what = what
        self._counts = _Counts()
        self._left_out = 0
        self._idle_reason = "not started yet"
        self._checked_at = time.monotonic()

    def done(self, seconds: float) -> None:
        """Take note that it was done, and how long after it was due."""
        self._counts.seconds.append(seconds)
        self._idle_reason = ""

    def left_out(self, count: int) -> None:
        """Take note of times it was left out, because the one before took too long."""
        self._counts.left_out += count

    def idle(self, reason: str) -> None:
        """Take note that there was nothing to do, and why."""
        self._idle_reason = reason

    def check(self) -> Status:
        """Return the status and restart the counts, except the sum of what was left out."""
        counts, self._counts = self._counts, _Counts()
        now = time.monotonic()
        achieved = len(counts.seconds) / max(now - self._checked_at, 1e-3)
        self._checked_at = now
        self._left_out += counts.left_out
        values = {
            "achieved per second": f"{achieved:.1f}",
            "left out": counts.left_out,
            "left out since the start": self._left_out,
        }
        if counts.seconds:
            median, most, longest = 1e3 * np.quantile(counts.seconds, [0.5, 0.99, 1.0])
            values["median (ms)"] = f"{median:.2f}"
            values["99 % (ms)"] = f"{most:.2f}"
            values["longest (ms)"] = f"{longest:.2f}"
        if self._idle_reason:
            return Status(Level.WARN, f"waits: {self._idle_reason}", values)
        sentence = f"{self._what} {achieved:.0f} times a second"
        if achieved < 0.9 * self.rate:
            return Status(
                Level.WARN,
                f"{sentence}; expected {self.rate:.0f}, {counts.left_out} were left out",
                values,
            )
        return Status(Level.OK, sentence, values)
