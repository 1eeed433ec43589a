"""The predictor node as a process, over DDS."""

from __future__ import annotations

import signal
import time
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import (
    ObjectStates,
    Region,
    ResultCode,
    TrajectoryDistribution,
)
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from intuitive_physics_msgs.srv import Predict, Query
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import (
    DescribeParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Detections
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.live.live_prediction import Inputs
from intuitive_physics_predictor.live.predictor import Snapshot
from intuitive_physics_predictor.live.settings import PredictionOptions, PredictionSettings
from intuitive_physics_predictor.nodes.services import PredictionServices
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    seconds_from_stamp,
    static_parameters_to_message,
)
from intuitive_physics_ros.lifecycle.kernel_loading import KernelLoading
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer

MODULE = "intuitive_physics_predictor.nodes.predictor_node"
NODE = "/predictor_node"
ENVIRONMENT = Environment([Plane("floor", "room", (0, 0, 1), 0.0)], frame_id="lab")
BALL = SceneObject("ball", "rubber", Sphere(0.05))
SETTINGS = PredictionSettings(PredictionOptions())
COVARIANCE = np.diag([1e-6] * 3 + [0.0] * 3 + [1e-4] * 3 + [1.0] * 3)
FLYING = ObjectState((0, 0, 1.0), (0, 0, 0, 1), (2.0, 0, 0), (0, 0, 0), COVARIANCE)


@pytest.fixture(scope="module")
def node():
    # On a busy machine states may be late.
    with NodeProcess(MODULE, ["-p", "horizon:=1.0", "-p", "stale_after:=2.0"]) as process:
        yield process


@pytest.fixture
def peer(node):
    with Peer("tester", timeout=60.0) as peer:
        yield peer
    node.check_running()
    assert "Traceback" not in node.output


def states_message(objects=(BALL,), states=(FLYING,), age=0.0, frame_id="lab"):
    """States that were seen `age` s ago."""
    sec, nanosec = divmod(time.time_ns() - round(1e9 * age), 1_000_000_000)
    stamp = Time(sec=sec, nanosec=nanosec)
    return object_states_to_message(objects, states, frame_id=frame_id, stamp=stamp)


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


def feed_until(peer, holds, what, make=states_message):
    """Publish states about 30 times a second until something holds, and return what."""
    publisher = peer.publisher(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)

    def feed():
        publisher.publish(make())
        peer.spin_for(1 / 30)

    answer = peer.spin_until(lambda: holds() or feed(), what)
    peer.node.destroy_publisher(publisher)
    return answer


def reports(diagnostics, name, text):
    """Whether a diagnostic of the node has this text."""
    return any(
        status.name == f"predictor_node: {name}" and text in status.message
        for message in diagnostics
        for status in message.status
    )


@pytest.fixture
def inputs(peer):
    """Publish environment and parameters, latched: the node gets them whenever it connects."""
    environment = peer.publisher(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
    environment.publish(environment_to_message(ENVIRONMENT, version=3))
    parameters = peer.publisher(
        StaticParametersMessage, "intuitive_physics/static_parameters", LATCHED
    )
    parameters.publish(static_parameters_to_message(LearnedParameters.defaults(["rubber", "room"])))


AGE = 0.2


def age_of(message):
    """Age of the states, in s, that a prediction was made from."""
    return seconds_from_stamp(message.header.stamp) - seconds_from_stamp(message.states_stamp)


def mean_of(message):
    """Mean (n_times, 3), m, of the one object that is predicted."""
    return np.reshape(message.objects[0].mean, (-1, 3))


def test_states_are_carried_forward_to_now(peer, inputs):
    # States seen 0.2 s ago and more. Free flight of the mean from them: x = v t, z = z0 - g t²/2,
    # until the ball lands at 0.44 s; the times published count from the tick.
    heard = peer.listen(TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA)
    markers = peer.listen(MarkerArray, f"{NODE}/markers")
    sent = []

    def make():
        sent.append(states_message(age=AGE))
        return sent[-1]

    feed_until(peer, lambda: len(heard) > 50 and markers, "50 predictions and markers", make)
    # To the nanosecond, which no double of seconds holds.
    stamps = [message.header.stamp for message in sent]
    assert all(message.states_stamp in stamps for message in heard)
    # The one of the newest states: a busy machine may bring some late.
    got = min(heard, key=age_of)
    assert got.header.frame_id == "lab"
    assert got.environment_version == 3
    assert (got.sample_count, got.simulated_count) == (20, 20)
    times = np.array(got.times)
    assert times.shape == (101,)
    assert (times[0], times[-1]) == (0.0, pytest.approx(1.0))
    age = age_of(got)
    # A tick that is late, as on a busy machine, counts from when it was due.
    assert AGE - 0.1 < age < AGE + 0.2
    # Each has noise of its own; one or another may be lost on the way.
    assert all(a.seed < b.seed for a, b in pairwise(heard))
    flying = age + times < 0.42
    t = age + times[flying]
    truth = np.stack([2.0 * t, 0 * t, 1.0 - 0.5 * 9.81 * t**2], axis=1)
    # 20 samples of σ = 1 mm + 10 mm/s t: the mean is off by less than 4 σ / sqrt(20).
    np.testing.assert_allclose(mean_of(got)[flying], truth, atol=0.006)
    assert {"samples", "mean", "covariance"} <= {m.ns for m in markers[-1].markers}


def test_predictions_stop_and_start_with_the_object_states(peer, inputs, node):
    heard = peer.listen(TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA)
    diagnostics = peer.listen(DiagnosticArray, "/diagnostics")
    feed_until(peer, lambda: heard, "a prediction")
    diagnostics.clear()
    stale = "expected at most 2 s"
    peer.spin_until(lambda: reports(diagnostics, "prediction", stale), f"a diagnostic: {stale}")
    peer.spin_for(0.5)
    count = len(heard)
    peer.spin_for(1.0)
    assert len(heard) == count
    assert "predicts no more: the newest object states are" in node.output
    feed_until(peer, lambda: len(heard) > count, "a prediction again")
    peer.spin_until(lambda: "predicts again" in node.output, "a word that it predicts again")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"age": 3.0}, "arrive 3.0 s old"),
        ({"age": -3.0}, "in the future"),
        ({"objects": (), "states": ()}, "no objects are seen"),
        ({"frame_id": "moon"}, "expected 'lab'"),
    ],
)
def test_unusable_states_are_reported_and_nothing_is_published(peer, inputs, changes, reason):
    heard = peer.listen(TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA)
    feed_until(peer, lambda: heard, "a prediction")
    diagnostics = peer.listen(DiagnosticArray, "/diagnostics")
    make = partial(states_message, **changes)
    feed_until(peer, lambda: reports(diagnostics, "prediction", reason), reason, make)
    count = len(heard)
    end = time.monotonic() + 0.5
    feed_until(peer, lambda: time.monotonic() > end, "half a second", make)
    assert len(heard) == count


def parameter_messages(values):
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


def set_parameters(peer, **values):
    request = SetParameters.Request(parameters=parameter_messages(values))
    return peer.call(SetParameters, f"{NODE}/set_parameters", request).results


def test_all_parameters_may_be_set_while_the_node_runs(peer, inputs):
    names = peer.call(ListParameters, f"{NODE}/list_parameters", ListParameters.Request())
    of_ros = {"use_sim_time", "start_type_description_service"}
    of_node = [
        name
        for name in names.result.names
        if name not in of_ros and not name.startswith("qos_overrides.")
    ]
    request = DescribeParameters.Request(names=of_node)
    descriptors = peer.call(DescribeParameters, f"{NODE}/describe_parameters", request).descriptors
    assert {"rate", "horizon", "sample_count", "stale_after", "marker_rate"} <= set(of_node)
    for parameter in descriptors:
        name = parameter.name
        assert parameter.description, name
        assert parameter.read_only is (name in ("autostart", "calibration_file")), name
        is_number = parameter.type in (Parameter.Type.INTEGER.value, Parameter.Type.DOUBLE.value)
        assert is_number == bool(parameter.integer_range or parameter.floating_point_range), name


def test_parameters_count_from_the_next_prediction(peer, inputs):
    heard = peer.listen(TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA)
    feed_until(peer, lambda: heard, "a prediction")
    try:
        changes = {"horizon": 0.5, "sample_count": 30, "published_samples": 10, "seed": 1_000_000}
        assert all(r.successful for r in set_parameters(peer, rate=20.0, **changes))
        heard.clear()
        feed_until(peer, lambda: len(heard) > 30, "30 predictions")
        got = heard[-1]
        assert (len(got.times), got.sample_count, got.simulated_count) == (51, 10, 30)
        assert sum(got.weights) == pytest.approx(1.0, abs=1e-6)
        assert got.seed >= 1_000_000
        stamps = [seconds_from_stamp(message.header.stamp) for message in heard[5:]]
        # New states bring a prediction forward, by a period at most, and make no more of them.
        periods = np.diff(stamps) * 20.0
        assert periods.min() > 0.0
        assert len(periods) <= periods.sum() + 1.0
    finally:
        set_parameters(peer, rate=100.0, horizon=1.0, sample_count=20, published_samples=200)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"time_step": 1.0, "horizon": 0.5}, "time step"),
        ({"sample_count": 10_000, "horizon": 60.0, "time_step": 0.001}, "ask for fewer"),
        ({"rate": 0.0}, "rate"),
        ({"simulator": "crystal_ball"}, "simulator"),
    ],
)
def test_invalid_parameters_are_refused_and_change_nothing(peer, values, word):
    request = SetParametersAtomically.Request(parameters=parameter_messages(values))
    name = f"{NODE}/set_parameters_atomically"
    answer = peer.call(SetParametersAtomically, name, request).result
    assert not answer.successful
    assert word in answer.reason


def test_late_tick_is_left_out_and_reported():
    # A prediction of 400 boxes 5 s ahead takes far longer than 10 ms.
    arguments = ["-p", "sample_count:=400", "-p", "simulator:=stepped", "-r", "__node:=slow"]
    with NodeProcess(MODULE, arguments) as node, Peer("tester") as peer:
        environment = peer.publisher(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
        environment.publish(environment_to_message(ENVIRONMENT))
        states = peer.publisher(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
        peer.node.create_timer(1 / 30, lambda: states.publish(states_message((BOX,))))
        heard = peer.listen(DiagnosticArray, "/diagnostics")

        def left_out():
            values = [
                value.value
                for message in heard
                for status in message.status
                if status.name == "slow: prediction"
                for value in status.values
                if value.key == "left out since the start"
            ]
            return [int(value) for value in values if int(value) > 0]

        peer.spin_until(left_out, "ticks that were left out")
        node.check_running()


def test_predict_answers_any_scene_and_the_same_to_the_same_seed(peer):
    first = peer.call(Predict, f"{NODE}/predict", predict_request())
    again = peer.call(Predict, f"{NODE}/predict", predict_request())
    other = peer.call(Predict, f"{NODE}/predict", predict_request(seed=8))
    assert first.result.value == ResultCode.OK, first.result.message
    got = first.distribution
    assert [each.object_id for each in got.objects] == ["ball"]
    assert (got.sample_count, len(got.times)) == (50, 11)
    assert first.distribution.objects[0].samples == again.distribution.objects[0].samples
    assert first.distribution.objects[0].samples != other.distribution.objects[0].samples


BOX = SceneObject("box", "rubber", Box((0.1, 0.2, 0.1)))


def test_predict_answers_boxes_too(peer):
    # Free flight of the mean as above, for the box is no lower than 0.8 m at 0.2 s.
    objects = states_message((BOX,)).objects
    answer = peer.call(Predict, f"{NODE}/predict", predict_request(objects=objects))
    assert answer.result.value == ResultCode.OK, answer.result.message
    # 50 samples of σ = 1 mm + 10 mm/s t: the mean is off by less than 5 σ / sqrt(50).
    truth = [2.0 * 0.2, 0.0, 1.0 - 0.5 * 9.81 * 0.2**2]
    np.testing.assert_allclose(mean_of(answer.distribution)[2], truth, atol=0.003)


def test_scene_unsupported_by_the_engine_is_refused():
    arguments = ["-p", "simulator:=bullet", "-r", "__node:=without_rolling"]
    objects = states_message((BOX,)).objects
    with NodeProcess(MODULE, arguments) as node, Peer("tester") as peer:
        answer = peer.call(Predict, "/without_rolling/predict", predict_request(objects=objects))
        node.check_running()
    assert answer.result.value == ResultCode.UNSUPPORTED_SCENE
    assert "bullet" in answer.result.message


def spoilt_objects(change):
    objects = states_message().objects
    change(objects[0])
    return objects


def nan_position(message):
    message.pose.pose.position.x = float("nan")


def below_the_floor(message):
    message.pose.pose.position.z = 0.01


def too_fast(message):
    velocity = message.twist.twist.linear
    velocity.x, velocity.y, velocity.z = 1e308, 1e308, -1e308


@pytest.mark.parametrize(
    ("changes", "code", "word"),
    [
        ({"objects": []}, ResultCode.INVALID_INPUT, "no objects"),
        ({"objects": spoilt_objects(nan_position)}, ResultCode.INVALID_INPUT, "position"),
        ({"times": [0.0, 0.5, 0.5]}, ResultCode.INVALID_INPUT, "increase"),
        ({"horizon": -1.0}, ResultCode.INVALID_INPUT, "horizon"),
        ({"objects": spoilt_objects(below_the_floor)}, ResultCode.INVALID_INPUT, "overlaps"),
        ({"objects": spoilt_objects(too_fast)}, ResultCode.PREDICTION_FAILED, "none of 50"),
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

    def spoilt():
        message = states_message()
        nan_position(message.objects[0])
        return message

    feed_until(
        peer, lambda: reports(diagnostics, "object_states", "position"), "a diagnostic", spoilt
    )
    heard = peer.listen(TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA)
    feed_until(peer, lambda: heard, "a prediction")


def query(peer, **fields):
    return peer.call(Query, f"{NODE}/query", Query.Request(**fields))


@pytest.fixture
def fed(peer, inputs):
    """States 30 times a second, always those of the same throw, and a prediction of them."""
    publisher = peer.publisher(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
    timer = peer.node.create_timer(1 / 30, lambda: publisher.publish(states_message()))
    heard = peer.listen(TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA)
    peer.spin_until(lambda: heard, "a prediction")
    yield heard
    peer.node.destroy_timer(timer)


def region(kind, x=0.0, z=0.0, size=1.0):
    where = Pose(position=Point(x=x, z=z), orientation=Quaternion(w=1.0))
    edges = Vector3(x=size, y=size, z=size)
    return Region(kind=kind, pose=where, radius=size, edge_lengths=edges, normal=Vector3(z=1.0))


HALF_SPACE = Region(kind=Region.HALF_SPACE, normal=Vector3(z=1.0), offset=0.5)
FALL = np.sqrt(2 * 0.5 / 9.81)
LANDING = np.sqrt(2 * 0.95 / 9.81)


def query_of_new_state(peer, fed, **fields):
    """An answer about the ball, and the age (s) of the states it was predicted from.

    On a busy machine a state may be so old that the event lies behind it: then it asks again.
    """
    ages = []

    def asked_in_time():
        answer = query(peer, object_id="ball", **fields)
        assert answer.result.value == ResultCode.OK, answer.result.message

        def asked():
            return [message for message in fed if message.header.stamp == answer.header.stamp]

        ages.append(age_of(peer.spin_until(asked, "the prediction that was asked")[0]))
        return answer if ages[-1] < 0.2 else None

    return peer.spin_until(asked_in_time, "an answer from a new state"), ages[-1]


@pytest.mark.parametrize(
    ("fields", "chance", "when"),
    [
        ({"event": Query.Request.FALLS_BELOW, "height": 0.5}, 1.0, FALL),
        ({"event": Query.Request.ENTERS_REGION, "region": HALF_SPACE}, 1.0, FALL),
        # At x = 0.6 after 0.3 s it is 0.44 m below where it began.
        (
            {"event": Query.Request.ENTERS_REGION, "region": region(Region.BOX, 0.65, 0.5, 0.2)},
            1.0,
            0.55 / 2,
        ),
        (
            {"event": Query.Request.ENTERS_REGION, "region": region(Region.SPHERE, -1.0, 0.5, 0.5)},
            0.0,
            None,
        ),
        ({"event": Query.Request.TOUCHES, "other_id": "floor"}, 1.0, LANDING),
        # It bounces on all through the second that is looked at.
        ({"event": Query.Request.COMES_TO_REST}, 0.0, None),
    ],
)
def test_queries(peer, fed, fields, chance, when):
    # The ball is thrown level from 1 m at 2 m/s; times count from when the prediction begins.
    answer, age = query_of_new_state(peer, fed, sample_count=40, **fields)
    assert answer.probability == pytest.approx(chance)
    assert len(answer.times) == len(answer.weights) == round(40 * chance)
    assert sum(answer.weights) == pytest.approx(chance, abs=1e-6)
    assert answer.header.frame_id == "lab"
    if when is not None:
        # 10 ms between outputs; the mean of 40 samples of σ = 1 mm + 10 mm/s t is good to a ms.
        assert np.mean(answer.times) + age == pytest.approx(when, abs=0.015)


def test_query_of_interception_gives_place_and_time(peer, fed):
    # Within a box on its way down.
    answer, _ = query_of_new_state(
        peer,
        fed,
        event=Query.Request.INTERCEPTS,
        region=region(Region.BOX, 0.7, 0.5, 0.5),
        reach=0.05,
    )
    assert answer.probability == pytest.approx(1.0)
    assert 0.45 <= answer.position.x <= 0.95
    assert list(answer.times) == [pytest.approx(answer.time)]
    # On the parabola: z = 1 - g x² / (2 v²).
    assert answer.position.z == pytest.approx(1 - 9.81 * answer.position.x**2 / 8, abs=0.02)


def test_a_query_may_look_farther_than_the_node(peer, fed):
    # In a second it is still moving; in a minute it lies still unless hardly anything resists it,
    # which nobody knows of these materials.
    far = query(peer, event=Query.Request.COMES_TO_REST, object_id="ball", horizon=60.0)
    assert far.result.value == ResultCode.OK, far.result.message
    assert far.probability > 0.1
    assert max(far.times) > 1.0


@pytest.mark.parametrize(
    ("fields", "code", "word"),
    [
        (
            {"event": Query.Request.FALLS_BELOW, "object_id": "cup"},
            ResultCode.UNKNOWN_NAME,
            "expected one of ball",
        ),
        ({"event": 77}, ResultCode.INVALID_INPUT, "event is 77"),
        ({"event": Query.Request.ENTERS_REGION}, ResultCode.INVALID_INPUT, "region kind"),
        (
            {"event": Query.Request.FALLS_BELOW, "height": float("nan")},
            ResultCode.INVALID_INPUT,
            "height",
        ),
        (
            {"event": Query.Request.COMES_TO_REST, "sample_count": 4_000_000_000},
            ResultCode.INVALID_INPUT,
            "ask for fewer",
        ),
    ],
)
def test_bad_questions_get_a_numbered_answer(peer, fed, fields, code, word):
    answer = query(peer, **{"object_id": "ball", **fields})
    assert answer.result.value == code, answer.result
    assert word in answer.result.message


FAST = ObjectState((0, 0, 100.0), (0, 0, 0, 1), (1e307, 0, 0), (0, 0, 0), COVARIANCE)
"""Where it is after 1 s is still a number that float64 holds; after 18 s it is none."""


def test_query_that_cannot_be_simulated_is_refused(peer, inputs):
    heard = peer.listen(TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA)
    make = partial(states_message, states=(FAST,))

    def high():
        return heard and heard[-1].objects[0].mean[2] > 90.0

    feed_until(peer, high, "a prediction of the fast ball", make)
    event = Query.Request.COMES_TO_REST
    near = query(peer, event=event, object_id="ball", horizon=1.0)
    assert near.result.value == ResultCode.OK, near.result.message
    far = query(peer, event=event, object_id="ball", horizon=20.0)
    assert far.result.value == ResultCode.PREDICTION_FAILED
    assert "none of 20 samples could be simulated to the end" in far.result.message


def test_unexpected_exception_is_an_internal_error_and_the_service_goes_on(peer):
    # No request should lead to it. A prediction that is none stands for a defect; the service is
    # the node's, in this process.
    ticks = SimpleNamespace(snapshot=Snapshot(Inputs(), SETTINGS, object()))
    services = PredictionServices(peer.node, ticks, KernelLoading(peer.node, None))
    try:
        broken = peer.call(Query, "/tester/query", Query.Request(object_id="ball", event=3))
        assert broken.result.value == ResultCode.INTERNAL_ERROR
        assert broken.result.message.startswith("AttributeError: ")
        ticks.snapshot = Snapshot(Inputs(), SETTINGS)
        after = peer.call(Query, "/tester/query", Query.Request(object_id="ball", event=3))
        assert after.result.value == ResultCode.NOT_READY
    finally:
        services.stop()


def test_a_long_request_does_not_stop_the_predictions(peer, fed):
    # 3000 boxes 5 s ahead take seconds.
    request = predict_request(
        objects=states_message((BOX,)).objects, horizon=5.0, sample_count=3000
    )
    start = time.monotonic()
    peer.call(Predict, f"{NODE}/predict", request, timeout=60.0)
    seconds = time.monotonic() - start
    stamps = [seconds_from_stamp(message.header.stamp) for message in fed]
    during = [stamp for stamp in stamps if stamp > time.time() - seconds]
    # On a busy machine it is slower, but goes on: it never waits for the request's end.
    assert len(during) > 2 * seconds
    assert np.diff(during).max() < seconds / 2


def test_a_request_without_environment_before_any_was_heard():
    arguments = ["-r", "__node:=new_predictor"]
    with NodeProcess(MODULE, arguments) as node, Peer("tester") as peer:
        request = predict_request(environment=EnvironmentMessage())
        answer = peer.call(Predict, "/new_predictor/predict", request)
        node.check_running()
    assert answer.result.value == ResultCode.NOT_READY
    assert "no environment" in answer.result.message


def test_query_without_a_prediction_is_not_ready(peer):
    def refused():
        answer = query(peer, event=Query.Request.FALLS_BELOW, object_id="ball", height=0.0)
        return answer if answer.result.value == ResultCode.NOT_READY else None

    answer = peer.spin_until(refused, "the states to be too old")
    assert "nothing is predicted" in answer.result.message


def test_quality_of_service_is_a_parameter():
    override = "qos_overrides./intuitive_physics/predictions.publisher.reliability:="
    arguments = ["-r", "__node:=overridden", "-p", f"{override}best_effort"]
    with NodeProcess(MODULE, arguments), Peer("watcher") as peer:

        def reliability():
            ends = peer.node.get_publishers_info_by_topic("/intuitive_physics/predictions")
            return [end.qos_profile.reliability for end in ends if end.node_name == "overridden"]

        peer.spin_until(reliability, "the node to appear", 60.0)
        assert reliability() == [ReliabilityPolicy.BEST_EFFORT]
    process = NodeProcess(MODULE, ["-p", f"{override}sometimes"])
    assert process.wait(60.0) == 1
    assert "QoS override for policy `reliability`: `sometimes`" in process.output
    assert "Traceback" not in process.output


def test_estimated_states_are_published(peer, inputs):
    # In free flight, detected to 1 mm at 30 Hz: the speed becomes known better than the 10 mm/s
    # that each message alone says.
    heard = peer.listen(ObjectStates, f"{NODE}/estimated_states", SENSOR_DATA)
    began = time.time()

    def flying():
        message = states_message()
        stamp = seconds_from_stamp(message.header.stamp)
        after = (stamp - began) % 0.4
        place = np.array([2.0 * after, 0.0, 1.0 - 4.905 * after**2])
        velocity = (2.0, 0.0, -9.81 * after)
        state = ObjectState(place, linear_velocity=velocity, covariance=COVARIANCE)
        detection = Detections([stamp], [place], [1e-6 * np.eye(3)], np.zeros((3, 3)))
        return object_states_to_message(
            [BALL], [state], frame_id="lab", stamp=message.header.stamp, detections=[detection]
        )

    def is_more_certain():
        variances = [message.objects[0].twist.covariance[0] for message in heard]
        return any(variance < 0.5 * COVARIANCE[6, 6] for variance in variances)

    feed_until(peer, is_more_certain, "a speed that is more certain", flying)


COMPILES = """
import threading, time
from pathlib import Path
import intuitive_physics_predictor.compile as compilation
from intuitive_physics.kernels.cache import KernelCache

def warm_up(warm_up=compilation.warm_up):
    KernelCache.listeners[threading.get_ident()]()
    while not Path({!r}).exists():
        time.sleep(0.01)
    warm_up()

compilation.warm_up = warm_up
"""
"""In place of a cache without kernels: compiles until a file appears."""


def test_requests_are_refused_while_kernels_are_compiled(tmp_path):
    done = tmp_path / "done"
    arguments = ["-r", "__ns:=/cold"]
    with (
        NodeProcess(MODULE, arguments, first=COMPILES.format(str(done))) as node,
        Peer("tester", timeout=60.0) as peer,
    ):
        state = peer.call(
            GetState, "/cold/predictor_node/get_state", GetState.Request()
        ).current_state
        assert state.label == "active"
        for kind, name, request in (
            (Predict, "predict", predict_request()),
            (Query, "query", Query.Request()),
        ):
            result = peer.call(kind, f"/cold/predictor_node/{name}", request).result
            assert result.value == ResultCode.NOT_READY
            assert "compiling kernels, about a minute, once; ask again" in result.message
        # Who waits for a subscriber waits for the kernels.
        assert peer.node.count_subscribers("/cold/intuitive_physics/object_states") == 0
        done.touch()
        peer.spin_until(
            lambda: peer.node.count_subscribers("/cold/intuitive_physics/object_states"),
            "a subscription",
        )
        answer = peer.call(Predict, "/cold/predictor_node/predict", predict_request())
        assert answer.result.value == ResultCode.OK, answer.result.message
        assert node.stop(signal.SIGTERM) == 0
        assert "Traceback" not in node.output
