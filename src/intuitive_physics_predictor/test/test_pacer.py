"""A steady rate, work in the gaps between ticks, and what is left out when a tick takes too long.

When something is done is tried on a simulated clock: no time of a test depends on the machine.
"""

from __future__ import annotations

import threading
import time
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_predictor.live import pacer as pacer_module
from intuitive_physics_predictor.live.pacer import LATEST, WORK_TIME, Pacer


class SimulatedTime:
    """Clock and condition of a pacer in one thread: waiting and working move the time, in s."""

    def __init__(self):
        self.now = 0.0
        self._events = []

    def monotonic(self):
        return self.now

    def at(self, when, event):
        """Call `event` at a time, as another thread would."""
        self._events.append((when, event))
        self._events.sort(key=lambda pair: pair[0])

    def spend(self, seconds):
        """Let the time go on while something is done."""
        end = self.now + seconds
        while self._happens_until(end):
            pass
        self.now = end

    def wait_for(self, predicate, timeout):
        end = self.now + timeout
        while not predicate():
            if not self._happens_until(end):
                self.now = end
                return predicate()
        return True

    def _happens_until(self, end):
        """Let the next event happen, unless it is later than `end`; return whether it did."""
        if not self._events or self._events[0][0] > end:
            return False
        when, event = self._events.pop(0)
        self.now = max(self.now, when)
        event()
        return True

    def notify(self):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


class Stage:
    """A pacer on a simulated clock, and when its ticks began.

    Parameters
    ----------
    rate : 1/s
    durations : s that the first ticks take; later ones take no time
    """

    def __init__(self, rate, durations=(), rest=lambda: None):
        self.clock = SimulatedTime()
        self.begun, self.late, self.left_out = [], [], []
        self._durations = durations
        self.pacer = Pacer(self._tick, rate, rest)
        self.pacer._changed = self.clock

    def _tick(self, late, left_out):
        self.begun.append(self.clock.now)
        self.late.append(late)
        self.left_out.append(left_out)
        number = len(self.begun) - 1
        if number < len(self._durations):
            self.clock.spend(self._durations[number])

    @property
    def due(self):
        """Times at which the ticks were due; of an early one, when it began."""
        return np.subtract(self.begun, self.late)

    def post(self, when, work, *, urgent=False):
        """Post work from outside at a time."""
        self.clock.at(when, lambda: self.pacer.post(work, urgent=urgent))

    def run(self, seconds):
        """Run the pacer for a time."""
        self.clock.at(seconds, self.pacer.stop)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(pacer_module, "time", self.clock)
            self.pacer._run()
        return self


@given(st.lists(st.floats(0.0, 0.8), min_size=5, max_size=20))
def test_ticks_are_due_at_whole_periods_whatever_they_take(durations):
    # Four ticks a second: durations of up to 3.2 periods.
    stage = Stage(4.0, durations).run(5.0)
    periods = np.diff(stage.due) / 0.25
    np.testing.assert_allclose(periods, 1 + np.array(stage.left_out[1:]), atol=1e-9)
    assert min(stage.late) >= 0.0
    assert max(stage.late) <= LATEST * 0.25 + 1e-9


@pytest.mark.parametrize(
    ("duration", "left_out", "late"), [(0.5, 0, 0.0), (1.2, 0, 0.2), (1.6, 1, 0.0), (2.8, 2, 0.0)]
)
def test_long_tick_delays_the_next_one_or_leaves_out_those_it_covers(duration, left_out, late):
    # Numbers of periods: up to half a period of delay is tolerated.
    stage = Stage(1.0, [duration]).run(6.0)
    assert stage.left_out[:3] == [0, left_out, 0]
    assert stage.late[:3] == pytest.approx([0.0, late, 0.0])


def test_ticks_keep_their_order_though_urgent_work_takes_long():
    # Work of 2.3 periods ends 1.3 periods after the tick that it brings forward was due.
    stage = Stage(10.0)
    for number in range(10):
        stage.post(0.05 + 0.3 * number, lambda: stage.clock.spend(0.23), urgent=True)
    stage.run(4.0)
    assert np.diff(stage.due).min() > 0.0


def test_rate_may_change_with_a_tick_at_once():
    stage = Stage(0.1)
    stage.clock.at(3.0, lambda: stage.pacer.set_rate(100.0))
    stage.run(3.055)
    assert stage.begun == pytest.approx([0.0, *(3.0 + 0.01 * np.arange(6))])


@pytest.mark.parametrize(
    ("posted", "begun"),
    [(0.02, 0.09), (0.1, 0.1), (0.17, 0.17), (0.18 - 0.9 * WORK_TIME, 0.27)],
    ids=["during a tick", "in the gap", "late in the gap", "just before a tick"],
)
def test_posted_work_begins_as_early_in_the_gap_as_ticks_allow(posted, begun):
    # Ticks of 90 ms that begin every 180 ms.
    stage, times = Stage(1.0 / 0.18, [0.09] * 10), []
    stage.post(posted, lambda: times.append(stage.clock.now))
    stage.run(1.0)
    assert times == pytest.approx([begun])
    assert max(stage.late) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("posted", "begun"), [(0.04, 0.056), (0.057, 0.088)])
def test_posted_work_is_done_though_ticks_fill_all_time(posted, begun):
    # Ticks of 1.4 periods: between two of them is no time or 4 ms, less than work may need.
    stage, times = Stage(50.0, [0.028] * 50), []
    stage.post(posted, lambda: times.append(stage.clock.now))
    stage.run(0.5)
    assert times == pytest.approx([begun])


def test_rest_follows_each_tick_and_posted_work():
    calls = []
    stage = Stage(0.1, rest=lambda: calls.append(("rest", stage.clock.now)))
    stage.post(2.0, lambda: calls.append(("work", 2.0)))
    stage.run(11.0)
    assert calls == [("rest", 0.0), ("work", 2.0), ("rest", 2.0), ("rest", 10.0)]


def test_urgent_work_brings_the_next_tick_forward_and_no_later_one():
    # Two ticks a second, and work of 20 ms posted 0.1 s after one of them.
    stage = Stage(2.0)
    stage.post(0.6, lambda: stage.clock.spend(0.02), urgent=True)
    stage.run(2.1)
    assert stage.begun == pytest.approx([0.0, 0.5, 0.62, 1.5, 2.0])
    assert stage.left_out == [0] * 5


@pytest.mark.parametrize(("before", "waits"), [(0.05, True), (0.11, False)])
def test_urgent_work_delays_a_tick_a_little_or_is_done_after_it(before, waits):
    # Four ticks a second, which may be 0.3 × 0.25 s late. Work takes 0.15 s, so at once it would
    # make the tick 0.1 or 0.04 s late. How long it takes is known from the second time on.
    stage, begun = Stage(4.0), []

    def work():
        begun.append(stage.clock.now)
        stage.clock.spend(0.15)

    posted = [1.0 - before, 2.0 - before, 3.0 - before]
    for when in posted:
        stage.post(when, work, urgent=True)
    stage.run(4.0)
    waited = np.subtract(begun, posted)
    assert waited == pytest.approx([0.0, before, before] if waits else [0.0] * 3)
    later = [late for when, late in zip(stage.begun, stage.late, strict=True) if when > 1.5]
    assert max(later) <= 0.3 * 0.25


def test_urgent_work_that_is_not_done_brings_no_tick_forward():
    # Two ticks a second; the work after one of them is done in three steps of 20 ms.
    stage, steps = Stage(2.0), []

    def step():
        stage.clock.spend(0.02)
        steps.append(stage.clock.now)
        if len(steps) < 3:
            stage.pacer.post(step, urgent=True)
            return False
        return True

    stage.post(0.6, step, urgent=True)
    stage.run(1.6)
    assert steps == pytest.approx([0.62, 0.64, 0.66])
    assert stage.begun == pytest.approx([0.0, 0.5, 0.66, 1.5])


def test_urgent_work_makes_no_more_ticks():
    # Posted ten times a period, it brings ticks forward by one period at most, not one for each.
    stage = Stage(50.0)
    for when in np.arange(0.0, 1.0, 0.002):
        stage.post(when, lambda: None, urgent=True)
    stage.run(1.0)
    assert 49 <= len(stage.begun) + sum(stage.left_out) <= 52


class Ticks:
    """Counts ticks of a thread and says when there are enough."""

    def __init__(self, enough=inf, work=lambda: None):
        self.count = 0
        self._enough, self._work = enough, work
        self._done = threading.Event()

    def __call__(self, late, left_out):
        self.count += 1
        self._work()
        if self.count >= self._enough:
            self._done.set()

    def wait(self):
        assert self._done.wait(20.0)


@pytest.fixture
def paced():
    """Start pacers in threads; none outlives its test."""
    pacers = []

    def start(ticks, rate, **options):
        pacers.append(Pacer(ticks, rate, **options))
        pacers[-1].start()
        return pacers[-1]

    yield start
    for pacer in pacers:
        pacer.stop()


def test_thread_stops_at_once_though_the_next_tick_is_far(paced):
    # The next tick is 100 s away.
    ticks = Ticks(1)
    pacer = paced(ticks, 0.01)
    ticks.wait()
    begun = time.monotonic()
    assert pacer.stop()
    assert time.monotonic() - begun < 50.0
    assert ticks.count == 1


def test_pacer_that_never_started_can_be_stopped():
    assert Pacer(Ticks(), 1.0).stop()


def test_ticks_work_and_rest_share_one_thread_in_order(paced):
    threads, done = [], []

    def note_thread():
        threads.append(threading.get_ident())

    pacer = paced(Ticks(work=note_thread), 500.0, rest=note_thread)

    def post(poster):
        for number in range(200):
            pacer.post(lambda number=number: done.append((poster, number, threading.get_ident())))

    posters = [threading.Thread(target=post, args=(k,)) for k in range(4)]
    for poster in posters:
        poster.start()
    for poster in posters:
        poster.join()
    finished = threading.Event()
    pacer.post(finished.set)
    assert finished.wait(20.0)
    pacer.stop()
    assert len({*threads, *(thread for *_, thread in done)}) == 1
    for k in range(4):
        assert [number for poster, number, _ in done if poster == k] == list(range(200))


def test_posted_work_of_one_key_does_not_pile_up(paced):
    begun, posted, done = threading.Event(), threading.Event(), []

    def work():
        begun.set()
        assert posted.wait(20.0)

    pacer = paced(Ticks(work=work), 1.0)
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
    pacer = paced(Ticks(), 1000.0)

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
