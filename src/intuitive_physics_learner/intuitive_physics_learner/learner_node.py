"""The learner as a ROS node: observations in, versions of θ_s out."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import LearningOptions as LearningOptionsMessage
from intuitive_physics_msgs.msg import Observation as ObservationMessage
from intuitive_physics_msgs.msg import ParameterBounds, ResultCode
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from intuitive_physics_msgs.srv import (
    AddObservation,
    GetStaticParameters,
    Learn,
    SetStaticParameters,
)
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.parameter_space import Bounds, ParameterSpace
from intuitive_physics.simulation import ENGINE_GUIDE, SIMULATORS, make_simulator
from intuitive_physics_learner.convergence import ConvergenceCriteria
from intuitive_physics_learner.database_path import default_database_path
from intuitive_physics_learner.errors import (
    LearningCancelledError,
    MissingDependencyError,
    NoObservationsError,
    StorageError,
    UnknownMethodError,
)
from intuitive_physics_learner.learning_job import JobProgress, LearningJob
from intuitive_physics_learner.learning_session import (
    LearningOptions,
    learn_from_store,
)
from intuitive_physics_learner.observation_store import ObservationStore
from intuitive_physics_learner.update_rules import UPDATE_RULES
from intuitive_physics_ros.conversions import (
    bounds_from_messages,
    observation_from_message,
    static_parameters_from_message,
    static_parameters_to_message,
)
from intuitive_physics_ros.diagnostics import Diagnostics, Level, Status
from intuitive_physics_ros.input_monitor import InputMonitor
from intuitive_physics_ros.parameters import Parameter, declare_parameters
from intuitive_physics_ros.qos import LATCHED
from intuitive_physics_ros.result_codes import RefusedError, error_result, ok_result
from intuitive_physics_ros.run_node import run_node

OBSERVATIONS = QoSProfile(
    depth=50,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""A learner that starts late, or again, still gets the newest observations."""

CODES: dict[type[BaseException], int] = {
    NoObservationsError: ResultCode.NO_OBSERVATIONS,
    UnknownMethodError: ResultCode.UNKNOWN_METHOD,
    MissingDependencyError: ResultCode.UNKNOWN_METHOD,
    LearningCancelledError: ResultCode.CANCELLED,
    StorageError: ResultCode.STORAGE_FAILED,
}

STOP_PATIENCE = 2.0
"""s to wait at the end for a search to stop; it is asked after every batch of candidates."""


def node_parameters() -> tuple[Parameter, ...]:
    """Parameters of the node; those that are not read-only count from the next search on."""
    return (
        Parameter(
            "database",
            str(default_database_path()),
            "SQLite file of observations and learned parameters; made where it does not exist",
        ),
        Parameter(
            "simulator",
            "auto",
            f"engine that simulates candidates. {ENGINE_GUIDE}",
            choices=tuple(SIMULATORS),
        ),
        Parameter("method", "cma_es", "update rule", choices=tuple(UPDATE_RULES), read_only=False),
        Parameter(
            "max_iterations",
            2000,
            "evaluations of the cost J at most",
            range=(1, 10_000_000),
            read_only=False,
        ),
        Parameter(
            "max_iterations_without_gain",
            0,
            "stop after so many evaluations of J without gain; 0: never for that reason",
            range=(0, 10_000_000),
            read_only=False,
        ),
        Parameter(
            "cost_threshold",
            0.0,
            "m, stop when J falls below this",
            range=(0.0, 1000.0),
            read_only=False,
        ),
        Parameter(
            "time_limit",
            0.0,
            "s of wall time for a search at most; 0: no limit",
            range=(0.0, 1e6),
            read_only=False,
        ),
        Parameter("seed", 0, "of the search's random numbers", range=(0, 2**62), read_only=False),
    )


class WorkerSignal:
    """Lets callbacks of a node wait, without blocking it, for what happens in another thread."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._future = Future()

    def next(self) -> Future:
        """Return what to await; take it before looking at the state that may change."""
        return self._future

    def set(self) -> None:
        """Wake all that wait; from any thread."""
        happened, self._future = self._future, Future()
        happened.set_result(None)
        executor = self._node.executor
        if executor is not None:
            # An executor that is just shutting down has nobody left to wake.
            with suppress(InvalidHandle):
                executor.wake()


class LearnerNode(Node):
    """Stores observations, learns from them when asked, publishes what it knows."""

    def __init__(self) -> None:
        super().__init__("learner_node")
        values = declare_parameters(self, node_parameters())
        self._simulator = make_simulator(values["simulator"])
        self._store = ObservationStore(values["database"])
        self._materials = observation_materials(self._store.observations())
        self._newest = self._store.newest_parameters()
        self._job: LearningJob | None = None
        self._job_changed = WorkerSignal(self)
        self._input = InputMonitor(self, "~/observation", timeout=None)
        self._publisher = self.create_publisher(
            StaticParametersMessage, "~/static_parameters", LATCHED
        )
        self._offer()
        self._publish()
        diagnostics = Diagnostics(self)
        diagnostics.add("observation input", self._input.check)
        diagnostics.add("learning", self._check_learning)
        self.get_logger().info(
            f"{self._store.path} holds {self._store.count()} observations and "
            f"version {self._newest.version if self._newest else 0} of the static parameters"
        )

    def destroy_node(self) -> None:
        """Stop a search that runs and close the database."""
        if self._job is not None and not self._job.stop(STOP_PATIENCE):
            self.get_logger().warning("the search did not stop in time and is left behind")
        self._store.close()
        super().destroy_node()

    def _offer(self) -> None:
        # While a search waits in a callback, others of its group must go on.
        together = ReentrantCallbackGroup()
        self.create_subscription(
            ObservationMessage, "~/observation", self._on_observation, OBSERVATIONS
        )
        self.create_service(AddObservation, "~/add_observation", self._on_add_observation)
        self.create_service(
            GetStaticParameters, "~/get_static_parameters", self._on_get_static_parameters
        )
        self.create_service(
            SetStaticParameters, "~/set_static_parameters", self._on_set_static_parameters
        )
        self.create_service(Learn, "~/learn", self._on_learn, callback_group=together)
        self._action = ActionServer(
            self,
            LearnParameters,
            "~/learn_parameters",
            self._on_learn_parameters,
            callback_group=together,
            cancel_callback=self._on_cancel,
        )

    def _on_observation(self, message: ObservationMessage) -> None:
        try:
            self._add(observation_from_message(message))
        except IntuitivePhysicsError as error:
            self._input.rejected(error)
        else:
            self._input.accepted()

    def _on_add_observation(
        self, request: AddObservation.Request, response: AddObservation.Response
    ) -> AddObservation.Response:
        try:
            response.added = self._add(observation_from_message(request.observation))
            response.observation_count = self._store.count()
            response.result = ok_result()
        except IntuitivePhysicsError as error:
            response.result = error_result(error, CODES)
        return response

    def _on_get_static_parameters(
        self, request: GetStaticParameters.Request, response: GetStaticParameters.Response
    ) -> GetStaticParameters.Response:
        current = self._current()
        if current is None:
            response.result = ResultCode(
                value=ResultCode.NOT_READY,
                message="no material is known yet; add an observation or set static parameters",
            )
        else:
            response.static_parameters = self._message(current)
            response.result = ok_result()
        return response

    def _on_set_static_parameters(
        self, request: SetStaticParameters.Request, response: SetStaticParameters.Response
    ) -> SetStaticParameters.Response:
        try:
            given = static_parameters_from_message(request.static_parameters)
            stored = self._store.add_parameters(given)
            self._take_over(stored)
            response.version = stored.version
            response.result = ok_result()
        except IntuitivePhysicsError as error:
            response.result = error_result(error, CODES)
        return response

    async def _on_learn(self, request: Learn.Request, response: Learn.Response) -> Learn.Response:
        try:
            job = self._start_job(self._options(request.options))
            await self._watched(job)
            self._fill(response, job)
        except Exception as error:
            response.result = self._refusal(error)
        return response

    async def _on_learn_parameters(self, goal: ServerGoalHandle) -> LearnParameters.Result:
        answer = LearnParameters.Result()
        try:
            options = self._options(goal.request.options)
            job = self._start_job(options)
            answer.cost_history = await self._watched(job, goal, options)
            self._fill(answer, job)
        except Exception as error:
            answer.result = self._refusal(error)
            goal.canceled() if goal.is_cancel_requested else goal.abort()
        else:
            goal.succeed()
        return answer

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        # Whoever watches the job sees the request and passes it on.
        self._job_changed.set()
        return CancelResponse.ACCEPT

    async def _watched(
        self,
        job: LearningJob,
        goal: ServerGoalHandle | None = None,
        options: LearningOptions | None = None,
    ) -> array[float]:
        """Wait for the end of a job, tell a goal of its progress, return its cost history."""
        history = array("d")
        while True:
            change = self._job_changed.next()
            done = job.done
            progress = job.take_progress()
            history.extend(progress.new_costs)
            if goal is not None and options is not None and progress.new_costs:
                goal.publish_feedback(_feedback(progress, options))
            if goal is not None and goal.is_cancel_requested:
                job.cancel()
            if done:
                return history
            await change

    def _start_job(self, options: LearningOptions) -> LearningJob:
        if self._job is not None and not self._job.done:
            raise RefusedError(
                ResultCode.BUSY,
                f"a search runs already and is at iteration {self._job.iteration}; "
                "wait for its end or cancel it",
            )
        store, simulator = self._store, self._simulator
        self._job = LearningJob(
            lambda on_progress, cancelled: learn_from_store(
                store, simulator, options, on_progress=on_progress, cancelled=cancelled
            ),
            self._job_changed.set,
        )
        return self._job

    def _fill(self, answer: Learn.Response | LearnParameters.Result, job: LearningJob) -> None:
        answer.iterations = job.iteration
        answer.computation_time = job.seconds
        learned = job.result().learned
        self._take_over(learned)
        answer.static_parameters = self._message(learned)
        answer.result = ok_result()

    def _refusal(self, error: Exception) -> ResultCode:
        if not isinstance(error, IntuitivePhysicsError):
            self.get_logger().error(f"learning failed: {type(error).__name__}: {error}")
        return error_result(error, CODES)

    def _options(self, message: LearningOptionsMessage) -> LearningOptions:
        """What a caller asked for; what it left at zero is that of the node."""

        def chosen(name: str) -> Any:
            return getattr(message, name) or self.get_parameter(name).value

        return LearningOptions(
            method=chosen("method"),
            criteria=ConvergenceCriteria(
                max_iterations=chosen("max_iterations"),
                max_iterations_without_gain=chosen("max_iterations_without_gain") or None,
                cost_threshold=chosen("cost_threshold") or None,
                time_limit=chosen("time_limit") or None,
            ),
            seed=chosen("seed"),
            bounds=_bounds(message.bounds),
            observation_ids=tuple(message.observation_ids),
        )

    def _add(self, observation: Observation) -> bool:
        added = self._store.add(observation)
        known = len(self._materials)
        self._materials = tuple(dict.fromkeys((*self._materials, *observation.materials)))
        if len(self._materials) > known:
            self._publish()
        return added

    def _take_over(self, learned: LearnedParameters) -> None:
        self._newest = learned
        self._publish()

    def _current(self) -> LearnedParameters | None:
        """Newest θ_s over all materials that were observed; None while no material is known."""
        if self._newest is None and not self._materials:
            return None
        newest = self._newest or LearnedParameters.defaults(self._materials)
        return newest.extended(tuple(dict.fromkeys((*newest.materials, *self._materials))))

    def _publish(self) -> None:
        current = self._current()
        if current is not None:
            self._publisher.publish(self._message(current))

    def _message(self, learned: LearnedParameters) -> StaticParametersMessage:
        return static_parameters_to_message(learned, stamp=self.get_clock().now().to_msg())

    def _check_learning(self) -> Status:
        try:
            count = self._store.count()
        except StorageError as error:
            return Status(Level.ERROR, str(error))
        newest = self._newest
        values = {
            "observations": count,
            "version": newest.version if newest else 0,
            "cost": newest.cost if newest else "",
        }
        if self._job is not None and not self._job.done:
            return Status(Level.OK, f"searching, at iteration {self._job.iteration}", values)
        return Status(Level.OK, "waiting to be asked", values)


def _feedback(progress: JobProgress, options: LearningOptions) -> LearnParameters.Feedback:
    return LearnParameters.Feedback(
        iteration=progress.iteration,
        max_iterations=options.criteria.max_iterations,
        best_cost=progress.best_cost,
        cost_history=array("d", progress.new_costs),
        time_left=progress.seconds_left,
    )


def _bounds(messages: Sequence[ParameterBounds]) -> dict[str, Bounds]:
    try:
        bounds = bounds_from_messages(messages)
        # What kinds must be to one another does not depend on the materials.
        ParameterSpace(("any",), bounds)
    except InvalidInputError as error:
        raise RefusedError(ResultCode.INVALID_BOUNDS, str(error)) from None
    return bounds


def main() -> int:
    """Run the node until it is told to stop."""
    return run_node(LearnerNode)
