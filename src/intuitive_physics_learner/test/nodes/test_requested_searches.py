"""Searches on request, with work that ends when the test says so."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import pytest
import rclpy
from intuitive_physics_msgs.msg import ResultCode, StaticParameters
from intuitive_physics_msgs.srv import Learn
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

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
def ends():
    """What was reported when searches ended."""
    return []


@pytest.fixture
def begun():
    return threading.Event()


@pytest.fixture
def searches(node, may_end, ends, begun):
    """Searches that go on, cancelled or not, until they may end."""

    def work(on_progress, stop):
        begun.set()
        may_end.wait(PATIENCE)
        return SimpleNamespace(learned="this")

    node.declare_parameter(learning_services.DEADLINE, 3600.0)
    return RequestedSearches(
        node, lambda options: work, lambda learned: StaticParameters(), lambda: None, ends.append
    )


def asked(executor, searches):
    """Return a task whose result is a request's answer, or why it is refused."""

    async def ask():
        response = Learn.Response()
        try:
            await searches._answer(response, LearningOptions())
        except RefusedError as error:
            return error
        return response

    task = executor.create_task(ask)
    executor.spin_once(timeout_sec=0.1)
    return task


def test_search_waits_for_the_end_of_a_cancelled_one(
    executor, searches, may_end, ends, begun
) -> None:
    first = asked(executor, searches)
    assert begun.wait(PATIENCE)
    searches.cancel("the test wants another")
    executor.spin_until_future_complete(first, PATIENCE)
    assert "the test wants another" in str(first.result())
    second = asked(executor, searches)
    executor.spin_once(timeout_sec=0.1)
    assert not second.done()
    may_end.set()
    executor.spin_until_future_complete(second, PATIENCE)
    assert second.result().result.value == ResultCode.OK
    # What the first one learned is stored, though its caller was told otherwise before.
    assert ends == ["this", "this"]
    assert searches.running is None


def test_search_is_refused_while_a_cancelled_one_does_not_end(
    executor, searches, begun, monkeypatch
) -> None:
    monkeypatch.setattr(learning_services, "NEXT_PATIENCE", 0.1)
    first = asked(executor, searches)
    assert begun.wait(PATIENCE)
    searches.cancel("the test wants another")
    executor.spin_until_future_complete(first, PATIENCE)
    task = asked(executor, searches)
    executor.spin_until_future_complete(task, PATIENCE)
    assert task.result().code == ResultCode.BUSY
    assert "was cancelled and has not ended yet" in str(task.result())


def test_search_is_refused_at_once_while_another_runs(executor, searches) -> None:
    asked(executor, searches)
    task = asked(executor, searches)
    assert task.done()
    assert task.result().code == ResultCode.BUSY
    assert "a search runs already, at iteration 0; wait for its end" in str(task.result())


def test_a_node_that_ends_answers_at_once_though_a_search_does_not_end(
    executor, searches, may_end, ends, begun
) -> None:
    """Its services are gone soon after."""
    task = asked(executor, searches)
    assert begun.wait(PATIENCE)
    assert not searches.stop(patience=0.0)
    executor.spin_until_future_complete(task, PATIENCE)
    assert "the node ends" in str(task.result())
    assert searches.running is not None
    assert ends == []
    may_end.set()
    until = time.monotonic() + PATIENCE
    while not ends and time.monotonic() < until:
        executor.spin_once(timeout_sec=0.1)
    assert ends == ["this"]
    assert searches.running is None
