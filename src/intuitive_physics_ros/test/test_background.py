"""Long work in a thread, while a node's callbacks go on."""

import threading
import time

import pytest
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from intuitive_physics_ros.background import Background


@pytest.fixture
def node():
    context = Context()
    rclpy.init(context=context, args=[])
    node = rclpy.create_node("worker", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


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
        answers.append(await background.run(lambda: release.wait(20.0) and "done"))

    timer = node.create_timer(0.01, ask, callback_group=ReentrantCallbackGroup())
    node.create_timer(0.01, lambda: ticks.append(None))
    spin_until(node, lambda: len(ticks) > 5)
    assert not answers
    release.set()
    spin_until(node, lambda: answers)
    assert answers == ["done"]
    background.stop()


def test_what_the_work_raises_is_raised_where_it_is_awaited(node):
    background, caught = Background(node), []

    def fail():
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

    def first():
        started.set()
        release.wait(20.0)
        done.append("first")

    for work in (first, lambda: done.append("second")):
        # Nobody awaits them: the work is handed over as soon as the coroutine runs.
        background.run(work).send(None)
    assert started.wait(20.0)
    threading.Timer(0.2, release.set).start()
    background.stop()
    assert done == ["first"]
