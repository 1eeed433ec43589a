"""The predictor node's services: predictions of any scene, and questions about the newest one."""

from __future__ import annotations

import time
from dataclasses import replace

from intuitive_physics_msgs.msg import ResultCode
from intuitive_physics_msgs.msg import TrajectoryDistribution as DistributionMessage
from intuitive_physics_msgs.srv import Predict, Query
from numpy.typing import ArrayLike
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_predictor.live.live_prediction import LivePrediction, predict_scene
from intuitive_physics_predictor.live.predictor import Snapshot
from intuitive_physics_predictor.live.question import Answer, Event, Question, answer
from intuitive_physics_predictor.live.settings import output_times
from intuitive_physics_predictor.nodes.distribution_messages import DistributionWriter, header_of
from intuitive_physics_predictor.nodes.ticks import PredictionTicks
from intuitive_physics_predictor.noisy_newton import PredictionFailedError
from intuitive_physics_ros.background import Background
from intuitive_physics_ros.conversions import (
    environment_from_message,
    float32_field,
    object_states_from_messages,
    region_from_message,
    static_parameters_from_message,
)
from intuitive_physics_ros.conversions.primitives import point_to_message
from intuitive_physics_ros.lifecycle.kernel_loading import KernelLoading
from intuitive_physics_ros.result_codes import RefusedError, error_result, ok_result
from intuitive_physics_ros.unexpected_errors import unexpected_errors

CODES: dict[type[BaseException], int] = {
    PredictionFailedError: ResultCode.PREDICTION_FAILED,
}
"""Result codes of the predictor's own errors."""

EVENTS = {getattr(Query.Request, event.name): event for event in Event}
"""Events by their number in a request."""

WITH_REGION = (Event.ENTERS_REGION, Event.INTERCEPTS)
"""Events that take the region of a request."""

LONGEST_WAIT = 0.1
"""s that a request waits for inputs and parameters that arrived before it; decoding takes 5 ms."""


class PredictionServices:
    """Answers `~/predict` and `~/query`, each simulated in the background within its time limit.

    Parameters
    ----------
    node : offers them
    ticks : has the newest inputs, settings and prediction
    kernels : without which nothing is simulated
    """

    def __init__(self, node: Node, ticks: PredictionTicks, kernels: KernelLoading) -> None:
        self._node = node
        self._ticks = ticks
        self._kernels = kernels
        self._background = Background(node)
        # While an answer is simulated in the background, others must go on.
        together = ReentrantCallbackGroup()
        node.create_service(Predict, "~/predict", self._on_predict, callback_group=together)
        node.create_service(Query, "~/query", self._on_query, callback_group=together)

    def stop(self, patience: float = 1.0) -> bool:
        """Cancel the request under way; return whether it has ended within `patience` s."""
        return self._background.stop(patience)

    async def _on_predict(
        self, request: Predict.Request, response: Predict.Response
    ) -> Predict.Response:
        started, now = time.perf_counter(), 1e-9 * self._node.get_clock().now().nanoseconds
        try:
            self._kernels.refuse_until_loaded()
            response.distribution = await self._background.run(
                lambda stop: self._predict(request, now, stop)
            )
            response.distribution.computation_time = time.perf_counter() - started
            response.result = ok_result()
        except Exception as error:
            response.result = self._refusal(error)
        return response

    async def _on_query(self, request: Query.Request, response: Query.Response) -> Query.Response:
        made = self._ticks.snapshot.newest
        try:
            self._kernels.refuse_until_loaded()
            if made is None:
                raise RefusedError(
                    ResultCode.NOT_READY,
                    "nothing is predicted now; expected an environment and objects that are seen",
                )
            question = question_from_request(request)
            answered: Answer = await self._background.run(
                lambda stop: answer(question, made.stopped_by(stop))
            )
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

    def _predict(self, request: Predict.Request, now: float, stop: StopFlag) -> DistributionMessage:
        # What was heard and set before the request counts.
        snapshot = self._ticks.settled_snapshot(LONGEST_WAIT)
        snapshot = replace(snapshot, settings=snapshot.settings.stopped_by(stop))
        return DistributionWriter().write(predict_request(request, snapshot, now))

    def _refusal(self, error: Exception) -> ResultCode:
        if not isinstance(error, IntuitivePhysicsError):
            unexpected_errors(self._node).report(error, "a request")
        return error_result(error, CODES)


def predict_request(request: Predict.Request, snapshot: Snapshot, now: float) -> LivePrediction:
    """Predict the scene of a request at `now` (s); the snapshot supplies all that it leaves out."""
    inputs, settings = snapshot.inputs, snapshot.settings
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
    """Return the question of a request; InvalidInputError when event or region is unknown."""
    if request.event not in EVENTS:
        expected = ", ".join(f"{code} ({event.name})" for code, event in EVENTS.items())
        raise InvalidInputError(f"event is {request.event}; expected {expected}")
    event = EVENTS[request.event]
    return Question(
        event,
        request.object_id,
        region=region_from_message(request.region) if event in WITH_REGION else None,
        other_id=request.other_id,
        height=request.height,
        reach=request.reach,
        earliest=request.earliest,
        sample_count=request.sample_count,
        horizon=request.horizon,
    )
