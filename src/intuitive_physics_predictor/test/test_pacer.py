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
    # A busy machine may take the processor between the two looks at the clock, now and then.
    assert np.median(np.abs(periods - 1 - np.array(ticks.left_out[1:40]))) < 0.05
    total = (ticks.due[39] - ticks.due[0]) * 200.0
    assert round(total) >= 39 + sum(ticks.left_out[1:40])
    assert min(ticks.late) >= 0.0


def test_a_long_tick_leaves_out_those_it_covers(paced):
    # At 20 a second, a tick of 0.14 s covers the two after it: the second would begin 0.04 s late.
    ticks = Ticks(4, lambda number: time.sleep(0.14) if number == 2 else None)
    paced(ticks, 20.0)
    ticks.wait()
    assert ticks.left_out[:2] == [0, 0]
    # On a machine that is busy it may be later still, never earlier.
    assert ticks.left_out[2] >= 2
    assert round(20.0 * (ticks.due[2] - ticks.due[1])) == 1 + ticks.left_out[2]


def test_a_tick_that_takes_a_little_too_long_delays_the_next_one_only(paced):
    # At 1 a second, one of 1.2 s ends 0.2 s after the next is due; 0.5 s are tolerated.
    ticks = Ticks(4, lambda number: time.sleep(1.2) if number == 2 else None)
    paced(ticks, 1.0)
    ticks.wait()
    assert ticks.left_out[2] == 0
    assert 0.19 < ticks.late[2] < 0.5
    assert ticks.late[3] < 0.19


def test_ticks_are_due_one_after_another_though_urgent_work_takes_long(paced):
    # Work of 2.3 periods ends 1.3 periods after the tick that it brings forward was due.
    ticks = Ticks(6)
    pacer = paced(ticks, 10.0)
    while not ticks.is_done():
        pacer.post(lambda: time.sleep(0.23), urgent=True)
        time.sleep(0.3)
    assert np.diff(ticks.due).min() > 0.0


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


def test_posted_work_begins_early_in_the_gap(paced):
    # Ticks of 90 ms that begin every 180 ms, and work that wants 5 ms before the next one.
    ticks = Ticks(15, lambda number: time.sleep(0.09))
    pacer = paced(ticks, 1.0 / 0.18)
    begun = []
    while not ticks.is_done():
        done = threading.Event()

        def work(done=done):
            begun.append((time.monotonic() - ticks.due[0]) % 0.18)
            done.set()

        pacer.post(work)
        assert done.wait(20.0)
        time.sleep(0.02)
    # From the end of a tick up to 5 ms before the next one; a busy machine may wake it late.
    assert len(begun) > 15
    in_time = np.array(begun) > 0.085
    assert in_time.mean() > 0.8


def test_ticks_work_and_rest_share_one_thread_in_order(paced):
    threads, done = [], []
    ticks = Ticks(1000, lambda number: threads.append(threading.get_ident()))
    pacer = Pacer(ticks, 500.0, lambda: threads.append(threading.get_ident()))
    pacer.start()

    def post(poster):
        for number in range(200):
            pacer.post(lambda number=number: done.append((poster, number, threading.get_ident())))
            time.sleep(1e-4)

    posters = [threading.Thread(target=post, args=(k,)) for k in range(4)]
    for poster in posters:
        poster.start()
    for poster in posters:
        poster.join()
    deadline = time.monotonic() + 20.0
    while len(done) < 800 and time.monotonic() < deadline:
        time.sleep(0.01)
    pacer.stop()
    assert len({*threads, *(thread for *_, thread in done)}) == 1
    for k in range(4):
        assert [number for poster, number, _ in done if poster == k] == list(range(200))


def test_work_is_done_after_each_tick_though_ticks_fill_all_time(paced):
    # Each tick takes more than a period: there is no gap but right after it.
    ticks = Ticks(8, lambda number: time.sleep(0.03))
    pacer = paced(ticks, 50.0)
    done = threading.Event()
    pacer.post(done.set)
    assert done.wait(20.0)


def test_rest_follows_each_tick_and_posted_work():
    calls = []
    rested = threading.Event()

    def rest():
        calls.append("rest")
        if "work" in calls:
            rested.set()

    pacer = Pacer(lambda late, left_out: calls.append("tick"), 0.1, rest)
    pacer.start()
    while "rest" not in calls:
        time.sleep(0.01)
    pacer.post(lambda: calls.append("work"))
    assert rested.wait(20.0)
    pacer.stop()
    assert calls[:4] == ["tick", "rest", "work", "rest"]


def test_what_never_started_can_be_stopped():
    Pacer(Ticks(1), 1.0).stop()


def test_posted_work_of_one_key_does_not_pile_up():
    begun, posted, done = threading.Event(), threading.Event(), []

    def work(number):
        begun.set()
        assert posted.wait(20.0)

    pacer = Pacer(Ticks(1, work), 1.0)
    pacer.start()
    assert begun.wait(20.0)
    for number in range(1000):
        pacer.post(lambda number=number: done.append(("states", number)), key="states")
    pacer.post(lambda: done.append("first"))
    pacer.post(lambda: done.append("second"))
    finished = threading.Event()
    pacer.post(finished.set)
    posted.set()
    assert finished.wait(20.0)
    pacer.stop()
    assert done == [("states", 999), "first", "second"]


def test_many_threads_lose_no_newest_work(paced):
    # Eight threads post 200 numbers each under a key of their own: the last of each is done, and
    # those done of one key are in order.
    done = {key: [] for key in range(8)}
    pacer = paced(Ticks(10**6), 1000.0)

    def post(key):
        for number in range(200):
            pacer.post(lambda number=number: done[key].append(number), key=key)

    threads = [threading.Thread(target=post, args=(key,)) for key in done]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    finished = threading.Event()
    pacer.post(finished.set)
    assert finished.wait(20.0)
    for numbers in done.values():
        assert numbers[-1] == 199
        assert numbers == sorted(numbers)


def test_a_tick_follows_urgent_work_at_once_and_the_next_ones_are_due_when_they_were(paced):
    # Two ticks a second, and work posted 0.1 s after one of them was due.
    ticks = Ticks(5)
    pacer = paced(ticks, 2.0)
    while len(ticks.due) < 2:
        time.sleep(0.001)
    first = ticks.due[1]
    time.sleep(max(0.0, first + 0.1 - time.monotonic()))
    done = []
    pacer.post(lambda: done.append(time.monotonic()), urgent=True)
    ticks.wait()
    since = np.array(ticks.due) - first
    # It takes the place of the tick at 0.5 s; a busy machine may begin it late.
    assert 0.0 < since[2] - (done[0] - first) < 0.15
    assert since[2] < 0.45
    np.testing.assert_allclose(since[3:5], [1.0, 1.5], atol=0.1)
    assert ticks.left_out[:5] == [0] * 5


@pytest.mark.parametrize(("before", "waits"), [(0.05, True), (0.11, False)])
def test_urgent_work_delays_a_tick_a_little_or_is_done_after_it(paced, before, waits):
    # Four ticks a second, which may be 0.3 × 0.25 s late; work takes 0.15 s and is posted some time
    # before a tick is due, which at once would make it 0.1 or 0.04 s late.
    ticks = Ticks(8)
    pacer = paced(ticks, 4.0)
    posted, begun = [], []

    def work():
        begun.append(time.monotonic())
        time.sleep(0.15)

    while not ticks.due:
        time.sleep(0.001)
    while len(begun) < 3:
        time.sleep((ticks.due[0] - before - time.monotonic()) % 0.25)
        count = len(begun)
        posted.append(time.monotonic())
        pacer.post(work, urgent=True)
        while len(begun) == count:
            time.sleep(0.001)
        time.sleep(0.4)
    ticks.wait()
    # How long it takes is known from the second time on.
    later = [late for due, late in zip(ticks.due, ticks.late, strict=True) if due > begun[0] + 0.3]
    assert max(later) < 0.08
    waited = np.subtract(begun, posted)[1:]
    assert (waited > 0.04).all() if waits else (waited < 0.04).all()


def test_urgent_work_that_is_not_done_brings_no_tick_forward(paced):
    # Two ticks a second; the work of 0.1 s after one of them is done in three steps.
    ticks = Ticks(5)
    pacer = paced(ticks, 2.0)
    while len(ticks.due) < 2:
        time.sleep(0.001)
    done = []

    def step():
        time.sleep(0.02)
        done.append(time.monotonic())
        if len(done) < 3:
            pacer.post(step, urgent=True)
            return False
        return True

    time.sleep(max(0.0, ticks.due[1] + 0.1 - time.monotonic()))
    pacer.post(step, urgent=True)
    ticks.wait()
    assert len(done) == 3
    assert 0.0 < ticks.due[2] - done[2] < 0.15


def test_urgent_work_makes_no_more_ticks(paced):
    # Posted ten times a period, it brings ticks forward by one period at most, not one for each.
    ticks = Ticks(1000)
    pacer = paced(ticks, 50.0)
    begun = time.monotonic()
    while time.monotonic() < begun + 1.0:
        pacer.post(lambda: None, urgent=True)
        time.sleep(0.002)
    pacer.stop()
    passed = time.monotonic() - begun
    assert len(ticks.due) + sum(ticks.left_out) <= 50.0 * passed + 2.0
    assert len(ticks.due) > 5
