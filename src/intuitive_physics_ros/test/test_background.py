"""Long work in a thread, while a node's callbacks go on."""

import threading
import time

import pytest
from intuitive_physics_msgs.msg import ResultCode
from rclpy.callback_groups import ReentrantCallbackGroup

from intuitive_physics_ros.background import Background
from intuitive_physics_ros.result_codes import RefusedError
from intuitive_physics_ros.scripting import Peer


@pytest.fixture
def node():
    with Peer("worker") as peer:
        yield peer.node


def spin_until(node, holds):
    deadline = time.monotonic() + 20.0
    while not holds():
        assert time.monotonic() < deadline
        node.executor.spin_once(timeout_sec=0.1)


def test_other_callbacks_go_on_until_the_work_is_done(node):
    background, answers, ticks = Background(node), [], []
    release = threading.Event()

    async def ask():
        timer.cancel()
        answers.append(await background.run(lambda stop: release.wait(20.0) and "done"))

    timer = node.create_timer(0.01, ask, callback_group=ReentrantCallbackGroup())
    node.create_timer(0.01, lambda: ticks.append(None))
    spin_until(node, lambda: len(ticks) > 5)
    assert not answers
    release.set()
    spin_until(node, lambda: answers)
    assert answers == ["done"]
    background.stop()


def test_exception_of_the_work_is_raised_where_it_is_awaited(node):
    background, caught = Background(node), []

    def fail(stop):
        raise ValueError("no such thing")

    async def ask():
        timer.cancel()
        try:
            await background.run(fail)
        except ValueError as error:
            caught.append(str(error))

    timer = node.create_timer(0.01, ask, callback_group=ReentrantCallbackGroup())
    spin_until(node, lambda: caught)
    assert caught == ["no such thing"]
    background.stop()


def test_stopping_leaves_out_what_waits(node):
    background, done = Background(node), []
    started, release = threading.Event(), threading.Event()

    def first(stop):
        started.set()
        release.wait(20.0)
        done.append("first")

    for work in (first, lambda stop: done.append("second")):
        # Nobody awaits them: the work is handed over as soon as the coroutine runs.
        background.run(work).send(None)
    assert started.wait(20.0)
    threading.Timer(0.2, release.set).start()
    background.stop(20.0)
    assert done == ["first"]


def ask(node, background, work, answers, **options):
    """Have work done from a callback; append its answer, or the error's code and text."""

    async def on_timer():
        timer.cancel()
        try:
            answers.append(await background.run(work, **options))
        except RefusedError as error:
            answers.append((error.code, str(error)))

    timer = node.create_timer(0.01, on_timer, callback_group=ReentrantCallbackGroup())


def test_work_that_takes_too_long_is_refused_and_stopped(node):
    background, answers, told = Background(node), [], threading.Event()

    def work(stop):
        while not stop.is_set():
            time.sleep(0.005)
        told.set()

    ask(node, background, work, answers, time_limit=0.1)
    spin_until(node, lambda: answers)
    assert answers[0][0] == ResultCode.CANCELLED
    assert "no answer within 0.1 s" in answers[0][1]
    assert told.wait(20.0)
    ask(node, background, lambda stop: "next", answers)
    spin_until(node, lambda: len(answers) == 2)
    assert answers[1] == "next"
    background.stop()


def test_request_behind_work_that_does_not_stop_is_answered_in_time(node):
    background, answers, release = Background(node), [], threading.Event()
    ask(node, background, lambda stop: release.wait(20.0), answers, time_limit=0.2)
    ask(node, background, lambda stop: "never begun", answers, time_limit=0.2)
    spin_until(node, lambda: len(answers) == 2)
    assert {code for code, _ in answers} == {ResultCode.CANCELLED}
    release.set()
    background.stop()


def test_one_request_too_many_is_answered_busy(node):
    node.declare_parameter("largest_queue", 2)
    background, answers, release = Background(node), [], threading.Event()
    for _ in range(3):
        ask(node, background, lambda stop: release.wait(20.0), answers)
    spin_until(node, lambda: answers)
    assert answers[0][0] == ResultCode.BUSY
    assert "raise the parameter largest_queue" in answers[0][1]
    release.set()
    spin_until(node, lambda: len(answers) == 3)
    assert answers[1:] == [True, True]
    background.stop()


def test_stopping_does_not_wait_for_work_that_does_not_end(node):
    background, started, release = Background(node), threading.Event(), threading.Event()

    def work(stop):
        started.set()
        release.wait(20.0)

    background.run(work).send(None)
    assert started.wait(20.0)
    assert not background.stop(0.05)
    release.set()
    assert background.stop(20.0)


def test_what_is_cancelled_is_answered_with_the_reason_and_what_follows_is_done(node):
    background, answers, release = Background(node), [], threading.Event()
    for _ in range(2):
        ask(node, background, lambda stop: release.wait(20.0), answers)
    spin_until(node, lambda: background._under_way and background._waiting)
    background.cancel("nobody wants it")
    spin_until(node, lambda: len(answers) == 2)
    assert answers == [(ResultCode.CANCELLED, "nobody wants it")] * 2
    release.set()
    ask(node, background, lambda stop: "next", answers)
    spin_until(node, lambda: len(answers) == 3)
    assert answers[2] == "next"
    background.stop()
