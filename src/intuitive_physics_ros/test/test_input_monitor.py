"""What an input logs: every complaint once, and never a flood."""

from __future__ import annotations

import pytest

from intuitive_physics_ros.diagnostics import Level
from intuitive_physics_ros.monitors import BURST, REPEAT_AFTER, InputMonitor


class Log:
    """Stands for a node and its logger; keeps what is logged."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.info = self.warning = self.error = self.lines.append

    def get_logger(self) -> Log:
        return self


@pytest.fixture
def log() -> Log:
    return Log()


@pytest.fixture
def monitor(clock, log) -> InputMonitor:
    return InputMonitor(log, "~/input", 2.0)


def test_one_complaint_is_repeated_every_ten_seconds_only(monitor, clock, log) -> None:
    for _ in range(1000):
        monitor.rejected("it is broken")
        clock.now += 0.03
    assert len(log.lines) == 1 + int(30.0 / REPEAT_AFTER) - 1
    assert monitor.check().level is Level.ERROR


def test_complaints_that_differ_are_all_named_while_they_are_few(monitor, log) -> None:
    for k in range(BURST):
        monitor.rejected(f"reason {k}")
    assert [line[-1] for line in log.lines] == [str(k) for k in range(BURST)]


def test_complaints_that_always_differ_are_no_flood(monitor, clock, log) -> None:
    for k in range(1000):
        monitor.rejected(f"reason {k}")
        clock.now += 0.03
    assert BURST <= len(log.lines) <= BURST + 30


def test_input_that_is_good_again_is_logged(monitor, clock, log) -> None:
    monitor.rejected("it is broken")
    monitor.accepted()
    assert log.lines[-1] == "~/input is good again"
    assert monitor.check().level is Level.OK
    monitor.rejected("it is broken")
    assert len(log.lines) == 3
    for _ in range(500):
        clock.now += 0.03
        monitor.rejected("it is broken")
        monitor.accepted()
    assert len(log.lines) <= 3 + BURST + 15
