"""The learner node's service and action that search θ_s on request."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
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
    MissingDependencyError,
    NoObservationsError,
    StorageError,
    SupersededError,
    UnknownMethodError,
)
from intuitive_physics_learner.learning_session import LearningOptions, LearningResult
from intuitive_physics_learner.nodes.parameters import learning_options
from intuitive_physics_learner.search.convergence import SearchProgress
from intuitive_physics_ros.background import Background, trigger
from intuitive_physics_ros.lifecycle.kernel_loading import COMPILING
from intuitive_physics_ros.result_codes import RefusedError, error_result, ok_result
from intuitive_physics_ros.unexpected_errors import unexpected_errors

CODES: dict[type[BaseException], int] = {
    NoObservationsError: ResultCode.NO_OBSERVATIONS,
    UnknownMethodError: ResultCode.UNKNOWN_METHOD,
    MissingDependencyError: ResultCode.MISSING_DEPENDENCY,
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

REPORT_PERIOD = 0.1
"""s between two messages of feedback at least, except for the last."""

CANCELLED = "learning was cancelled; nothing was stored"
"""Answer to the caller who cancels a search."""

NEXT_PATIENCE = 5.0
"""Longest time, s, that a request waits for the end of a search that was cancelled. Simulations end
within some ms; steps of linear algebra of many parameters, or of another machine, can take longer,
and so does the import of a package that the method needs."""

YIELD_PERIOD, YIELD = 0.02, 2e-4
"""s between two pauses of a search, and their length. A kernel releases the interpreter lock and
takes it again within some 10 µs; a thread that waits for it is woken by each release, too late, and
so never asks for it: it waited for 0.5 s now and then."""

Work = Callable[[Callable[[SearchProgress], None], StopFlag], LearningResult]
"""Takes `on_progress`, as `learn_from_store` does, and a flag that its simulations stop by."""


@dataclass(eq=False)
class RequestedSearch:
    """A search that was asked for. It may go on for a moment after its caller was answered.

    Parameters
    ----------
    options : of the request
    goal : of the action, which gets feedback; None: it was asked for by the service
    began : when, s on the monotonic clock
    begun, ended : whether its thread has begun and ended it
    answered : whether its caller was answered
    progress : so far
    costs : lowest J after each evaluation so far, m
    reported : number of these that feedback has had
    learned : what was learned; None before the end, or where it failed
    reported_at, yielded_at : when feedback was published, and other threads were let run, s
    """

    options: LearningOptions
    goal: ServerGoalHandle | None
    began: float = field(default_factory=time.monotonic)
    begun: bool = False
    ended: bool = False
    answered: bool = False
    progress: SearchProgress = field(default_factory=SearchProgress)
    costs: array[float] = field(default_factory=lambda: array("d"))
    reported: int = 0
    learned: LearnedParameters | None = None
    reported_at: float = 0.0
    yielded_at: float = 0.0


class RequestedSearches:
    """Offers `~/learn` and `~/learn_parameters`, one search at a time, in a thread of its own.

    `on_end` is called in the node's executor with what was learned; None when nothing was.
    """

    def __init__(
        self,
        node: Node,
        make_work: Callable[[LearningOptions], Work],
        to_message: Callable[[LearnedParameters], StaticParametersMessage],
        on_begin: Callable[[], None],
        on_end: Callable[[LearnedParameters | None], None],
    ) -> None:
        self._node = node
        self._make_work = make_work
        self._to_message = to_message
        self._on_begin = on_begin
        self._on_end = on_end
        self._search: RequestedSearch | None = None
        self._background = Background(node, "learning")
        # Triggered in the thread of the search, called back in the node's executor.
        self._ended = node.create_guard_condition(self._finish)
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
    def running(self) -> RequestedSearch | None:
        """The search that runs."""
        return None if self._search is None or self._search.ended else self._search

    def cancel(self, why: str) -> None:
        """Cancel a search that runs; its caller gets the reason."""
        if self.running is not None:
            self._background.cancel(why)

    def stop(self, patience: float) -> bool:
        """Cancel a search that runs and refuse others; return whether it ends in `patience` s."""
        return self._background.stop(patience)

    async def _on_learn(self, request: Learn.Request, response: Learn.Response) -> Learn.Response:
        try:
            await self._answer(response, learning_options(self._node, request.options))
        except Exception as error:
            response.result = refusal(self._node, error, "learning")
        return response

    async def _on_learn_parameters(self, goal: ServerGoalHandle) -> LearnParameters.Result:
        answer = LearnParameters.Result()
        try:
            options = learning_options(self._node, goal.request.options)
            answer.cost_history = await self._answer(answer, options, goal)
        except Exception as error:
            answer.result = refusal(self._node, error, "learning")
            goal.canceled() if goal.is_cancel_requested else goal.abort()
        else:
            goal.succeed()
        return answer

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        if self._search is not None and self._search.goal is goal:
            self.cancel(CANCELLED)
        return CancelResponse.ACCEPT

    async def _answer(
        self,
        answer: Learn.Response | LearnParameters.Result,
        options: LearningOptions,
        goal: ServerGoalHandle | None = None,
    ) -> array[float]:
        """Search, fill in the answer, and return the lowest J after each iteration, m."""
        if self.running is not None and self.running.answered:
            # It was cancelled; its thread takes the next work when it has ended.
            with suppress(RefusedError):
                await self._background.run(lambda stop: None, time_limit=NEXT_PATIENCE)
        if goal is not None and goal.is_cancel_requested:
            raise RefusedError(ResultCode.CANCELLED, CANCELLED)
        self._finish()
        if (other := self.running) is not None:
            state = "was cancelled and has not ended yet" if other.answered else "runs already"
            raise RefusedError(
                ResultCode.BUSY,
                f"a search {state}, at iteration {other.progress.iteration}; wait for its end or "
                "cancel it",
            )
        self._on_begin()
        search = self._search = RequestedSearch(options, goal)
        try:
            result = await self._background.run(
                partial(self._run, search),
                time_limit=self._node.get_parameter(DEADLINE).value,
                remedy=f"nothing was stored; raise {DEADLINE}, or set time_limit",
            )
        finally:
            search.answered = True
            search.ended |= not search.begun
            self._finish()
            answer.iterations = search.progress.iteration
            answer.computation_time = time.monotonic() - search.began
        answer.static_parameters = self._to_message(result.learned)
        answer.result = ok_result()
        return search.costs

    def _finish(self) -> None:
        """Report the end of a search that has ended, once."""
        search = self._search
        if search is not None and search.ended:
            self._search = None
            self._on_end(search.learned)

    def _run(self, search: RequestedSearch, stop: StopFlag) -> LearningResult:
        """Search, in a thread beside the node."""
        stop.check()
        search.begun = True
        log = self._node.get_logger()
        try:
            with compilations_noted(lambda: log.info(COMPILING, once=True)):
                result = self._make_work(search.options)(partial(self._note, search), stop)
            search.learned = result.learned
            return result
        finally:
            self._publish_feedback(search)
            search.ended = True
            trigger(self._ended)

    def _note(self, search: RequestedSearch, progress: SearchProgress) -> None:
        search.progress = progress
        search.costs.extend(progress.new_costs)
        now = time.monotonic()
        if now - search.yielded_at >= YIELD_PERIOD:
            search.yielded_at = now
            time.sleep(YIELD)
        if now - search.reported_at >= REPORT_PERIOD:
            search.reported_at = now
            self._publish_feedback(search)

    def _publish_feedback(self, search: RequestedSearch) -> None:
        costs = search.costs[search.reported :]
        if search.goal is None or search.answered or not costs:
            return
        search.reported = len(search.costs)
        feedback = LearnParameters.Feedback(
            iteration=search.progress.iteration,
            max_iterations=search.options.criteria.max_iterations,
            best_cost=search.progress.best_cost,
            cost_history=costs,
            time_left=search.progress.seconds_left,
        )
        try:
            search.goal.publish_feedback(feedback)
        except Exception as error:
            # Whoever wanted to watch is gone; what is learned counts all the same.
            unexpected_errors(self._node).report(error, "feedback of a search")
