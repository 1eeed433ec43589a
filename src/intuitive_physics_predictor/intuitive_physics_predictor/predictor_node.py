"""The predictor node: newest states, environment and θ_s in; trajectory distributions out."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates, ResultCode
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from intuitive_physics_msgs.msg import TrajectoryDistribution as DistributionMessage
from intuitive_physics_msgs.srv import Predict, Query
from rclpy.node import Node
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.simulation import ENGINE_GUIDE, SIMULATORS, make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noisy_newton import predict
from intuitive_physics_predictor.queries import (
    EventForecast,
    enters_region,
    falls_below,
    touches_object,
)
from intuitive_physics_ros.conversions import (
    environment_from_message,
    float32_field,
    object_states_from_messages,
    region_from_message,
    static_parameters_from_message,
    trajectory_distribution_to_message,
)
from intuitive_physics_ros.diagnostics import Diagnostics
from intuitive_physics_ros.distribution_markers import distribution_markers
from intuitive_physics_ros.input_monitor import InputMonitor
from intuitive_physics_ros.parameters import Parameter, declare_parameters
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA
from intuitive_physics_ros.rate_monitor import RateMonitor
from intuitive_physics_ros.result_codes import RefusedError, error_result, ok_result
from intuitive_physics_ros.run_node import run_node

LARGEST_REQUEST = 50_000_000
"""Numbers in one predicted distribution: what a service answers in some seconds, 200 MB."""

PARAMETERS = [
    Parameter("rate", 100.0, "predictions a second", (0.1, 1000.0)),
    Parameter("horizon", 5.0, "s predicted ahead", (0.01, 60.0), read_only=False),
    Parameter("time_step", 0.01, "s between predicted points", (0.001, 1.0), read_only=False),
    Parameter("sample_count", 20, "simulations a prediction", (1, 10_000), read_only=False),
    Parameter("simulator", "auto", f"engine. {ENGINE_GUIDE}", choices=tuple(SIMULATORS)),
    Parameter("seed", 0, "seed of the noise of the first prediction", (0, 2**31 - 1)),
    Parameter(
        "use_perceived_covariance",
        True,
        "whether samples have the covariance the states were perceived with",
        read_only=False,
    ),
    Parameter("position_noise", 0.0, "m, added to it", (0.0, 10.0), read_only=False),
    Parameter("rotation_noise", 0.0, "rad, added to it", (0.0, 3.2), read_only=False),
    Parameter("velocity_noise", 0.0, "m/s, added to it", (0.0, 100.0), read_only=False),
    Parameter("spin_noise", 0.0, "rad/s, added to it", (0.0, 1000.0), read_only=False),
    Parameter("stale_after", 0.5, "s; older states are not predicted from", (0.01, 60.0)),
    Parameter("marker_rate", 5.0, "RViz marker messages a second", (0.1, 100.0)),
]


@dataclass
class Newest:
    """The newest of each input, as the library knows it."""

    environment: Environment | None = None
    environment_version: int = 0
    learned: LearnedParameters | None = None
    header: Header | None = None
    objects: tuple[SceneObject, ...] = ()
    states: tuple[ObjectState, ...] = ()
    states_arrived: float = -np.inf


@dataclass
class Made:
    """The newest prediction and what it was made from."""

    distribution: TrajectoryDistribution
    header: Header
    scene: Scene


class PredictorNode(Node):
    """Timer, topics and services around `noisy_newton.predict`."""

    def __init__(self) -> None:
        super().__init__("predictor_node")
        values = declare_parameters(self, PARAMETERS)
        self._simulator = make_simulator(values["simulator"])
        self._stale_after = values["stale_after"]
        self._seed = values["seed"]
        self._newest = Newest()
        self._made: Made | None = None
        self._rate = RateMonitor("predicts", values["rate"])

        self._publisher = self.create_publisher(
            DistributionMessage, "~/trajectory_distribution", SENSOR_DATA
        )
        self._marker_publisher = self.create_publisher(MarkerArray, "~/markers", 1)
        self._inputs = {
            "environment": InputMonitor(self, "~/environment", None),
            "object_states": InputMonitor(self, "~/object_states", 2.0),
            "static_parameters": InputMonitor(self, "~/static_parameters", None),
        }
        self.create_subscription(EnvironmentMessage, "~/environment", self._on_environment, LATCHED)
        self.create_subscription(ObjectStates, "~/object_states", self._on_states, SENSOR_DATA)
        self.create_subscription(
            StaticParametersMessage, "~/static_parameters", self._on_parameters, LATCHED
        )
        self.create_service(Predict, "~/predict", self._on_predict)
        self.create_service(Query, "~/query", self._on_query)
        self._diagnostics = Diagnostics(self)
        for name, monitor in self._inputs.items():
            self._diagnostics.add(name, monitor.check)
        self._diagnostics.add("prediction", self._rate.check)
        self.create_timer(1.0 / values["rate"], self._on_tick)
        self.create_timer(1.0 / values["marker_rate"], self._on_marker_tick)

    def _on_environment(self, message: EnvironmentMessage) -> None:
        monitor = self._inputs["environment"]
        try:
            self._newest.environment = environment_from_message(message)
            self._newest.environment_version = message.version
        except IntuitivePhysicsError as error:
            monitor.rejected(error)
        else:
            monitor.accepted()

    def _on_parameters(self, message: StaticParametersMessage) -> None:
        monitor = self._inputs["static_parameters"]
        try:
            self._newest.learned = static_parameters_from_message(message)
        except IntuitivePhysicsError as error:
            monitor.rejected(error)
        else:
            monitor.accepted()

    def _on_states(self, message: ObjectStates) -> None:
        monitor = self._inputs["object_states"]
        try:
            objects, states = object_states_from_messages(message.objects)
        except IntuitivePhysicsError as error:
            monitor.rejected(error)
            return
        monitor.accepted()
        self._newest.header = message.header
        self._newest.objects, self._newest.states = tuple(objects), tuple(states)
        self._newest.states_arrived = time.monotonic()

    def _on_tick(self) -> None:
        """Predict from the newest input and publish."""
        start = time.perf_counter()
        newest = self._newest
        if newest.environment is None or newest.header is None:
            self._rate.idle("no environment or no object states yet")
            return
        if time.monotonic() - newest.states_arrived > self._stale_after:
            self._made = None
            self._rate.idle(f"object states are older than {self._stale_after} s")
            return
        if not newest.objects:
            self._made = None
            self._rate.idle("no objects are seen")
            return
        self._seed += 1
        try:
            scene = Scene(newest.environment, newest.objects, newest.states)
            distribution = self._predict(scene, newest.learned, self._times(), self._seed)
        except IntuitivePhysicsError as error:
            self._rate.idle(str(error))
            return
        self._made = Made(distribution, newest.header, scene)
        message = self._message(self._made, newest, self._seed, time.perf_counter() - start)
        self._publisher.publish(message)
        self._rate.done(time.perf_counter() - start)

    def _on_marker_tick(self) -> None:
        if self._made is not None and self._marker_publisher.get_subscription_count() > 0:
            self._marker_publisher.publish(
                distribution_markers(
                    self._made.header,
                    self._made.distribution.object_ids,
                    self._made.distribution.positions,
                    self._made.distribution.mean,
                    self._made.distribution.covariance,
                )
            )

    def _on_predict(self, request: Predict.Request, response: Predict.Response) -> Predict.Response:
        start = time.perf_counter()
        try:
            scene, learned = self._requested_scene(request)
            times = self._requested_times(request)
            count = request.sample_count or self._value("sample_count")
            if count * len(scene.objects) * times.size * 3 > LARGEST_REQUEST:
                raise InvalidInputError(
                    f"{count} samples of {len(scene.objects)} objects at {times.size} times were "
                    f"asked for; expected at most {LARGEST_REQUEST:,} numbers, ask for fewer"
                )
            distribution = self._predict(scene, learned, times, request.seed, count)
            header = Header(
                stamp=self.get_clock().now().to_msg(), frame_id=scene.environment.frame_id
            )
            elapsed = time.perf_counter() - start
            used = Newest(environment_version=self._newest.environment_version, learned=learned)
            made = Made(distribution, header, scene)
            response.distribution = self._message(made, used, request.seed, elapsed)
            response.result = ok_result()
        except (IntuitivePhysicsError, OverflowError, MemoryError) as error:
            response.result = error_result(error)
        return response

    def _on_query(self, request: Query.Request, response: Query.Response) -> Query.Response:
        try:
            if self._made is None:
                raise RefusedError(
                    ResultCode.NOT_READY,
                    "nothing is predicted now; expected an environment and objects that are seen",
                )
            answer = answer_query(request, self._made.distribution, self._made.scene)
            response.probability = answer.probability
            response.times = float32_field(answer.times)
            response.stamp = self._made.header.stamp
            response.result = ok_result()
        except IntuitivePhysicsError as error:
            response.result = error_result(error)
        return response

    def _requested_scene(self, request: Predict.Request) -> tuple[Scene, LearnedParameters | None]:
        objects, states = object_states_from_messages(request.objects)
        given = request.environment
        gravity = given.gravity
        if given.primitives or any((gravity.x, gravity.y, gravity.z)):
            environment = environment_from_message(given)
        elif self._newest.environment is not None:
            environment = self._newest.environment
        else:
            raise RefusedError(
                ResultCode.NOT_READY,
                "the request has no environment and none was received; send one with the request",
            )
        learned = self._newest.learned
        if request.static_parameters:
            learned = static_parameters_from_message(request.static_parameters[0])
        return Scene(environment, tuple(objects), tuple(states)), learned

    def _requested_times(self, request: Predict.Request) -> np.ndarray:
        if len(request.times):
            return np.asarray(request.times, dtype=np.float64)
        return output_times(
            request.horizon or self._value("horizon"),
            request.time_step or self._value("time_step"),
        )

    def _predict(
        self,
        scene: Scene,
        learned: LearnedParameters | None,
        times: np.ndarray,
        seed: int,
        count: int | None = None,
    ) -> TrajectoryDistribution:
        known = learned or LearnedParameters.defaults(scene.materials)
        # A material nobody has learned of yet moves as the defaults say.
        materials = tuple(dict.fromkeys((*known.materials, *scene.materials)))
        return predict(
            scene,
            known.parameters.extended(materials),
            times,
            rng=np.random.default_rng(seed),
            sample_count=count or self._value("sample_count"),
            noise=StateNoise(
                self._value("use_perceived_covariance"),
                self._value("position_noise"),
                self._value("rotation_noise"),
                self._value("velocity_noise"),
                self._value("spin_noise"),
            ),
            simulator=self._simulator,
        )

    def _message(self, made: Made, used: Newest, seed: int, elapsed: float) -> DistributionMessage:
        distribution = made.distribution
        return trajectory_distribution_to_message(
            frame_id=made.header.frame_id,
            stamp=made.header.stamp,
            object_ids=distribution.object_ids,
            times=distribution.times,
            positions=distribution.positions,
            weights=distribution.weights,
            mean=distribution.mean,
            covariance=distribution.covariance,
            static_parameters_version=used.learned.version if used.learned else 0,
            environment_version=used.environment_version,
            seed=seed,
            computation_time=elapsed,
        )

    def _times(self) -> np.ndarray:
        return output_times(self._value("horizon"), self._value("time_step"))

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value


def answer_query(
    request: Query.Request, distribution: TrajectoryDistribution, scene: Scene
) -> EventForecast:
    """Forecast the event that a request asks about."""
    if request.event == Query.Request.ENTERS_REGION:
        region = region_from_message(request.region)
        return enters_region(distribution, request.object_id, region)
    if request.event == Query.Request.FALLS_BELOW:
        gravity = scene.environment.gravity
        return falls_below(distribution, request.object_id, request.height, gravity)
    if request.event == Query.Request.TOUCHES_OBJECT:
        pair = (request.object_id, request.other_object_id)
        radii = [scene.objects[distribution.index(id)].shape.bounding_radius for id in pair]
        return touches_object(distribution, *pair, sum(radii))
    raise InvalidInputError(
        f"event is {request.event}; expected {Query.Request.ENTERS_REGION} (ENTERS_REGION), "
        f"{Query.Request.TOUCHES_OBJECT} (TOUCHES_OBJECT) or "
        f"{Query.Request.FALLS_BELOW} (FALLS_BELOW)"
    )


def output_times(horizon: float, time_step: float) -> np.ndarray:
    """Return times from 0 to `horizon` (s) every `time_step` (s), shape (n_times,).

    Raises
    ------
    InvalidInputError
        When one of them is not above zero or there would be more than a million times.
    """
    if not (0.0 < time_step <= horizon < np.inf) or horizon / time_step > 1e6:
        raise InvalidInputError(
            f"horizon is {horizon} s and time step {time_step} s; expected "
            "0 < time step ≤ horizon, and at most a million times"
        )
    return np.arange(int(horizon / time_step + 1e-9) + 1) * time_step


def main() -> int:
    """Run the node until it is told to stop."""
    return run_node(PredictorNode)
