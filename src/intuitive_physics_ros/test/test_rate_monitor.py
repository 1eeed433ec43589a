"""What is said of work that is done at a rate."""

from intuitive_physics_ros.diagnostics import Level
from intuitive_physics_ros.monitors import RateMonitor


def work(monitor, clock, rate):
    """Report work at a rate (1/s) for a second."""
    monitor.check()
    clock.now += 1.0
    for _ in range(rate):
        monitor.done(0.002)


def test_waiting_is_reported_with_its_reason():
    monitor = RateMonitor("predicts", 100.0)
    assert monitor.check().message == "waits: not started yet"
    monitor.idle("the states are too old")
    status = monitor.check()
    assert (status.level, status.message) == (Level.WARN, "waits: the states are too old")
    monitor.idle("no objects are seen", normal=True)
    status = monitor.check()
    assert (status.level, status.message) == (Level.OK, "waits: no objects are seen")


def test_the_rate_kept_is_ok_and_the_rate_missed_a_warning(clock):
    monitor = RateMonitor("predicts", 100.0)
    work(monitor, clock, 90)
    status = monitor.check()
    assert status.level is Level.OK
    assert status.values["99 % (ms)"] == "2.00"
    work(monitor, clock, 89)
    monitor.left_out(7)
    status = monitor.check()
    assert status.level is Level.WARN
    assert "expected 100, 7 were left out" in status.message


def test_ticks_without_anything_to_do_miss_no_rate(clock):
    monitor = RateMonitor("predicts", 100.0)
    work(monitor, clock, 50)
    for _ in range(50):
        monitor.idle("no objects are seen", normal=True)
    monitor.done(0.002)
    assert monitor.check().level is Level.OK


def test_left_out_ticks_are_counted_since_the_start():
    monitor = RateMonitor("predicts", 100.0)
    for count in (3, 0, 4):
        monitor.left_out(count)
        values = monitor.check().values
        assert values["left out"] == count
    assert values["left out since the start"] == 7
