"""Requests that are under way: one that is not answered in time is a hang."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

# s in which a request has to be answered: the nodes' own limits, and those of a busy machine
LIMIT = 30.0


@dataclass(frozen=True)
class _Request:
    """A request that waits for its answer."""

    node: str
    what: str
    future: Any
    since: float
    is_discovered: bool  # whether its client had an answer before
    forget: Callable[[], object]


class Answers:
    """Watches requests until they are answered, each within `LIMIT` s.

    A server drops its answer to a client that it has not discovered yet. So an answer may be
    missing as long as a client has had none, unless no other comes in the same time.
    """

    def __init__(self) -> None:
        self.hangs: list[str] = []  # node and service of requests that were not answered in time
        self._pending: list[_Request] = []
        self._discovered: set[tuple[str, str]] = set()

    def watch(self, node: str, what: str, future: Any, forget: Callable[[], object]) -> None:
        """Expect an answer of a service, or of a step of an action, from now on.

        `forget` is called when the answer is awaited no more.
        """
        is_discovered = (node, what) in self._discovered
        request = _Request(node, what, future, time.monotonic(), is_discovered, forget)
        self._pending.append(request)

    def awaits(self, node: str, what: str) -> bool:
        """Whether a request to a service of a node is under way."""
        return any((request.node, request.what) == (node, what) for request in self._pending)

    def look(self) -> bool:
        """Take the answers, note requests that are too old, and return whether none is pending."""
        self._discovered |= {(r.node, r.what) for r in self._pending if r.future.done()}
        unanswered = [request for request in self._pending if not request.future.done()]
        oldest = time.monotonic() - LIMIT
        self._pending = [request for request in unanswered if request.since >= oldest]
        for request in unanswered:
            if request.since < oldest:
                request.forget()
                client = (request.node, request.what)
                if request.is_discovered or client not in self._discovered:
                    self.hangs.append(f"{request.node} {request.what}")
        return not self._pending

    def leave(self, node: str, but: str = "") -> None:
        """Expect nothing of a node that has ended, or whose services end but one."""
        for request in self._pending:
            if request.node == node and request.what != but:
                request.forget()
        self._pending = [r for r in self._pending if r.node != node or r.what == but]
        self._discovered = {pair for pair in self._discovered if pair[0] != node or pair[1] == but}
