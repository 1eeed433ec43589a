"""Worlds shared among threads: each is rolled out once, whatever the threads do."""

from __future__ import annotations

import multiprocessing
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.simulation.shares import run_in_shares


@settings(max_examples=50)
@given(st.integers(1, 300), st.integers(1, 8), st.integers(1, 70))
def test_each_world_comes_once(worlds, threads, smallest):
    done = []
    run_in_shares(lambda first, last: done.extend(range(first, last)), worlds, threads, smallest)
    assert sorted(done) == list(range(worlds))


def test_a_thread_that_is_done_takes_more():
    # One share is held up until all others are done: so the other thread did them.
    done, all_others = [], threading.Event()

    def roll(first, last):
        if first == 0:
            assert all_others.wait(20.0)
        done.append(last - first)
        if sum(done) == 100 - 25:
            all_others.set()

    # The first share of 100 worlds for two threads is a quarter.
    run_in_shares(roll, 100, 2, 2)
    assert sum(done) == 100


def test_an_error_in_any_thread_is_raised_once_all_have_ended():
    running = []

    def roll(first, last):
        running.append(first)
        time.sleep(0.01)
        running.remove(first)
        raise ZeroDivisionError(f"worlds {first} to {last}")

    with pytest.raises(ZeroDivisionError, match="worlds"):
        run_in_shares(roll, 100, 4, 1)
    assert not running


def test_others_at_work_hold_nobody_up():
    # A batch that holds all of its threads, while another one of two threads comes and goes.
    free = threading.Event()
    long = threading.Thread(
        target=run_in_shares, args=(lambda first, last: free.wait(20.0), 256, 256, 1)
    )
    long.start()
    done = []
    run_in_shares(lambda first, last: done.extend(range(first, last)), 10, 2, 1)
    assert sorted(done) == list(range(10))
    assert not free.is_set()
    free.set()
    long.join()


def _in_child(queue):
    done = []
    run_in_shares(lambda first, last: done.extend(range(first, last)), 10, 2, 1)
    queue.put(sorted(done))


def test_a_forked_process_has_threads_of_its_own():
    run_in_shares(lambda first, last: None, 10, 2, 1)
    fork = multiprocessing.get_context("fork")
    queue = fork.SimpleQueue()
    child = fork.Process(target=_in_child, args=(queue,))
    child.start()
    child.join(20.0)
    assert child.exitcode == 0
    assert queue.get() == list(range(10))
