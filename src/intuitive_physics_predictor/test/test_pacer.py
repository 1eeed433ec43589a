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

    def start(ticks, rate, job_time=0.0):
        pacers.append(Pacer(ticks, rate, job_time))
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


def test_jobs_are_done_early_in_the_gap(paced):
    # Ticks of 30 ms that begin every 60 ms, and jobs that need 20 ms before the next one.
    ticks = Ticks(15, lambda number: time.sleep(0.03))
    pacer = paced(ticks, 1.0 / 0.06, job_time=0.02)
    begun = []

    def job():
        begun.append((time.monotonic() - ticks.due[0]) % 0.06)

    while not ticks.is_done():
        pacer.submit("job", job)
        assert pacer.wait_for_jobs(1.0)
        time.sleep(0.003)
    # From the end of a tick up to 20 ms before the next one; a busy machine may wake it late.
    assert len(begun) > 15
    in_time = (np.array(begun) > 0.025) & (np.array(begun) < 0.045)
    assert in_time.mean() > 0.8


def test_jobs_are_done_where_ticks_leave_no_room(paced):
    # A tick every 5 ms; a job wants 20 ms before the next one, so it is done right after a tick.
    pacer = paced(Ticks(1000), 200.0, job_time=0.02)
    done = []
    pacer.submit("job", lambda: done.append(True))
    assert pacer.wait_for_jobs(10.0)
    assert done == [True]


def test_waiting_for_jobs_is_limited(paced):
    begun, end = threading.Event(), threading.Event()

    def work(number):
        begun.set()
        end.wait(20.0)

    pacer = paced(Ticks(1, work), 20.0)
    assert begun.wait(20.0)
    pacer.submit("job", lambda: None)
    start = time.monotonic()
    assert not pacer.wait_for_jobs(0.05)
    assert 0.04 < time.monotonic() - start < 10.0
    end.set()
    assert pacer.wait_for_jobs(10.0)


def test_only_the_newest_job_of_a_key_is_done_and_a_tick_knows_that_it_waits():
    begun, waiting, done = threading.Event(), [], []

    def work(number):
        waiting.append(pacer.has_jobs)
        begun.set()
        deadline = time.monotonic() + 20.0
        while not submitted.is_set() and time.monotonic() < deadline:
            time.sleep(0.001)
        waiting.append(pacer.has_jobs)

    submitted = threading.Event()
    pacer = Pacer(Ticks(1, work), 1.0)
    pacer.start()
    assert begun.wait(20.0)
    for number in range(3):
        pacer.submit("a", lambda number=number: done.append(("a", number)))
    pacer.submit("b", lambda: done.append(("b", 0)))
    submitted.set()
    assert pacer.wait_for_jobs(20.0)
    pacer.stop()
    assert waiting == [False, True]
    assert done == [("a", 2), ("b", 0)]
    assert not pacer.has_jobs


def test_ticks_that_a_long_job_covers_are_left_out(paced):
    # At 20 a second, a job of 0.14 s right after the second tick covers the two after it.
    def work(number):
        if number == 2:
            pacer.submit("long", lambda: time.sleep(0.14))

    ticks = Ticks(4, work)
    pacer = paced(ticks, 20.0)
    ticks.wait()
    assert ticks.left_out[:2] == [0, 0]
    assert ticks.left_out[2] >= 2
    assert ticks.due[2] - ticks.due[1] == pytest.approx((1 + ticks.left_out[2]) / 20.0, abs=0.005)


def test_jobs_given_before_the_start_are_done_before_the_first_tick():
    order = []
    ticks = Ticks(1, lambda number: order.append("tick"))
    pacer = Pacer(ticks, 1.0)
    pacer.submit("job", lambda: order.append("job"))
    assert not pacer.wait_for_jobs(0.01)
    pacer.start()
    ticks.wait()
    pacer.stop()
    assert order == ["job", "tick"]


def test_many_threads_lose_no_newest_job(paced):
    # Each of eight threads submits 200 numbered jobs under its own key: the last of each is done,
    # and those done of a key are in order.
    done = {key: [] for key in range(8)}
    pacer = paced(Ticks(10**6), 1000.0)

    def submit(key):
        for number in range(200):
            pacer.submit(key, lambda number=number: done[key].append(number))

    threads = [threading.Thread(target=submit, args=(key,)) for key in done]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert pacer.wait_for_jobs(20.0)
    for numbers in done.values():
        assert numbers[-1] == 199
        assert numbers == sorted(numbers)


def test_what_never_started_can_be_stopped():
    Pacer(Ticks(1), 1.0).stop()
