"""Decides which process, when it ends, ends all others, and gives the reason in one sentence."""

from __future__ import annotations

import re

LOST = 255
"""Exit code that launch reports when it did not see a process end."""

ERROR = re.compile(r"^(?:\S+: )?error: (.*)$", re.MULTILINE)
"""Line on standard error of a node that cannot start."""


class Failures:
    """Follows the processes of a launch, which are known by launch's names for them.

    Parameters
    ----------
    respawn : whether nodes that ended are started again; one that could not even start is not
    """

    def __init__(self, *, respawn: bool) -> None:
        self._respawn = respawn
        self._starts: dict[str, int] = {}
        self._running: set[str] = set()
        self._errors: dict[str, str] = {}
        self._sentence = ""

    def started(self, process: str) -> None:
        """Take note that a process has started."""
        self._starts[process] = self._starts.get(process, 0) + 1
        self._running.add(process)

    def heard(self, process: str, text: str) -> None:
        """Take note of what a process wrote to standard error."""
        for error in ERROR.findall(text):
            self._errors[process] = error.strip()

    def ended(self, process: str, code: int) -> bool:
        """Take note that a process has ended; return whether all others must end now."""
        self._running.discard(process)
        if code in (0, LOST) or self._sentence:
            return False
        error = self._errors.get(process, "")
        if self._respawn and not (error and self._starts.get(process) == 1):
            return False
        name = re.sub(r"-\d+$", "", process)
        reason = error or f"it died with code {code}; its last lines say why"
        self._sentence = f"{name} failed, so everything was ended: {reason}"
        return True

    @property
    def sentence(self) -> str:
        """Why everything was ended, once nothing runs any more; else empty."""
        return "" if self._running else self._sentence
