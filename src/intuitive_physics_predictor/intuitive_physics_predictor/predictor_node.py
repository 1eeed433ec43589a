"""The predictor node: newest states, environment and θ_s in; trajectory distributions out."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates, ResultCode
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from intuitive_physics_msgs.msg import TrajectoryDistribution as DistributionMessage
from intuitive_physics_msgs.srv import Predict, Query
from numpy.typing import ArrayLike
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.scene import Scene
from intuitive_physics_predictor.compile import warm_up
from intuitive_physics_predictor.live_prediction import (
    Inputs,
    LivePrediction,
    NoObjectsError,
    NothingToPredictError,
    SeenStates,
    predict_now,
    predict_scene,
)
from intuitive_physics_predictor.noisy_newton import PredictionFailedError
from intuitive_physics_predictor.options import PredictionOptions
from intuitive_physics_predictor.pacer import Pacer
from intuitive_physics_predictor.prediction_settings import PredictionSettings, output_times
from intuitive_physics_predictor.question import Answer, Event, Question, answer
from intuitive_physics_ros.background import Background
from intuitive_physics_ros.conversions import (
    DistributionWriter,
    environment_from_message,
    float32_field,
    object_states_from_messages,
    region_from_message,
    seconds_from_stamp,
    stamp_from_seconds,
    static_parameters_from_message,
)
from intuitive_physics_ros.conversions.geometry import point_to_message
from intuitive_physics_ros.diagnostics import Diagnostics
from intuitive_physics_ros.distribution_markers import distribution_markers
from intuitive_physics_ros.input_monitor import InputMonitor
from intuitive_physics_ros.parameters import Parameter, declare_parameters, setting_parameters
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA
from intuitive_physics_ros.rate_monitor import RateMonitor
from intuitive_physics_ros.result_codes import RefusedError, error_result, ok_result
from intuitive_physics_ros.run_node import run_node

PARAMETERS = [
    Parameter("rate", 100.0, "predictions a second", (0.1, 1000.0), read_only=False),
    Parameter(
        "published_samples",
        200,
        "samples in a message at most; mean and covariance are of all",
        (1, 10_000),
        read_only=False,
    ),
    Parameter(
        "seed",
        0,
        "seed of the next prediction's noise, one more each time",
        (0, 2**31 - 1),
        read_only=False,
    ),
    Parameter("marker_rate", 5.0, "RViz marker messages a second", (0.1, 100.0), read_only=False),
    *setting_parameters(PredictionOptions, read_only=False),
]

CODES: dict[type[BaseException], int] = {
    PredictionFailedError: ResultCode.PREDICTION_FAILED,
}

EVENTS = {getattr(Query.Request, event.name): event for event in Event}
"""Events by their number in a request."""
WITH_REGION = (Event.ENTERS_REGION, Event.INTERCEPTS)

SWITCH_INTERVAL = 5e-4
"""s after which a thread that wants to go on gets Python. Making markers takes several ms."""


class PredictorNode(Node):
    """A thread, topics and services around `predict_now` and `answer`."""

    def __init__(self) -> None:
        super().__init__("predictor_node")
        values = declare_parameters(self, PARAMETERS)
        self._settings = settings_from_parameters(values)
        self._seed = values["seed"]
        self._published_samples = values["published_samples"]
        self._inputs = Inputs()
        self._made: LivePrediction | None = None
        self._writer = DistributionWriter()
        self._paused_for = ""
        self._rate = RateMonitor("predicts", values["rate"])
        self._publisher = self.create_publisher(
            DistributionMessage, "~/trajectory_distribution", SENSOR_DATA
        )
        self._marker_publisher = self.create_publisher(MarkerArray, "~/markers", 1)
        self._marker_timer = self.create_timer(1.0 / values["marker_rate"], self._on_marker_tick)
        self._background = Background(self)
        self._hear()
        self._offer()
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)
        warm_up()
        self._pacer = Pacer(self._on_tick, values["rate"])
        self._pacer.start()

    def destroy_node(self) -> None:
        """Stop predicting."""
        self._pacer.stop()
        self._background.stop()
        super().destroy_node()

    def _hear(self) -> None:
        self._monitors = {
            "environment": InputMonitor(self, "~/environment", None),
            "object_states": InputMonitor(self, "~/object_states", 2.0),
            "static_parameters": InputMonitor(self, "~/static_parameters", None),
        }
        for name, kind, take, qos in (
            ("environment", EnvironmentMessage, environment_inputs, LATCHED),
            ("object_states", ObjectStates, states_inputs, SENSOR_DATA),
            ("static_parameters", StaticParametersMessage, parameters_inputs, LATCHED),
        ):
            heard = partial(self._on_input, self._monitors[name], take)
            self.create_subscription(kind, f"~/{name}", heard, qos)
        diagnostics = Diagnostics(self)
        for name, monitor in self._monitors.items():
            diagnostics.add(name, monitor.check)
        diagnostics.add("prediction", self._rate.check)

    def _offer(self) -> None:
        # While an answer is simulated in the background, others must go on.
        together = ReentrantCallbackGroup()
        self.create_service(Predict, "~/predict", self._on_predict, callback_group=together)
        self.create_service(Query, "~/query", self._on_query, callback_group=together)

    def _on_input(self, monitor: InputMonitor, take: Any, message: Any) -> None:
        try:
            self._inputs = replace(self._inputs, **take(message, self._now()))
        except IntuitivePhysicsError as error:
            monitor.rejected(error)
        else:
            monitor.accepted()

    def _on_tick(self, late: float, left_out: int) -> None:
        """Predict from the newest input and publish; runs in the pacer's thread."""
        due, now = time.perf_counter() - late, self._now() - late
        try:
            made = predict_now(
                self._inputs, self._settings, seed=self._seed, now=now, monotonic=time.monotonic()
            )
            message = distribution_message(self._writer, made, self._published_samples)
            message.computation_time = time.perf_counter() - due
            self._publisher.publish(message)
        except Exception as error:
            # A thread that dies would take all prediction with it.
            self._pause(error)
            return
        self._made = made
        self._seed += 1
        self._rate.left_out(left_out)
        self._rate.done(time.perf_counter() - due)
        if self._paused_for:
            self.get_logger().info("predicts again")
            self._paused_for = ""

    def _pause(self, error: Exception) -> None:
        """Say why nothing is predicted now: on /diagnostics, and in the log when it is news."""
        known = isinstance(error, IntuitivePhysicsError)
        reason = str(error) if known else f"internal error, please report: {error!r}"
        self._rate.idle(reason)
        # That states get older is told once; that there are none yet, or no objects, is no news.
        waits = isinstance(error, NothingToPredictError)
        news = type(error).__name__ if waits else reason
        quiet = isinstance(error, NoObjectsError) or (waits and self._made is None)
        if not quiet and news != self._paused_for:
            self.get_logger().warning(f"predicts no more: {reason}")
            self._paused_for = news
        self._made = None

    def _on_marker_tick(self) -> None:
        made = self._made
        if made is not None and self._marker_publisher.get_subscription_count() > 0:
            distribution = made.distribution
            self._marker_publisher.publish(
                distribution_markers(
                    header_of(made),
                    distribution.object_ids,
                    distribution.positions,
                    distribution.mean,
                    distribution.covariance,
                )
            )

    async def _on_predict(
        self, request: Predict.Request, response: Predict.Response
    ) -> Predict.Response:
        started, now = time.perf_counter(), self._now()
        inputs, settings = self._inputs, self._settings
        try:
            response.distribution = await self._background.run(
                lambda: distribution_message(
                    DistributionWriter(), predict_request(request, inputs, settings, now)
                )
            )
            response.distribution.computation_time = time.perf_counter() - started
            response.result = ok_result()
        except Exception as error:
            response.result = self._refusal(error)
        return response

    async def _on_query(self, request: Query.Request, response: Query.Response) -> Query.Response:
        made = self._made
        try:
            if made is None:
                raise RefusedError(
                    ResultCode.NOT_READY,
                    "nothing is predicted now; expected an environment and objects that are seen",
                )
            question = question_from_request(request)
            answered: Answer = await self._background.run(lambda: answer(question, made))
            response.probability = answered.forecast.probability
            response.times = float32_field(answered.forecast.times)
            response.weights = float32_field(answered.forecast.weights)
            if answered.position is not None:
                response.position = point_to_message(answered.position)
                response.time = answered.time
            response.header = header_of(made)
            response.result = ok_result()
        except Exception as error:
            response.result = self._refusal(error)
        return response

    def _refusal(self, error: Exception) -> ResultCode:
        if not isinstance(error, IntuitivePhysicsError):
            self.get_logger().error(f"a request failed: {type(error).__name__}: {error}")
        return error_result(error, CODES)

    def _check_parameters(self, new: Sequence[RosParameter]) -> SetParametersResult:
        """Refuse parameters that are each what they may be, but not together."""
        try:
            settings_from_parameters(self._values() | {one.name: one.value for one in new})
        except IntuitivePhysicsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, new: Sequence[RosParameter]) -> None:
        values, names = self._values(), {one.name for one in new}
        if names & {option.name for option in fields(PredictionOptions)}:
            self._settings = settings_from_parameters(values)
        if "seed" in names:
            self._seed = values["seed"]
        self._published_samples = values["published_samples"]
        if values["rate"] != self._rate.rate:
            self._rate.rate = values["rate"]
            self._pacer.set_rate(values["rate"])
        self._marker_timer.timer_period_ns = round(1e9 / values["marker_rate"])

    def _values(self) -> dict[str, Any]:
        return {known.name: self.get_parameter(known.name).value for known in PARAMETERS}

    def _now(self) -> float:
        return 1e-9 * self.get_clock().now().nanoseconds


def settings_from_parameters(values: dict[str, Any]) -> PredictionSettings:
    """Return the library's settings from the node's parameters by name.

    Raises
    ------
    InvalidInputError
        When horizon, time step and number of samples do not go together.
    """
    options = {option.name: values[option.name] for option in fields(PredictionOptions)}
    return PredictionSettings(PredictionOptions(**options))


def environment_inputs(message: EnvironmentMessage, _: float) -> dict[str, Any]:
    """Return what an environment changes of the inputs."""
    return {
        "environment": environment_from_message(message),
        "environment_version": message.version,
    }


def parameters_inputs(message: StaticParametersMessage, _: float) -> dict[str, Any]:
    """Return what static parameters change of the inputs."""
    return {"learned": static_parameters_from_message(message)}


def states_inputs(message: ObjectStates, now: float) -> dict[str, Any]:
    """Return what object states change of the inputs; `now` is in s by the node's clock."""
    objects, states = object_states_from_messages(message.objects)
    stamp = seconds_from_stamp(message.header.stamp)
    seen = SeenStates(
        tuple(objects),
        tuple(states),
        stamp,
        arrived=time.monotonic(),
        delay=now - stamp,
        frame_id=message.header.frame_id,
    )
    return {"seen": seen}


def predict_request(
    request: Predict.Request, inputs: Inputs, settings: PredictionSettings, now: float
) -> LivePrediction:
    """Predict the scene of a request; what it leaves out is the node's.

    Parameters
    ----------
    now : s, the time its states are taken to be of
    """
    objects, states = object_states_from_messages(request.objects)
    environment, version = inputs.environment, inputs.environment_version
    given, gravity = request.environment, request.environment.gravity
    if given.primitives or any((gravity.x, gravity.y, gravity.z)):
        environment, version = environment_from_message(given), given.version
    if environment is None:
        raise RefusedError(
            ResultCode.NOT_READY,
            "the request has no environment and none was received; send one with the request",
        )
    learned = inputs.learned
    if request.static_parameters:
        learned = static_parameters_from_message(request.static_parameters[0])
    options = settings.options
    times: ArrayLike = request.times
    if not len(request.times):
        times = output_times(
            request.horizon or options.horizon, request.time_step or options.time_step
        )
    return predict_scene(
        Scene(environment, tuple(objects), tuple(states)),
        learned,
        settings,
        times,
        seed=request.seed,
        sample_count=request.sample_count or options.sample_count,
        start=now,
        environment_version=version,
    )


def question_from_request(request: Query.Request) -> Question:
    """Return what a request asks.

    Raises
    ------
    InvalidInputError
        When the event or the region is none that is known.
    """
    if request.event not in EVENTS:
        known = ", ".join(f"{code} ({event.name})" for code, event in EVENTS.items())
        raise InvalidInputError(f"event is {request.event}; expected {known}")
    event = EVENTS[request.event]
    return Question(
        event,
        request.object_id,
        region_from_message(request.region) if event in WITH_REGION else None,
        request.other_id,
        request.height,
        request.reach,
        request.earliest,
        request.sample_count,
        request.horizon,
    )


def header_of(made: LivePrediction) -> Header:
    """Return the time that a prediction begins at, and its frame."""
    return Header(stamp=stamp_from_seconds(made.start), frame_id=made.scene.environment.frame_id)


def distribution_message(
    writer: DistributionWriter, made: LivePrediction, most_samples: int | None = None
) -> DistributionMessage:
    """Write a prediction as a message with so many of its samples at most.

    Samples are drawn independently of one another, so the first ones are a fair choice.
    """
    distribution, header = made.distribution, header_of(made)
    weights = distribution.weights[:most_samples]
    return writer.write(
        frame_id=header.frame_id,
        stamp=header.stamp,
        states_stamp=stamp_from_seconds(made.states_stamp),
        object_ids=distribution.object_ids,
        times=distribution.times,
        positions=distribution.positions[:most_samples],
        weights=weights / weights.sum(),
        simulated_count=distribution.weights.size,
        mean=distribution.mean,
        covariance=distribution.covariance,
        static_parameters_version=made.static_parameters_version,
        environment_version=made.environment_version,
        seed=made.seed,
        computation_time=0.0,
    )


def main() -> int:
    """Run the node until it is told to stop."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_node(make_node)


def make_node() -> PredictorNode:
    """Make the node, and keep the garbage collector from looking at all that lives as long."""
    node = PredictorNode()
    gc.collect()
    gc.freeze()
    return node
