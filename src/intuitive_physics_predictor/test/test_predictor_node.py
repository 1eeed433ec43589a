"""The predictor node as a process, over DDS."""

from __future__ import annotations

import os
import signal
from itertools import pairwise

import numpy as np
import pytest

os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates, ResultCode, Shape, TrajectoryDistribution
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from intuitive_physics_msgs.srv import Predict, Query
from visualization_msgs.msg import MarkerArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    static_parameters_to_message,
    trajectory_distribution_from_message,
)
from intuitive_physics_ros.node_process import NodeProcess
from intuitive_physics_ros.peer import Peer
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA

MODULE = "intuitive_physics_predictor.predictor_node"
NODE = "/predictor_node"
ENVIRONMENT = Environment([Plane("floor", "room", (0, 0, 1), 0.0)], frame_id="lab")
BALL = SceneObject("ball", "rubber", Sphere(0.05))
COVARIANCE = np.diag([1e-6] * 3 + [0.0] * 3 + [1e-4] * 3 + [1.0] * 3)
FLYING = ObjectState((0, 0, 1.0), (0, 0, 0, 1), (2.0, 0, 0), (0, 0, 0), COVARIANCE)


@pytest.fixture(scope="module")
def node():
    with NodeProcess(MODULE, ["-p", "horizon:=1.0"]) as process:
        yield process


@pytest.fixture
def peer(node):
    with Peer("tester") as peer:
        yield peer
    node.check_running()
    assert "Traceback" not in node.output


def states_message(objects=(BALL,), states=(FLYING,)):
    return object_states_to_message(objects, states, frame_id="lab")


def predict_request(**changes):
    request = Predict.Request(
        environment=environment_to_message(ENVIRONMENT),
        objects=states_message().objects,
        horizon=1.0,
        time_step=0.1,
        sample_count=50,
        seed=7,
    )
    for name, value in changes.items():
        setattr(request, name, value)
    return request


def feed_until(peer, holds, what, message=None):
    """Publish states about 30 times a second until something holds, and return what."""
    publisher = peer.publisher(ObjectStates, f"{NODE}/object_states", SENSOR_DATA)

    def feed():
        publisher.publish(message or states_message())
        peer.spin_for(1 / 30)

    answer = peer.spin_until(lambda: holds() or feed(), what)
    peer.node.destroy_publisher(publisher)
    return answer


def told(diagnostics, name, text):
    """Whether a diagnostic of the node says something."""
    return any(
        status.name == f"predictor_node: {name}" and text in status.message
        for message in diagnostics
        for status in message.status
    )


@pytest.fixture
def inputs(peer):
    """Publish environment and parameters, latched: the node gets them whenever it connects."""
    environment = peer.publisher(EnvironmentMessage, f"{NODE}/environment", LATCHED)
    environment.publish(environment_to_message(ENVIRONMENT, version=3))
    parameters = peer.publisher(StaticParametersMessage, f"{NODE}/static_parameters", LATCHED)
    parameters.publish(static_parameters_to_message(LearnedParameters.defaults(["rubber", "room"])))


def test_it_predicts_what_it_is_fed(peer, inputs):
    # Free flight of the mean: x = v t, z = z0 - g t²/2, until the ball lands at 0.44 s.
    heard = peer.listen(TrajectoryDistribution, f"{NODE}/trajectory_distribution", SENSOR_DATA)
    markers = peer.listen(MarkerArray, f"{NODE}/markers")
    feed_until(peer, lambda: len(heard) > 50 and markers, "50 predictions and markers")
    got = trajectory_distribution_from_message(heard[-1])
    assert got.frame_id == "lab"
    assert got.environment_version == 3
    assert got.positions.shape == (20, 1, 101, 3)
    # Each has noise of its own; one or another may be lost on the way.
    assert all(a.seed < b.seed for a, b in pairwise(heard))
    t = got.times[:40]
    truth = np.stack([2.0 * t, 0 * t, 1.0 - 0.5 * 9.81 * t**2], axis=1)
    # 20 samples of σ = 1 mm + 10 mm/s t: the mean is off by less than 4 σ / sqrt(20).
    np.testing.assert_allclose(got.mean[0, :40], truth, atol=0.006)
    assert {"samples", "mean", "covariance"} <= {m.ns for m in markers[-1].markers}


def test_it_stops_when_its_input_stops(peer, inputs):
    heard = peer.listen(TrajectoryDistribution, f"{NODE}/trajectory_distribution", SENSOR_DATA)
    diagnostics = peer.listen(DiagnosticArray, "/diagnostics")
    feed_until(peer, lambda: heard, "a prediction")
    diagnostics.clear()
    stale = "older than 0.5 s"
    peer.spin_until(lambda: told(diagnostics, "prediction", stale), f"a diagnostic: {stale}")
    peer.spin_for(1.0)
    count = len(heard)
    peer.spin_for(1.0)
    assert len(heard) == count


def test_predict_answers_any_scene_and_the_same_to_the_same_seed(peer):
    first = peer.call(Predict, f"{NODE}/predict", predict_request())
    again = peer.call(Predict, f"{NODE}/predict", predict_request())
    other = peer.call(Predict, f"{NODE}/predict", predict_request(seed=8))
    assert first.result.value == ResultCode.OK, first.result.message
    got = trajectory_distribution_from_message(first.distribution)
    assert got.positions.shape == (50, 1, 11, 3)
    assert got.object_ids == ("ball",)
    assert first.distribution.objects[0].samples == again.distribution.objects[0].samples
    assert first.distribution.objects[0].samples != other.distribution.objects[0].samples


BOX = SceneObject("box", "rubber", Box((0.1, 0.2, 0.1)))


def test_predict_answers_boxes_too(peer):
    # Free flight of the mean as above, for the box is no lower than 0.8 m at 0.2 s.
    objects = states_message((BOX,)).objects
    answer = peer.call(Predict, f"{NODE}/predict", predict_request(objects=objects))
    assert answer.result.value == ResultCode.OK, answer.result.message
    got = trajectory_distribution_from_message(answer.distribution)
    # 50 samples of σ = 1 mm + 10 mm/s t: the mean is off by less than 5 σ / sqrt(50).
    truth = [2.0 * 0.2, 0.0, 1.0 - 0.5 * 9.81 * 0.2**2]
    np.testing.assert_allclose(got.mean[0, 2], truth, atol=0.003)


def test_what_the_chosen_engine_cannot_simulate_is_refused():
    arguments = ["-p", "simulator:=event_driven", "-r", "__node:=spheres_only"]
    objects = states_message((BOX,)).objects
    with NodeProcess(MODULE, arguments) as node, Peer("tester") as peer:
        answer = peer.call(Predict, "/spheres_only/predict", predict_request(objects=objects))
        node.check_running()
    assert answer.result.value == ResultCode.UNSUPPORTED_SCENE
    assert "not a sphere" in answer.result.message


def spoilt_objects(change):
    objects = states_message().objects
    change(objects[0])
    return objects


def nan_position(message):
    message.pose.pose.position.x = float("nan")


def zero_quaternion(message):
    message.pose.pose.orientation.w = 0.0


@pytest.mark.parametrize(
    ("changes", "code", "word"),
    [
        ({"objects": []}, ResultCode.INVALID_INPUT, "no objects"),
        (
            {"objects": spoilt_objects(lambda m: setattr(m, "shape", Shape(kind=9)))},
            ResultCode.INVALID_INPUT,
            "kind",
        ),
        ({"objects": spoilt_objects(nan_position)}, ResultCode.INVALID_INPUT, "position"),
        ({"objects": spoilt_objects(zero_quaternion)}, ResultCode.INVALID_INPUT, "orientation"),
        ({"times": [0.0, 0.5, 0.5]}, ResultCode.INVALID_INPUT, "increase"),
        ({"horizon": -1.0}, ResultCode.INVALID_INPUT, "horizon"),
        ({"horizon": float("inf")}, ResultCode.INVALID_INPUT, "horizon"),
        ({"sample_count": 4_000_000_000}, ResultCode.INVALID_INPUT, "ask for fewer"),
        (
            {"environment": EnvironmentMessage(gravity=Vector3(z=float("nan")))},
            ResultCode.INVALID_INPUT,
            "gravity",
        ),
    ],
)
def test_bad_requests_get_a_numbered_answer(peer, changes, code, word):
    answer = peer.call(Predict, f"{NODE}/predict", predict_request(**changes))
    assert answer.result.value == code, answer.result
    assert word in answer.result.message


def test_bad_states_are_one_diagnostic_and_the_node_goes_on(peer, inputs):
    diagnostics = peer.listen(DiagnosticArray, "/diagnostics")
    spoilt = states_message()
    nan_position(spoilt.objects[0])
    feed_until(peer, lambda: told(diagnostics, "object_states", "position"), "a diagnostic", spoilt)
    heard = peer.listen(TrajectoryDistribution, f"{NODE}/trajectory_distribution", SENSOR_DATA)
    feed_until(peer, lambda: heard, "a prediction")


def query(peer, **fields):
    return peer.call(Query, f"{NODE}/query", Query.Request(**fields))


def test_queries(peer, inputs):
    # The ball is at 1 m, so within the horizon of 1 s it surely falls below 0.5 m, at 0.32 s.
    publisher = peer.publisher(ObjectStates, f"{NODE}/object_states", SENSOR_DATA)
    peer.node.create_timer(1 / 30, lambda: publisher.publish(states_message()))
    heard = peer.listen(TrajectoryDistribution, f"{NODE}/trajectory_distribution", SENSOR_DATA)
    peer.spin_until(lambda: heard, "a prediction")
    falls = query(peer, event=Query.Request.FALLS_BELOW, object_id="ball", height=0.5)
    assert falls.result.value == ResultCode.OK, falls.result.message
    assert falls.probability == pytest.approx(1.0)
    assert np.mean(falls.times) == pytest.approx(np.sqrt(2 * 0.5 / 9.81), abs=0.02)
    never = query(peer, event=Query.Request.FALLS_BELOW, object_id="ball", height=-1.0)
    assert never.probability == 0.0
    unknown = query(peer, event=Query.Request.FALLS_BELOW, object_id="cup", height=0.0)
    assert unknown.result.value == ResultCode.UNKNOWN_NAME
    bad_event = query(peer, event=77, object_id="ball")
    assert bad_event.result.value == ResultCode.INVALID_INPUT
    bad_region = query(peer, event=Query.Request.ENTERS_REGION, object_id="ball")
    assert bad_region.result.value == ResultCode.INVALID_INPUT


def test_a_query_without_a_prediction_says_so(peer):
    def refused():
        answer = query(peer, event=Query.Request.FALLS_BELOW, object_id="ball", height=0.0)
        return answer if answer.result.value == ResultCode.NOT_READY else None

    answer = peer.spin_until(refused, "the states to be too old")
    assert "nothing is predicted" in answer.result.message


def test_a_second_node_of_the_same_name_is_told(peer, node):
    diagnostics = peer.listen(DiagnosticArray, "/diagnostics")
    with NodeProcess(MODULE) as second:
        peer.spin_until(
            lambda: any(
                "2 nodes have the name" in s.message for d in diagnostics for s in d.status
            ),
            "a diagnostic of two nodes",
        )
    assert "Traceback" not in second.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_clean(number):
    process = NodeProcess(MODULE, ["-r", "__node:=other_predictor"])
    with Peer("watcher") as peer:
        peer.spin_until(
            lambda: "other_predictor" in peer.node.get_node_names(), "the node to appear"
        )
    assert process.stop(number) == 0
    assert "Traceback" not in process.output


def test_a_bad_parameter_is_one_line(tmp_path):
    process = NodeProcess(MODULE, ["-p", "rate:=-5.0"])
    assert process.wait(20.0) == 1
    assert "rate" in process.output
    assert "Traceback" not in process.output
