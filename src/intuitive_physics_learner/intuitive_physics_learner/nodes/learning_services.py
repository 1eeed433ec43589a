"""The learner node's service and action that search θ_s on request."""

from __future__ import annotations

import math
import threading
import time
from array import array
from collections.abc import Callable
from typing import Any

from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import ResultCode
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from intuitive_physics_msgs.srv import Learn
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.kernels.cache import compilations_noted
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_learner.errors import (
    ClusterError,
    IncompatibleEnvironmentError,
    LearningCancelledError,
    MissingDependencyError,
    NoObservationsError,
    StorageError,
    SupersededError,
    UnknownMethodError,
)
from intuitive_physics_learner.learning_job import LearningJob, Work
from intuitive_physics_learner.learning_session import LearningOptions, LearningResult
from intuitive_physics_learner.nodes.parameters import learning_options
from intuitive_physics_learner.search.convergence import SearchProgress
from intuitive_physics_ros.background import Background, WorkerSignal
from intuitive_physics_ros.lifecycle.kernel_loading import COMPILING
from intuitive_physics_ros.result_codes import RefusedError, error_result, ok_result
from intuitive_physics_ros.unexpected_errors import unexpected_errors

CODES: dict[type[BaseException], int] = {
    NoObservationsError: ResultCode.NO_OBSERVATIONS,
    UnknownMethodError: ResultCode.UNKNOWN_METHOD,
    MissingDependencyError: ResultCode.MISSING_DEPENDENCY,
    LearningCancelledError: ResultCode.CANCELLED,
    StorageError: ResultCode.STORAGE_FAILED,
    IncompatibleEnvironmentError: ResultCode.INCOMPATIBLE_ENVIRONMENT,
    ClusterError: ResultCode.CLUSTER_FAILED,
    SupersededError: ResultCode.CANCELLED,
}
"""Result code of each error of this package; others are those of `intuitive_physics_ros`."""


def refusal(node: Node, error: Exception, doing: str = "a request") -> ResultCode:
    """Return the result of a request that raised; what is no error of the suite is reported."""
    if not isinstance(error, IntuitivePhysicsError):
        unexpected_errors(node).report(error, doing)
    return error_result(error, CODES)


def answered_beside(
    node: Node,
    background: Background,
    answer: Callable[[Any, Any, StopFlag], Any],
    then: Callable[[Any], object],
) -> Callable[[Any, Any], Any]:
    """Return a service's callback that fills the response in a thread.

    `answer(request, response, stop)` does so, and ends early once its flag is set; `then` gets what
    it returns, in the node's executor.
    """

    async def on_request(request: Any, response: Any) -> Any:
        try:
            then(await background.run(lambda stop: answer(request, response, stop)))
            response.result = ok_result()
        except Exception as error:
            response.result = refusal(node, error)
        return response

    return on_request


DEADLINE = "search_deadline"
"""Name of the node's parameter."""

CANCEL_PATIENCE = 0.2
"""s from a request to cancel a search to the answer at most. Simulations end within some ms; steps
of linear algebra of many parameters, or of another machine, can take longer, and so does the import
of a package that the method needs."""

NEXT_PATIENCE = 5.0
"""Longest time, s, that a request waits for the end of a search that was cancelled."""

MakeWork = Callable[[LearningOptions], Work]
"""Makes what a job runs from the options of a request."""


class RequestedSearches:
    """Offers `~/learn` and `~/learn_parameters`, one search at a time.

    `on_end` is called in the node's executor with what was learned; None when nothing was.
    """

    def __init__(
        self,
        node: Node,
        make_work: MakeWork,
        to_message: Callable[[LearnedParameters], StaticParametersMessage],
        on_begin: Callable[[], None],
        on_end: Callable[[LearnedParameters | None], None],
    ) -> None:
        self._node = node
        self._make_work = make_work
        self._to_message = to_message
        self._on_begin = on_begin
        self._on_end = on_end
        self._job: LearningJob | None = None
        self._stopped = False
        self._changed = WorkerSignal(node)
        # While a search waits in a callback, others of its group must run.
        together = ReentrantCallbackGroup()
        node.create_service(Learn, "~/learn", self._on_learn, callback_group=together)
        self._action = ActionServer(
            node,
            LearnParameters,
            "~/learn_parameters",
            self._on_learn_parameters,
            callback_group=together,
            cancel_callback=self._on_cancel,
        )

    @property
    def running(self) -> LearningJob | None:
        """The search that runs."""
        return None if self._job is None or self._job.done else self._job

    def cancel(self, why: str) -> None:
        """Cancel a search that runs; its caller gets the reason."""
        if self.running is not None:
            self.running.cancel(why)
            self._changed.set()

    def stop(self, patience: float) -> bool:
        """Cancel a search that runs and refuse others; return whether it ends in `patience` s."""
        self._stopped = True
        return self._job is None or self._job.stop(patience)

    async def _on_learn(self, request: Learn.Request, response: Learn.Response) -> Learn.Response:
        try:
            job = await self._start(learning_options(self._node, request.options))
            await self._watched(job)
            self._fill(response, job)
        except Exception as error:
            response.result = refusal(self._node, error, "learning")
        return response

    async def _on_learn_parameters(self, goal: ServerGoalHandle) -> LearnParameters.Result:
        answer = LearnParameters.Result()
        try:
            options = learning_options(self._node, goal.request.options)
            job = await self._start(options)
            answer.cost_history = await self._watched(job, goal, options)
            self._fill(answer, job)
        except Exception as error:
            answer.result = refusal(self._node, error, "learning")
            goal.canceled() if goal.is_cancel_requested else goal.abort()
        else:
            goal.succeed()
        return answer

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        # `_watched` sees the request and cancels the job.
        self._changed.set()
        return CancelResponse.ACCEPT

    async def _start(self, options: LearningOptions) -> LearningJob:
        if (before := self.running) is not None and before.cancelled:
            deadline = time.monotonic() + NEXT_PATIENCE
            timer = _timer(NEXT_PATIENCE, self._changed.set)
            await self._end_of(before, deadline)
            timer.cancel()
        if self._stopped:
            raise RefusedError(ResultCode.CANCELLED, "the node ends")
        if (other := self.running) is not None:
            state = "was cancelled and has not ended yet" if other.cancelled else "runs already"
            raise RefusedError(
                ResultCode.BUSY,
                f"a search {state}, at iteration {other.iteration}; wait for its end or cancel it",
            )
        self._on_begin()
        self._job = LearningJob(self._noted(self._make_work(options)), self._changed.set)
        return self._job

    async def _end_of(self, job: LearningJob, deadline: float = math.inf) -> None:
        """Wait for the end of a job, or for the first signal after a deadline (monotonic)."""
        while not job.done and time.monotonic() < deadline:
            change = self._changed.next()
            if not job.done:
                await change

    def _noted(self, work: Work) -> Work:
        """Return the same work, which says in the log that it compiles kernels when it does."""
        log = self._node.get_logger()

        def noted(on_progress: Callable[[SearchProgress], None], stop: StopFlag) -> LearningResult:
            with compilations_noted(lambda: log.info(COMPILING, once=True)):
                return work(on_progress, stop)

        return noted

    async def _watched(
        self,
        job: LearningJob,
        goal: ServerGoalHandle | None = None,
        options: LearningOptions | None = None,
    ) -> array[float]:
        """Wait for the end of a job, publish feedback to a goal, return its cost history (m).

        A job that was cancelled and has not ended by then is left to end by itself.
        """
        history = array("d")
        waits_until = math.inf
        deadline = self._deadline(job)
        try:
            while True:
                change = self._changed.next()
                done = job.done
                progress = job.drain_progress()
                history.extend(progress.new_costs)
                if goal is not None and options is not None and progress.new_costs:
                    self._publish_feedback(goal, progress, options)
                if goal is not None and goal.is_cancel_requested:
                    job.cancel()
                if done:
                    self._on_end(job.learned())
                    return history
                if job.cancelled and math.isinf(waits_until):
                    # A node that ends has waited already, and answers no more soon after.
                    patience = 0.0 if self._stopped else CANCEL_PATIENCE
                    waits_until = time.monotonic() + patience
                    _timer(patience, self._changed.set)
                executor = self._node.executor
                if time.monotonic() >= waits_until and executor is not None:
                    executor.create_task(self._ended_late(job))
                    raise job.cancellation
                await change
        finally:
            deadline.cancel()

    async def _ended_late(self, job: LearningJob) -> None:
        await self._end_of(job)
        self._on_end(job.learned())

    def _deadline(self, job: LearningJob) -> threading.Timer:
        seconds = self._node.get_parameter(DEADLINE).value

        def cancel() -> None:
            job.cancel(
                f"the search has not ended within {seconds:g} s, so it is cancelled and nothing "
                f"was stored; raise {DEADLINE}, or set time_limit"
            )
            self._changed.set()

        return _timer(seconds, cancel)

    def _publish_feedback(
        self, goal: ServerGoalHandle, progress: SearchProgress, options: LearningOptions
    ) -> None:
        feedback = LearnParameters.Feedback(
            iteration=progress.iteration,
            max_iterations=options.criteria.max_iterations,
            best_cost=progress.best_cost,
            cost_history=array("d", progress.new_costs),
            time_left=progress.seconds_left,
        )
        try:
            goal.publish_feedback(feedback)
        except Exception as error:
            # Whoever wanted to watch is gone; what is learned counts all the same.
            unexpected_errors(self._node).report(error, "feedback of a search")

    def _fill(self, answer: Learn.Response | LearnParameters.Result, job: LearningJob) -> None:
        answer.iterations = job.iteration
        answer.computation_time = job.seconds
        answer.static_parameters = self._to_message(job.result().learned)
        answer.result = ok_result()


def _timer(seconds: float, action: Callable[[], None]) -> threading.Timer:
    """Call something after so long, from another thread that keeps no process alive."""
    timer = threading.Timer(seconds, action)
    timer.daemon = True
    timer.start()
    return timer
