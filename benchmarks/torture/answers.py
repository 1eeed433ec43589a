"""Requests that are under way: one that is not answered in time is a hang."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

# s in which a request has to be answered: the nodes' own limits, and those of a busy machine
LIMIT = 30.0


@dataclass(frozen=True)
class _Asked:
    """A request that waits for its answer."""

    node: str
    what: str
    future: Any
    since: float
    is_known: bool
    forget: Callable[[], object]


class Answers:
    """Watches requests until they are answered.

    A server drops its answer to a client that it has not discovered yet. So an answer may be
    missing as long as a client has had none, unless no other comes in the same time.
    """

    def __init__(self, limit: float = LIMIT) -> None:
        self.hangs: list[str] = []
        self._limit = limit
        self._asked: list[_Asked] = []
        self._known: set[tuple[str, str]] = set()

    def watch(self, node: str, what: str, future: Any, forget: Callable[[], object]) -> None:
        """Expect an answer from now on."""
        is_known = (node, what) in self._known
        self._asked.append(_Asked(node, what, future, time.monotonic(), is_known, forget))

    def awaits(self, node: str, what: str) -> bool:
        """Whether a request to a service of a node is under way."""
        return any((one.node, one.what) == (node, what) for one in self._asked)

    def look(self) -> bool:
        """Take what was answered, and note what was not in time; return whether all was."""
        for one in self._asked:
            if one.future.done():
                self._known.add((one.node, one.what))
        waiting = []
        for one in self._asked:
            if one.future.done():
                continue
            if time.monotonic() - one.since <= self._limit:
                waiting.append(one)
                continue
            one.forget()
            if one.is_known or (one.node, one.what) not in self._known:
                self.hangs.append(f"{one.node} {one.what}")
        self._asked = waiting
        return not waiting

    def leave(self, node: str, but: str = "") -> None:
        """Expect nothing of a node that has ended, or whose services end."""
        for one in self._asked:
            if one.node == node and one.what != but:
                one.forget()
        self._asked = [one for one in self._asked if one.node != node or one.what == but]
        self._known = {pair for pair in self._known if pair[0] != node or pair[1] == but}
