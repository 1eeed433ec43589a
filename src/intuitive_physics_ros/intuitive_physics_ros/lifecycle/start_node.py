"""The beginning of every node executable: a signal ends it clean from its first moment on.

A node's own module takes a second to import. This one takes nothing, so that Ctrl-C in that second
ends the process with code 0 and without a traceback.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from types import FrameType

GROUP = "intuitive_physics.nodes"
"""Entry points that name the `main` of each node by the name of its executable."""

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a node."""


def main() -> int:
    """Run the node whose executable this process is, and return its exit code."""
    _end_at_signals()
    # Imported late: it takes a while, in which a signal may come.
    from importlib.metadata import entry_points

    name = os.path.basename(sys.argv[0]).removesuffix(".py")
    for entry_point in entry_points(group=GROUP, name=name):
        return _code(entry_point.load()())
    names = ", ".join(sorted({entry_point.name for entry_point in entry_points(group=GROUP)}))
    print(f"{name}: error: no node has this name; expected one of {names}", file=sys.stderr)
    return 1


def run_module(module: str) -> int:
    """Run the `main` of a node's module, and return its exit code."""
    _end_at_signals()
    return _code(importlib.import_module(module).main())


def _code(returned: object) -> int:
    return returned if isinstance(returned, int) else 0


def _end_at_signals() -> None:
    # `run_node` puts handlers of its own in their place, which let the node finish.
    for number in STOP_SIGNALS:
        signal.signal(number, _end)


def _end(number: int, frame: FrameType | None) -> None:
    # Nothing has begun that would have to be finished.
    os._exit(0)
