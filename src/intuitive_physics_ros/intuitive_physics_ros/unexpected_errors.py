"""Unexpected exceptions: each kind is reported once, and the node continues."""

from __future__ import annotations

import threading
import traceback
from pathlib import Path
from weakref import WeakKeyDictionary

from rclpy.node import Node

MOST_OF_A_KIND = 3
"""Errors of one kind from which on the node is in an error state. Our choice: one may be a freak,
three are a defect."""

MOST_KINDS = 100
"""Kinds that are told apart; what comes after them counts as one more."""

LATER_KINDS = "of later kinds"
"""Stands for all kinds beyond `MOST_KINDS`."""


class UnexpectedErrors:
    """Counts a node's unexpected errors by kind: type and place; any thread may report one.

    Parameters
    ----------
    node : into whose log they go
    """

    def __init__(self, node: Node) -> None:
        self._log = node.get_logger()
        self._lock = threading.Lock()
        self._counts: dict[str, int] = {}

    def report(self, error: BaseException, doing: str) -> str:
        """Count an error, log the first and the third of its kind, and return it in one line.

        `doing` names what failed, such as "a callback".
        """
        what = " ".join(f"{type(error).__name__}: {error!s:.500}".split())
        place = where(error)
        with self._lock:
            kind = f"{type(error).__name__} in {place}"
            if len(self._counts) >= MOST_KINDS and kind not in self._counts:
                kind = LATER_KINDS
            self._counts[kind] = count = self._counts.get(kind, 0) + 1
        sentence = f"{doing} failed: {what} ({place})"
        if count == 1:
            self._log.error(f"{sentence}; the node goes on, please report this")
        elif count == MOST_OF_A_KIND:
            self._log.error(
                f"{sentence}; it is the {count}rd of its kind, later ones are counted on "
                "/diagnostics only: restart the node, and please report this"
            )
        return sentence

    @property
    def counts(self) -> dict[str, int]:
        """Number of errors of each kind."""
        with self._lock:
            return dict(self._counts)


_errors_by_node: WeakKeyDictionary[Node, UnexpectedErrors] = WeakKeyDictionary()
_making = threading.Lock()


def unexpected_errors(node: Node) -> UnexpectedErrors:
    """Return what counts a node's unexpected errors; each node has one."""
    with _making:
        if node not in _errors_by_node:
            _errors_by_node[node] = UnexpectedErrors(node)
        return _errors_by_node[node]


def where(error: BaseException) -> str:
    """Return the places that an error came through, the innermost last, without those of ROS."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if "/rclpy/" not in frame.filename
    ]
    places = [f"{Path(frame.filename).name}:{frame.lineno} {frame.name}" for frame in frames]
    return " > ".join(places[-3:]) or "no known place"
