"""Threads beside a node for long work of its callbacks."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from intuitive_physics_msgs.msg import ResultCode
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.task import Future

from intuitive_physics.settings import check_settings, list_settings, number
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_ros.result_codes import RefusedError
from intuitive_physics_ros.unexpected_errors import unexpected_errors


@dataclass(frozen=True)
class RequestLimits:
    """Limits on the time of a request and on the number that wait. Our choices, never met in use.

    A node that declares a parameter of a field's name has its value.
    """

    request_time_limit: float = number(
        30.0, 0.1, 1e6, "wall time from a request to its answer at most; then it is cancelled"
    )
    largest_queue: int = number(
        32, 1, 1000, "requests under way or waiting at most; one more is answered BUSY"
    )

    def __post_init__(self) -> None:
        check_settings(self)

    @staticmethod
    def of(node: Node) -> RequestLimits:
        """Return the limits that a node's parameters give."""
        names = [setting.name for setting in list_settings(RequestLimits)]
        given = {name: node.get_parameter(name).value for name in names if node.has_parameter(name)}
        return RequestLimits(**given)


@dataclass(eq=False)
class _Request:
    """Work under way or waiting, and how it ended."""

    work: Callable[[StopFlag], Any]
    ends: float
    refusal: str
    done: Future = field(default_factory=Future)
    stop: StopFlag = field(default_factory=StopFlag)
    answer: Any = None
    error: BaseException | None = None
    answered: bool = False


class Background:
    """Does one piece of work after the other in a thread of its own.

    Work that lasts too long is cancelled: the callback that awaits it gets the refusal at once, and
    the work itself ends as soon as it checks its flag.

    Parameters
    ----------
    node : whose callbacks wait for it; they have to be of a `ReentrantCallbackGroup`, else others
        of their group wait with them. Its parameters give the limits (`RequestLimits`)
    name : of the thread
    """

    def __init__(self, node: Node, name: str = "background") -> None:
        self._node = node
        self._name = name
        self._changed = threading.Condition()
        self._waiting: deque[_Request] = deque()
        self._posted: dict[Hashable, Callable[[], None]] = {}
        self._under_way: _Request | None = None
        self._stopping = False
        # Made with the first work: daemons, so that a process can end whatever they do.
        self._threads: list[threading.Thread] = []

    async def run(
        self,
        work: Callable[[StopFlag], Any],
        *,
        time_limit: float | None = None,
        remedy: str = "ask for less, or raise the parameter request_time_limit",
    ) -> Any:
        """Await this in an `async` callback: what `work(stop)` answers or raises.

        Parameters
        ----------
        work : checks `stop`, or passes it to its simulator
        time_limit : s from now on; default: `RequestLimits.request_time_limit`
        remedy : advice for the user when it takes longer

        Raises
        ------
        RefusedError
            BUSY when too much waits, CANCELLED when the time is over or the node ends.
        """
        limits = RequestLimits.of(self._node)
        limit = limits.request_time_limit if time_limit is None else time_limit
        refusal = f"there was no answer within {limit:g} s, so the request is cancelled; {remedy}"
        request = _Request(work, time.monotonic() + limit, refusal)
        with self._changed:
            count = len(self._waiting) + (self._under_way is not None)
            if count >= limits.largest_queue:
                raise RefusedError(
                    ResultCode.BUSY,
                    f"{count} requests are under way or wait already; ask again later, or raise "
                    "the parameter largest_queue",
                )
            if self._stopping:
                raise RefusedError(ResultCode.CANCELLED, "the node ends")
            self._waiting.append(request)
            self._start()
            self._changed.notify_all()
        await request.done
        if request.error is not None:
            raise request.error
        return request.answer

    def post(self, work: Callable[[], None], key: Hashable) -> None:
        """Have the node's own work done before the requests that wait; nobody waits for it.

        Parameters
        ----------
        work : what it raises is reported by `unexpected_errors`
        key : work of the same key that was not begun yet is dropped
        """
        with self._changed:
            if not self._stopping:
                self._posted[key] = work
                self._start()
                self._changed.notify_all()

    def cancel(self, why: str, *, stopping: bool = False) -> None:
        """Refuse all requests, and later ones if it is stopping; their callbacks get the reason."""
        with self._changed:
            self._stopping |= stopping
            requests = [*self._waiting, *([self._under_way] if self._under_way else [])]
            self._waiting.clear()
            self._changed.notify_all()
        for request in requests:
            self._refuse(request, why)

    def stop(self, patience: float = 1.0) -> bool:
        """Cancel all work; return whether what was under way has ended within `patience` s."""
        self.cancel("the node ends, so the request is cancelled", stopping=True)
        if self._threads:
            self._threads[0].join(patience)
        return not any(thread.is_alive() for thread in self._threads[:1])

    def _start(self) -> None:
        if self._threads:
            return
        for name, target in ((self._name, self._work), (f"{self._name} clock", self._watch)):
            self._threads.append(threading.Thread(target=target, name=name, daemon=True))
            self._threads[-1].start()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._under_way = None
                self._changed.wait_for(lambda: self._waiting or self._posted or self._stopping)
                posted, self._posted = [*self._posted.values()], {}
                if not posted:
                    if not self._waiting:
                        return
                    request = self._under_way = self._waiting.popleft()
            if posted:
                for work in posted:
                    self._do_posted(work)
                continue
            try:
                answer, error = request.work(request.stop), None
            except BaseException as raised:
                answer, error = None, raised
            self._end(request, answer, error)

    def _do_posted(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:
            unexpected_errors(self._node).report(error, self._name)

    def _watch(self) -> None:
        """Refuse what lasts too long."""
        while True:
            with self._changed:
                if self._stopping:
                    return
                requests = [*self._waiting, *([self._under_way] if self._under_way else [])]
                unanswered = [request for request in requests if not request.answered]
                now = time.monotonic()
                late = [request for request in unanswered if request.ends <= now]
                for request in late:
                    if request in self._waiting:
                        self._waiting.remove(request)
                if not late:
                    first = min((request.ends for request in unanswered), default=None)
                    self._changed.wait(None if first is None else first - now)
            for request in late:
                self._refuse(request, request.refusal)

    def _refuse(self, request: _Request, why: str) -> None:
        request.stop.set()
        self._end(request, None, RefusedError(ResultCode.CANCELLED, why))

    def _end(self, request: _Request, answer: Any, error: BaseException | None) -> None:
        """Answer a request, unless that was done before."""
        with self._changed:
            if request.answered:
                return
            request.answer, request.error, request.answered = answer, error, True
        _complete(request.done, self._node)


def trigger(guard: GuardCondition) -> None:
    """Have a node's executor call a guard condition's callback; from any thread.

    The thread may outlive a deactivation, which destroys the guard condition: then nothing is left
    to go on with.
    """
    with suppress(InvalidHandle):
        guard.trigger()


def _complete(future: Future, node: Node) -> None:
    """Set a future's result, from any thread, and wake the callbacks that await it."""
    future.set_result(None)
    executor = node.executor
    if executor is not None:
        # An executor that is just shutting down has nobody left to wake.
        with suppress(InvalidHandle):
            executor.wake()
