"""Nothing that is sent to the learner node, stored or begun can hold it or hurt it."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import LearningOptions, Observation, ResultCode, StaticParameters
from intuitive_physics_msgs.srv import (
    AddObservation,
    GetStaticParameters,
    ListObservations,
    SetStaticParameters,
)
from rclpy.action import ActionClient

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import InputLimits, limits, use_limits
from intuitive_physics.observation import Observation as LibraryObservation
from intuitive_physics.observation import ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.errors import DatabaseBusyError, StorageError
from intuitive_physics_learner.nodes.observation_services import ObservationQueue
from intuitive_physics_ros.conversions import observation_to_message, static_parameters_to_message
from intuitive_physics_ros.qos import OBSERVATIONS
from intuitive_physics_ros.scripting import NodeProcess, Peer

MODULE = "intuitive_physics_learner.nodes.learner_node"

SERVICES = {
    AddObservation: "/learner_node/add_observation",
    GetStaticParameters: "/learner_node/get_static_parameters",
    ListObservations: "/learner_node/list_observations",
    SetStaticParameters: "/learner_node/set_static_parameters",
}


@pytest.fixture
def database(tmp_path):
    return tmp_path / "learner.sqlite3"


@pytest.fixture
def start(database):
    """Start learner nodes on the test's database; none outlives its test."""
    started = []

    def start_one(*parameters):
        given = (f"database:={database}", "online:=false", "method:=random", *parameters)
        started.append(NodeProcess(MODULE, [word for value in given for word in ("-p", value)]))
        started[-1].wait_for("observations and version", 60.0)
        return started[-1]

    yield start_one
    for node in started:
        node.stop()


@pytest.fixture
def peer():
    with Peer("peer") as made:
        yield made


def stage(count=1, materials=("floor",), duration=1.0, name=""):
    """Boxes that bounce on floors, as something might have seen them."""
    times = np.linspace(0.0, duration, 30)
    still = np.zeros((times.size, 3))
    return LibraryObservation(
        Environment([Plane(name, name, (0, 0, 1), -0.001 * i) for i, name in enumerate(materials)]),
        tuple(
            ObservedObject(
                SceneObject(f"box {i}", "box", Box((0.1, 0.12, 0.14))),
                Trajectory(times, still + [0.3 * i, 0.0, 0.5]),
                ObjectState((0.3 * i, 0.0, 0.5), linear_velocity=(0.1, 0.2, 0.0)),
            )
            for i in range(count)
        ),
        0.0,
        name,
    )


def call(peer, kind, **fields):
    return peer.call(kind, SERVICES[kind], kind.Request(**fields))


def add(peer, observation):
    return call(peer, AddObservation, observation=observation_to_message(observation))


def materials(count):
    return [f"material {i}" for i in range(count)]


def test_observation_of_many_materials_is_refused(start, peer, database):
    node = start()
    large = StaticParameters(materials=materials(20_000))
    for answer in (
        add(peer, stage(materials=materials(999))),
        call(peer, SetStaticParameters, static_parameters=large),
    ):
        assert answer.result.value == ResultCode.INVALID_INPUT
        assert "expected at most 32" in answer.result.message
    # Over the topic too, where nobody is answered.
    topic = peer.publisher(Observation, "intuitive_physics/observations", OBSERVATIONS)
    topic.publish(observation_to_message(stage(materials=materials(20), name="first")))
    topic.publish(observation_to_message(stage(materials=materials(40)[20:], name="second")))
    node.wait_for("observations rejected: ")
    assert add(peer, stage()).result.value == ResultCode.OK
    assert node.stop() == 0
    with ObservationStore(database) as store:
        assert store.count() == 2
    assert start().stop() == 0


def test_a_database_of_an_older_version_that_holds_too_much_starts(start, peer, database):
    before = limits()
    use_limits(InputLimits(most_materials=1000))
    try:
        with ObservationStore(database) as store:
            store.add(stage(name="small"))
            store.add(stage(materials=materials(500), name="large"))
            store.add_parameters(LearnedParameters.defaults(["box"]))
    finally:
        use_limits(before)
    with sqlite3.connect(database) as file:
        row = LearnedParameters.defaults(materials(33)).to_dict()
        file.execute("INSERT INTO learned_parameters VALUES (2, 0.0, ?)", (json.dumps(row),))
    file.close()
    node = start()
    node.wait_for("1 of 2 observations cannot be read and are passed over")
    node.wait_for("version 2 of the learned parameters cannot be read")
    answer = call(peer, GetStaticParameters)
    assert answer.result.value == ResultCode.OK
    assert answer.static_parameters.version == 2
    assert answer.static_parameters.materials == ["box", "floor"]
    listed = call(peer, ListObservations)
    none = call(peer, ListObservations, after=2**64 - 1, limit=2**32 - 1)
    assert none.result.value == ResultCode.OK
    assert not none.observations
    assert [entry.status for entry in listed.observations] == ["used", "unreadable"]
    assert "its 501 materials are too many" in listed.observations[1].reason
    assert node.stop() == 0


ENDLESS = LearningOptions(method="random", max_iterations=10**7)


class Goal:
    """A search under way, and its answer."""

    def __init__(self, peer, options=ENDLESS):
        client = ActionClient(peer.node, LearnParameters, "/learner_node/learn_parameters")
        peer.spin_until(client.server_is_ready, "the action")
        self.feedback = []
        goal = LearnParameters.Goal(options=options)
        sent = client.send_goal_async(goal, feedback_callback=self.feedback.append)
        peer.spin_until(sent.done, "the goal's acceptance")
        self._peer = peer
        self.handle = sent.result()
        self.answer = self.handle.get_result_async()

    def result(self):
        self._peer.spin_until(self.answer.done, "the goal's result")
        return self.answer.result().result.result

    @property
    def status(self):
        return self.answer.result().status


def test_a_search_is_cancelled_in_the_midst_of_a_simulation(start, peer):
    # One batch of candidates takes minutes.
    start()
    assert add(peer, stage(5, duration=590.0)).result.value == ResultCode.OK
    goal = Goal(peer)
    peer.spin_for(0.5)
    goal.handle.cancel_goal_async()
    # The peer's patience is far more than it takes, and far less than a batch.
    assert goal.result().value == ResultCode.CANCELLED
    assert goal.status == GoalStatus.STATUS_CANCELED


def test_a_node_ends_in_the_midst_of_a_simulation(start, peer, database):
    node = start()
    assert add(peer, stage(5, duration=590.0)).result.value == ResultCode.OK
    Goal(peer)
    peer.spin_for(0.5)
    assert node.stop(signal.SIGTERM) == 0
    assert "still under way" not in node.output
    with ObservationStore(database) as store:
        assert store.count() == 1


def test_a_search_has_a_deadline(start, peer):
    start("search_deadline:=1.0")
    add(peer, stage(5, duration=590.0))
    result = Goal(peer).result()
    assert result.value == ResultCode.CANCELLED
    assert "no answer within 1 s" in result.message
    assert "raise search_deadline" in result.message


DEAF = """
from rclpy.action.server import ServerGoalHandle
from intuitive_physics_learner.nodes import learner_node

def deaf(handle, feedback):
    raise RuntimeError("nobody listens")

ServerGoalHandle.publish_feedback = deaf
main = learner_node.main
"""


def test_result_is_stored_after_callers_left(database, peer, tmp_path, monkeypatch):
    (tmp_path / "deaf_node.py").write_text(DEAF)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    parameters = ["-p", f"database:={database}", "-p", "online:=false"]
    with NodeProcess("deaf_node", parameters) as node:
        add(peer, stage())
        options = LearningOptions(method="random", max_iterations=100)
        goal = Goal(peer, options)
        assert goal.result().value == ResultCode.OK
        node.wait_for("feedback of a search failed: RuntimeError: nobody listens")
        assert call(peer, GetStaticParameters).static_parameters.version == 1


def test_given_values_end_a_running_search(start, peer):
    start()
    add(peer, stage())
    goal = Goal(peer)
    peer.spin_until(lambda: goal.feedback, "the search")
    given = LearnedParameters.defaults(["box", "floor"])
    answer = call(peer, SetStaticParameters, static_parameters=static_parameters_to_message(given))
    assert answer.result.value == ResultCode.OK
    result = goal.result()
    assert result.value == ResultCode.CANCELLED
    assert "of the static parameters was given while this search ran" in result.message
    assert call(peer, GetStaticParameters).static_parameters.version == answer.version


def test_busy_database_blocks_only_its_users(start, peer, database):
    start()
    add(peer, stage())
    given = static_parameters_to_message(LearnedParameters.defaults(["box"]))
    answer = call(peer, SetStaticParameters, static_parameters=given)
    assert answer.result.value == ResultCode.OK
    diagnostics = peer.listen(DiagnosticArray, "/diagnostics")
    other = sqlite3.connect(database, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    request = SetStaticParameters.Request(static_parameters=given)
    waiting = peer.send(SetStaticParameters, SERVICES[SetStaticParameters], request)
    peer.spin_for(0.2)
    heard = len(diagnostics)
    call(peer, GetStaticParameters)
    assert not waiting.done()
    peer.spin_until(lambda: len(diagnostics) >= heard + 2, "diagnostics")
    assert not waiting.done()
    other.execute("ROLLBACK")
    peer.spin_until(waiting.done, "the answer")
    assert waiting.result().result.value == ResultCode.OK
    other.close()


class BusyStore:
    """A database that another process writes all the time."""

    def add(self, observation):
        raise DatabaseBusyError("another process has been writing for too long; try again")


def test_observations_that_wait_take_little_memory():
    queue = ObservationQueue(BusyStore(), lambda: None, lambda error: None)
    observation = stage(name="one")
    times = np.linspace(0.0, 1.0, 600_000)
    track = replace(observation.objects[0], trajectory=Trajectory(times, np.zeros((times.size, 3))))
    large = replace(observation, objects=(track,))
    queue.put(large)
    with pytest.raises(StorageError, match="1 observations of 600000 points wait"):
        queue.put(large)
    queue.put(observation)
    assert queue.check().values == {"waiting": 2, "lost": 1, "refused by a full database": 0}
    assert queue.stop(5.0) == 2


def test_refused_observation_does_not_block_the_next(database):
    refused = []
    with ObservationStore(database) as store:
        queue = ObservationQueue(store, lambda: None, refused.append)
        for name, count in (("first", 1), ("large", 40), ("last", 1)):
            queue.put(stage(materials=materials(count), name=name))
        assert queue.stop(20.0) == 0
        assert [entry.id for entry in store.entries()] == ["first", "last"]
    assert "materials of observation large: got 41" in str(refused[0])


def test_requests_that_wait_have_an_end(start, peer, database):
    start("request_time_limit:=0.5", "largest_queue:=2")
    add(peer, stage())
    other = sqlite3.connect(database, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    sent = [
        peer.send(
            AddObservation,
            SERVICES[AddObservation],
            AddObservation.Request(observation=observation_to_message(stage(name=f"{i}"))),
        )
        for i in range(4)
    ]
    peer.spin_until(lambda: all(future.done() for future in sent), "answers")
    codes = sorted(future.result().result.value for future in sent)
    assert codes == [ResultCode.BUSY, ResultCode.BUSY, ResultCode.CANCELLED, ResultCode.CANCELLED]
    other.execute("ROLLBACK")
    other.close()
