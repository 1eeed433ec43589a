"""Monitors of a node: its inputs arrive and are valid, and its work keeps up with its rate."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from rclpy.node import Node

from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.silence import Silence

REPEAT_AFTER = 10.0
"""Seconds after which the same complaint about an input is logged again."""

BURST = 5
"""Lines that an input may log at once; after that one a second."""


class InputMonitor:
    """Counts what arrives on one input; give `check` to `Diagnostics.add`.

    A complaint is logged when it is new and then at most every 10 s, and after a few lines nothing
    more often than once a second: a sensor that is wrong 30 times a second, and each time in
    another way, does not fill the log.

    Parameters
    ----------
    node : into whose log complaints go
    name : of the input, as its users know it, such as its topic
    timeout : s of real time without input after which it counts as lost; None: it may come once
        only, as latched topics do
    """

    def __init__(self, node: Node, name: str, timeout: float | None) -> None:
        self._node = node
        self._name = name
        self._timeout = timeout
        self._accepted = 0
        self._rejected = 0
        self._arrived_at: float | None = None
        self._silence: Silence | None = None
        self._error = ""
        self._logged = ""
        self._logged_at = 0.0
        self._lines, self._lines_at = float(BURST), time.monotonic()
        self._lost = False
        self._checked_at = time.monotonic()
        self._checked_count = 0

    def expect(self, silence: Silence) -> None:
        """Have publishers looked for from now on, as long as nothing has ever arrived."""
        self._silence = silence

    def accepted(self) -> None:
        """Take note of a good message."""
        self._accepted += 1
        self._arrived()
        self._error = ""
        if self._logged and self._may_log():
            self._node.get_logger().info(f"{self._name} is good again")
            self._logged = ""

    def rejected(self, error: Exception | str) -> None:
        """Take note of a message that could not be used and log why."""
        self._rejected += 1
        self._arrived()
        self._error, now = str(error), time.monotonic()
        is_new = self._error != self._logged or now - self._logged_at > REPEAT_AFTER
        if is_new and self._may_log():
            self._node.get_logger().error(f"{self._name} rejected: {self._error}")
            self._logged, self._logged_at = self._error, now

    def _may_log(self) -> bool:
        """Whether a line may be logged now, and count it."""
        now = time.monotonic()
        self._lines = min(self._lines + now - self._lines_at, float(BURST))
        self._lines_at = now
        if self._lines < 1.0:
            return False
        self._lines -= 1.0
        return True

    def check(self) -> Status:
        """Say how the input does; logs when it is lost."""
        now = time.monotonic()
        rate = (self._accepted - self._checked_count) / max(now - self._checked_at, 1e-3)
        self._checked_at, self._checked_count = now, self._accepted
        values = {
            "accepted": self._accepted,
            "rejected": self._rejected,
            "accepted per second": f"{rate:.1f}",
        }
        if self._arrived_at is None:
            report = self._silence.report() if self._silence else ""
            return Status(Level.WARN, report or f"nothing arrived yet on {self._name}", values)
        silence = now - self._arrived_at
        if self._timeout is not None and silence > self._timeout:
            if not self._lost:
                self._node.get_logger().warning(f"nothing arrives on {self._name} any more")
            self._lost = True
            return Status(
                Level.ERROR, f"nothing arrived on {self._name} for {silence:.0f} s", values
            )
        if self._error:
            return Status(Level.ERROR, f"{self._name} rejected: {self._error}", values)
        return Status(Level.OK, f"{self._name} arrives", values)

    def _arrived(self) -> None:
        self._arrived_at = time.monotonic()
        if self._silence is not None:
            self._silence.end()
        if self._lost:
            self._node.get_logger().info(f"{self._name} arrives again")
        self._lost = False


@dataclass
class _Counts:
    """Counts since the last check: s from tick to done of each, ticks without work, and periods
    left out."""

    seconds: list[float] = field(default_factory=list)
    idle: int = 0
    left_out: int = 0


class RateMonitor:
    """Counts what is done at a rate; give `check` to `Diagnostics.add`.

    One thread may count while another checks.

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
        self._is_normal = False
        self._checked_at = time.monotonic()

    def done(self, seconds: float) -> None:
        """Take note that it was done, and how long after it was due."""
        self._counts.seconds.append(seconds)
        self._idle_reason = ""

    def left_out(self, count: int) -> None:
        """Take note of times it was left out, because the one before took too long."""
        self._counts.left_out += count

    def idle(self, reason: str, *, normal: bool = False) -> None:
        """Take note that there was nothing to do, and why.

        Parameters
        ----------
        reason : in a sentence
        normal : whether nobody needs to look into it
        """
        self._counts.idle += 1
        self._idle_reason, self._is_normal = reason, normal

    def check(self) -> Status:
        """Return the status and restart the counts, except the sum of what was left out.

        The rate is that of the time in which there was something to do.
        """
        counts, self._counts = self._counts, _Counts()
        now = time.monotonic()
        ticks = len(counts.seconds) + counts.idle if counts.seconds else 0
        achieved = ticks / max(now - self._checked_at, 1e-3)
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
            level = Level.OK if self._is_normal else Level.WARN
            return Status(level, f"waits: {self._idle_reason}", values)
        sentence = f"{self._what} {achieved:.0f} times a second"
        if achieved < 0.9 * self.rate:
            return Status(
                Level.WARN,
                f"{sentence}; expected {self.rate:.0f}, {counts.left_out} were left out",
                values,
            )
        return Status(Level.OK, sentence, values)
