"""The learner node's suggestions as others see them: a process of its own, spoken to over DDS."""

import time

import pytest
from intuitive_physics_msgs.msg import ResultCode
from intuitive_physics_msgs.srv import GetStaticParameters, Suggest

from intuitive_physics.scene import Scene
from intuitive_physics_learner import ObservationStore
from intuitive_physics_ros.conversions import environment_to_message, object_state_to_message
from intuitive_physics_ros.scripting import NodeProcess, Peer

MODULE = "intuitive_physics_learner.nodes.learner_node"

SERVICES = {
    Suggest: "/learner_node/suggest",
    GetStaticParameters: "/learner_node/get_static_parameters",
}

PATIENCE = 60.0
"""Seconds to wait for what takes a few, on a machine that is busy with other things."""

RANGES = {
    "position": [-1.0, 0.0, -1.0, 0.0, 0.1, 0.8],
    "linear_velocity": [-2.0, 2.0] * 3,
    "angular_velocity": [0.0, 0.0] * 3,
}
E = "restitution[ball, floor]"


class Asking:
    """A learner node on a database, and a peer that asks it."""

    def __init__(self, database, *parameters):
        values = [f"database:={database}", "online:=false", "simulator:=event_driven", *parameters]
        self.process = NodeProcess(MODULE, [word for value in values for word in ("-p", value)])
        self.peer = Peer("asking", timeout=PATIENCE)

    def greet(self):
        """Have each service answer once: no answer is lost after that, and none is asked twice."""
        for kind, fields in ((GetStaticParameters, {}), (Suggest, {"about": ["none"]})):
            self.peer.call(kind, SERVICES[kind], kind.Request(**fields))

    def call(self, kind, **fields):
        answer = self.send(kind, **fields)
        self.peer.spin_until(answer.done, f"an answer of {SERVICES[kind]}")
        return answer.result()

    def send(self, kind, **fields):
        return self.peer.send(kind, SERVICES[kind], kind.Request(**fields))

    def close(self):
        self.peer.close()
        return self.process.stop()


@pytest.fixture
def asking(tmp_path, throws):
    """Start a node on a database of thrown balls, and ask it."""
    opened = []

    def start(*parameters, count=4):
        database = tmp_path / "learner.sqlite3"
        with ObservationStore(database) as store:
            store.add_all(throws(count, 0, 0.002, 0.002))
        opened.append(Asking(database, *parameters))
        opened[-1].greet()
        return opened[-1]

    yield start
    for node in opened:
        node.close()


def test_suggests_throws_of_observed_objects(asking, throws):
    node = asking()
    answer = node.call(Suggest, about=[E], count=3, seed=1, **RANGES)
    assert answer.result.value == ResultCode.OK, answer.result.message
    assert answer.asked == [E]
    assert answer.header.frame_id == "world"
    assert len(answer.throws) == 3
    gains = [each.information for each in answer.throws]
    assert gains == sorted(gains, reverse=True)
    (ball,) = answer.throws[0].objects
    assert ball.material == "ball"
    assert -1.0 <= ball.pose.pose.position.x <= 0.0
    assert answer.throws[0].standard_deviations[0] < 0.5 * answer.standard_deviations[0]
    again = node.call(Suggest, about=[E], count=3, seed=1, **RANGES)
    assert [each.information for each in again.throws] == gains
    # All parameters, from what was seen.
    assert len(node.call(Suggest).asked) == 4
    # The answer to a query.
    (observation,) = throws(1, 0)
    scene: Scene = observation.scene()
    query = {
        "environment": environment_to_message(scene.environment),
        "objects": [object_state_to_message(scene.objects[0], scene.states[0])],
    }
    answer = node.call(Suggest, object_id="ball", time=0.8, **query, **RANGES)
    assert answer.asked == [f"{axis} of ball at 0.8 s" for axis in "xyz"]
    both = node.call(Suggest, about=[E], object_id="ball", time=0.8, **query)
    assert both.result.value == ResultCode.INVALID_INPUT


def test_refusals_and_clean_end(asking):
    node = asking()
    for fields, code, words in (
        ({"about": ["bounce"]}, ResultCode.UNKNOWN_NAME, "expected one of"),
        ({"thrown": "cup"}, ResultCode.INVALID_INPUT, "no object 'cup' was seen"),
        ({"position": [0.0, 1.0]}, ResultCode.INVALID_INPUT, "expected none or 6"),
    ):
        result = node.call(Suggest, **fields).result
        assert result.value == code
        assert words in result.message
    assert node.close() == 0


def test_an_empty_database_has_nothing_to_throw(asking):
    node = asking(count=0)
    assert node.call(Suggest).result.value == ResultCode.NO_OBSERVATIONS


def test_one_at_a_time_within_the_time_limit_and_responsive(asking):
    # So many throws of so many unknowns are not judged within the limit.
    node = asking("suggestion_time_limit:=0.1")
    first = node.send(Suggest, **RANGES)
    second = node.send(Suggest, **RANGES)
    began = time.monotonic()
    assert node.call(GetStaticParameters).result.value == ResultCode.OK
    assert time.monotonic() - began < PATIENCE / 2
    node.peer.spin_until(lambda: first.done() and second.done(), "both answers")
    codes = {first.result().result.value, second.result().result.value}
    assert codes == {ResultCode.BUSY, ResultCode.CANCELLED}
    (late,) = (
        each.result().result
        for each in (first, second)
        if each.result().result.value == ResultCode.CANCELLED
    )
    assert "raise suggestion_time_limit" in late.message
