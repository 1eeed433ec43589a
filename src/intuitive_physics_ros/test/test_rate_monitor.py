"""What is said of work that is done at a rate."""

import time

from intuitive_physics_ros.diagnostics import Level
from intuitive_physics_ros.monitors import RateMonitor


def counted(monitor, seconds, rate):
    """Report work at a rate for so long, or longer where the machine is busy."""
    monitor.check()
    begun = time.monotonic()
    time.sleep(seconds)
    for _ in range(round((time.monotonic() - begun) * rate)):
        monitor.done(0.002)


def test_before_the_first_and_while_it_waits_it_says_so():
    monitor = RateMonitor("predicts", 100.0)
    assert monitor.check().message == "waits: not started yet"
    monitor.idle("the states are too old")
    status = monitor.check()
    assert (status.level, status.message) == (Level.WARN, "waits: the states are too old")
    monitor.idle("no objects are seen", normal=True)
    status = monitor.check()
    assert (status.level, status.message) == (Level.OK, "waits: no objects are seen")


def test_the_rate_kept_is_ok_and_the_rate_missed_a_warning():
    monitor = RateMonitor("predicts", 100.0)
    counted(monitor, 0.2, 100.0 * 2)
    status = monitor.check()
    assert status.level is Level.OK
    assert status.values["99 % (ms)"] == "2.00"
    counted(monitor, 0.2, 100.0 / 2)
    monitor.left_out(7)
    status = monitor.check()
    assert status.level is Level.WARN
    assert "expected 100, 7 were left out" in status.message


def test_ticks_without_anything_to_do_miss_no_rate():
    monitor = RateMonitor("predicts", 100.0)
    counted(monitor, 0.2, 100.0 / 2)
    for _ in range(10):
        monitor.idle("no objects are seen", normal=True)
    monitor.done(0.002)
    assert monitor.check().level is Level.OK


def test_what_was_left_out_is_counted_since_the_start():
    monitor = RateMonitor("predicts", 100.0)
    for count in (3, 0, 4):
        monitor.left_out(count)
        values = monitor.check().values
        assert values["left out"] == count
    assert values["left out since the start"] == 7
