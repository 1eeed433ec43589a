"""Searches on request, with work that ends when the test says so."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest
import rclpy
from intuitive_physics_msgs.msg import ResultCode
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from intuitive_physics_learner.errors import LearningCancelledError
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.nodes import learning_services
from intuitive_physics_learner.nodes.learning_services import RequestedSearches
from intuitive_physics_ros.result_codes import RefusedError

PATIENCE = 20.0
"""s for what takes well under one."""


@pytest.fixture
def node():
    rclpy.init()
    made = Node("searcher")
    yield made
    made.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def executor(node):
    made = SingleThreadedExecutor()
    made.add_node(node)
    yield made
    made.shutdown()


@pytest.fixture
def may_end():
    event = threading.Event()
    yield event
    event.set()


@pytest.fixture
def searches(node, may_end):
    """Searches that go on, cancelled or not, until they may end."""

    def work(on_progress, stop):
        may_end.wait(PATIENCE)
        return SimpleNamespace(learned=None)

    return RequestedSearches(
        node, lambda options: work, lambda learned: None, lambda: None, lambda learned: None
    )


def started(executor, searches):
    """Return a task whose result is the search, or why it is refused."""

    async def start():
        try:
            return await searches._start(LearningOptions())
        except RefusedError as error:
            return error

    task = executor.create_task(start)
    executor.spin_once(timeout_sec=0.1)
    return task


def test_search_waits_for_the_end_of_a_cancelled_one(executor, searches, may_end) -> None:
    first = started(executor, searches).result()
    searches.cancel("the test wants another")
    task = started(executor, searches)
    assert not task.done()
    may_end.set()
    executor.spin_until_future_complete(task, PATIENCE)
    assert first.done
    assert task.result() is not first


def test_search_is_refused_while_a_cancelled_one_does_not_end(
    executor, searches, monkeypatch
) -> None:
    monkeypatch.setattr(learning_services, "NEXT_PATIENCE", 0.1)
    started(executor, searches)
    searches.cancel("the test wants another")
    task = started(executor, searches)
    executor.spin_until_future_complete(task, PATIENCE)
    assert task.result().code == ResultCode.BUSY
    assert "was cancelled and has not ended yet" in str(task.result())


def test_search_is_refused_at_once_while_another_runs(executor, searches) -> None:
    started(executor, searches)
    task = started(executor, searches)
    assert task.done()
    assert task.result().code == ResultCode.BUSY
    assert "a search runs already, at iteration 0; wait for its end" in str(task.result())


def test_a_node_that_ends_answers_at_once_though_a_search_does_not_end(
    node, executor, searches, may_end, monkeypatch
) -> None:
    """Its services are gone soon after."""
    monkeypatch.setattr(learning_services, "CANCEL_PATIENCE", 3600.0)
    node.declare_parameter(learning_services.DEADLINE, 3600.0)
    job = started(executor, searches).result()

    async def answered():
        try:
            return await searches._watched(job)
        except LearningCancelledError as error:
            return error

    task = executor.create_task(answered)
    executor.spin_once(timeout_sec=0.1)
    searches.cancel("the node ends, so the search is cancelled")
    assert not searches.stop(patience=0.0)
    executor.spin_until_future_complete(task, PATIENCE)
    assert "the node ends" in str(task.result())
    may_end.set()
    while not job.done:
        executor.spin_once(timeout_sec=0.1)
    executor.spin_once(timeout_sec=0.1)
