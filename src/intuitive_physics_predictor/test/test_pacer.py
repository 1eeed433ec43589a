"""A steady rate, and what is left out when a tick takes too long."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from intuitive_physics_predictor.live.pacer import Pacer


class Ticks:
    """Notes when each tick was due and what was left out before it, until there are enough."""

    def __init__(self, enough, work=lambda number: None):
        self.due, self.late, self.left_out = [], [], []
        self._enough, self._work = enough, work
        self._done = threading.Event()

    def __call__(self, late, left_out):
        self.due.append(time.monotonic() - late)
        self.late.append(late)
        self.left_out.append(left_out)
        self._work(len(self.due))
        if len(self.due) >= self._enough:
            self._done.set()

    def is_done(self):
        return self._done.is_set()

    def wait(self):
        assert self._done.wait(20.0)


@pytest.fixture
def paced():
    pacers = []

    def start(ticks, rate):
        pacers.append(Pacer(ticks, rate))
        pacers[-1].start()
        return pacers[-1]

    yield start
    for pacer in pacers:
        pacer.stop()


def test_ticks_are_due_at_whole_periods(paced):
    # When a tick is due does not depend on how late the ones before came: no drift.
    ticks = Ticks(40)
    paced(ticks, 200.0)
    ticks.wait()
    periods = np.diff(ticks.due[:40]) * 200.0
    np.testing.assert_allclose(periods, 1 + np.array(ticks.left_out[1:40]), atol=0.05)
    assert min(ticks.late) >= 0.0


def test_a_long_tick_leaves_out_those_it_covers(paced):
    # At 20 a second, a tick of 0.14 s covers the two after it: the second would begin 0.04 s late.
    ticks = Ticks(4, lambda number: time.sleep(0.14) if number == 2 else None)
    paced(ticks, 20.0)
    ticks.wait()
    assert ticks.left_out[:2] == [0, 0]
    # On a machine that is busy it may be later still, never earlier.
    assert ticks.left_out[2] >= 2
    assert ticks.due[2] - ticks.due[1] == pytest.approx((1 + ticks.left_out[2]) / 20.0, abs=0.005)


def test_a_tick_that_takes_a_little_too_long_delays_the_next_one_only(paced):
    # At 4 a second, one of 0.3 s ends 0.05 s after the next is due; 0.125 s are tolerated.
    ticks = Ticks(4, lambda number: time.sleep(0.3) if number == 2 else None)
    paced(ticks, 4.0)
    ticks.wait()
    assert ticks.left_out[2] == 0
    assert ticks.late[2] == pytest.approx(0.05, abs=0.04)
    assert ticks.late[3] < 0.04


def test_the_rate_may_change(paced):
    ticks = Ticks(12)
    pacer = paced(ticks, 0.1)
    while not ticks.due:
        time.sleep(0.01)
    pacer.set_rate(100.0)
    # At a tenth of a hertz twelve ticks would take 110 s.
    ticks.wait()


def test_it_stops_at_once_though_the_next_tick_is_far(paced):
    ticks = Ticks(1)
    pacer = paced(ticks, 0.1)
    ticks.wait()
    start = time.monotonic()
    pacer.stop()
    assert time.monotonic() - start < 5.0
    assert len(ticks.due) == 1


def test_who_waits_for_the_gap_begins_early_in_it(paced):
    # Ticks of 30 ms that begin every 60 ms, and a wish for 20 ms before the next one.
    ticks = Ticks(15, lambda number: time.sleep(0.03))
    pacer = paced(ticks, 1.0 / 0.06)
    begun = []
    while not ticks.is_done():
        pacer.wait_for_gap(0.02, 1.0)
        begun.append((time.monotonic() - ticks.due[0]) % 0.06)
        time.sleep(0.007)
    # From the end of a tick up to 20 ms before the next one; a busy machine may wake it late.
    assert len(begun) > 15
    in_time = (np.array(begun) > 0.025) & (np.array(begun) < 0.045)
    assert in_time.mean() > 0.8


def test_who_waits_for_the_gap_waits_no_longer_than_told(paced):
    begun, end = threading.Event(), threading.Event()

    def work(number):
        begun.set()
        end.wait(20.0)

    pacer = paced(Ticks(1, work), 20.0)
    assert begun.wait(20.0)
    start = time.monotonic()
    pacer.wait_for_gap(0.001, 0.05)
    assert 0.04 < time.monotonic() - start < 10.0
    end.set()


def test_a_tick_can_tell_whether_somebody_waits_for_its_end():
    begun, told = threading.Event(), []

    def work(number):
        told.append(pacer.is_awaited)
        begun.set()
        deadline = time.monotonic() + 20.0
        while not pacer.is_awaited and time.monotonic() < deadline:
            time.sleep(0.001)
        told.append(pacer.is_awaited)

    pacer = Pacer(Ticks(1, work), 1.0)
    pacer.start()
    assert begun.wait(20.0)
    pacer.wait_for_gap(0.001, 20.0)
    pacer.stop()
    assert told == [False, True]
    assert not pacer.is_awaited


def test_without_ticks_all_is_gap():
    Pacer(Ticks(1), 20.0).wait_for_gap(0.01, 1e6)


def test_what_never_started_can_be_stopped():
    Pacer(Ticks(1), 1.0).stop()
