"""Nothing that is asked of the predictor node can hold it or take all memory."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from intuitive_physics_msgs.msg import ResultCode, StaticParameters
from intuitive_physics_msgs.srv import Predict

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters as LibraryParameters
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    static_parameters_to_message,
)
from intuitive_physics_ros.scripting import NodeProcess, Peer

MODULE = "intuitive_physics_predictor.nodes.predictor_node"
PREDICT = "/predictor_node/predict"
FLOOR = Environment([Plane("floor", "any", (0, 0, 1), 0.0)], frame_id="lab")


@pytest.fixture(scope="module")
def node():
    arguments = ["-p", "request_time_limit:=3.0", "-p", "largest_queue:=2"]
    with NodeProcess(MODULE, arguments) as process:
        yield process


@pytest.fixture
def peer(node):
    with Peer("tester", timeout=60.0) as peer:
        yield peer
    node.check_running()
    assert "Traceback" not in node.output


def bouncing_boxes():
    """Five boxes that bounce for ever, and that no engine simulates faster than 1000 s in a s."""
    shape = Box((0.1, 0.12, 0.14))
    boxes = [SceneObject(f"box {i}", "any", shape) for i in range(5)]
    states = [ObjectState((0.3 * i, 0, 0.5 + 0.1 * i)) for i in range(5)]
    elastic = LearnedParameters(
        LibraryParameters.uniform(
            ["any"], static_friction=0.0, dynamic_friction=0.0, restitution=1.0
        ),
        np.zeros(5),
        np.ones(5, dtype=bool),
        1,
        0.0,
        1,
        "",
    )
    return boxes, states, static_parameters_to_message(elastic)


def endless():
    boxes, states, elastic = bouncing_boxes()
    return request(boxes, states, static_parameters=[elastic])


def request(objects=None, states=None, **changes):
    objects = objects or [SceneObject("ball", "any", Sphere(0.05))]
    states = states or [ObjectState((0, 0, 1.0))]
    fields = {"horizon": 590.0, "time_step": 1.0, "sample_count": 500, **changes}
    return Predict.Request(
        environment=environment_to_message(FLOOR),
        objects=object_states_to_message(objects, states, frame_id="lab").objects,
        **fields,
    )


def ask(peer, **changes):
    return peer.call(Predict, PREDICT, request(**{"horizon": 1.0, "time_step": 0.1, **changes}))


def test_a_prediction_has_a_deadline_and_the_next_one_is_answered(node, peer):
    assert ask(peer, sample_count=20).result.value == ResultCode.OK
    diagnostics = peer.listen(DiagnosticArray, "/diagnostics")
    sent = [peer.send(Predict, PREDICT, endless()) for _ in range(4)]
    peer.spin_until(lambda: all(future.done() for future in sent), "answers")
    results = sorted((future.result().result for future in sent), key=lambda result: result.value)
    codes = [result.value for result in results]
    assert codes == [ResultCode.BUSY, ResultCode.BUSY, ResultCode.CANCELLED, ResultCode.CANCELLED]
    assert "no answer within 3 s" in results[-1].message
    # The node goes on, whatever it simulated.
    peer.spin_until(lambda: diagnostics, "diagnostics")
    assert ask(peer, sample_count=20).result.value == ResultCode.OK


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"horizon": 1e6, "time_step": 10.0}, "at most 600 s"),
        ({"times": [1.0, 1e6]}, "at most 600 s"),
        ({"times": [0.1], "sample_count": 5_000_000}, "at most 20,000,000 numbers"),
        ({"sample_count": 2**32 - 1}, "at most 20,000,000 numbers"),
        ({"time_step": 1e-7}, "at most a million times"),
        (
            {"static_parameters": [StaticParameters(materials=[str(i) for i in range(20_000)])]},
            "materials: got 20000, expected at most 32",
        ),
        (
            {
                "objects": [SceneObject(f"{i}", f"{i}", Sphere(0.01)) for i in range(40)],
                "states": [ObjectState((i, 0, 1.0)) for i in range(40)],
            },
            "materials in the scene: got 41, expected at most 32",
        ),
    ],
)
def test_too_large_request_is_refused_at_once(node, peer, changes, words):
    result = ask(peer, **changes).result
    assert result.value == ResultCode.INVALID_INPUT
    assert words in result.message


def test_node_ends_during_a_prediction():
    with NodeProcess(MODULE) as node, Peer("tester", timeout=60.0) as peer:
        assert ask(peer, sample_count=20).result.value == ResultCode.OK
        peer.send(Predict, PREDICT, endless())
        peer.spin_for(0.5)
        assert node.stop(signal.SIGTERM) == 0
        assert "still under way" not in node.output
        assert "Traceback" not in node.output


def test_the_largest_prediction_takes_little_memory(node, peer):
    # Requests of the tests before may still be under way.
    peer.spin_until(
        lambda: ask(peer, sample_count=20).result.value == ResultCode.OK, "an answer in time"
    )
    # It is sent once: a copy, sent again on a busy machine, would find the queue full.
    sent = peer.send(Predict, PREDICT, request(times=[0.1], sample_count=400_000))
    peer.spin_until(sent.done, "an answer")
    result = sent.result().result
    assert result.value in (ResultCode.OK, ResultCode.CANCELLED), result.message
    status = Path(f"/proc/{node.process.pid}/status").read_text()
    peak = int(status.split("VmHWM:")[1].split()[0])
    assert peak < 1.5e6, f"{peak} kB"
