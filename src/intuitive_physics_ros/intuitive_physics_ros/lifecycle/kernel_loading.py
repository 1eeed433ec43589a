"""The kernels of a node are loaded in a thread: while they are compiled, the node answers."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable

from intuitive_physics_msgs.msg import ResultCode
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node

from intuitive_physics_ros.background import trigger
from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.result_codes import RefusedError
from intuitive_physics_ros.unexpected_errors import unexpected_errors

COMPILING = "compiling kernels, about a minute, once"
"""Message while kernels are compiled."""


class KernelLoading:
    """Calls a node's kernels once, in a thread, so that they are there when they are needed.

    Where the cache has them that takes a second and nothing is said. Where it has not, they are
    compiled, which the log says at once and `check` as long as it lasts.

    Parameters
    ----------
    node : whose kernels these are
    warm_up : calls them; None: the node has none
    """

    def __init__(self, node: Node, warm_up: Callable[[], None] | None) -> None:
        self._node = node
        self._warm_up = warm_up
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._waiting: list[GuardCondition] = []
        self._loaded = warm_up is None
        self._compiling_since: float | None = None
        self._failure = ""

    @property
    def is_loaded(self) -> bool:
        """Whether they are there."""
        return self._loaded

    def start(self) -> None:
        """Begin to load them, unless that was begun before."""
        if self._thread is None and not self._loaded:
            self._thread = threading.Thread(target=self._load, name="kernels", daemon=True)
            self._thread.start()

    def when_loaded(self, action: Callable[[], None]) -> None:
        """Call `action` as soon as they are there, at once if they are.

        It is called by the node's executor; a node that is deactivated first never calls it.
        """
        with self._lock:
            if not self._loaded:
                self._waiting.append(self._node.create_guard_condition(action))
                return
        action()

    def refuse_until_loaded(self) -> None:
        """Raise RefusedError (NOT_READY) for a request while kernels are compiled."""
        if self._failure:
            raise RefusedError(ResultCode.NOT_READY, self._failure)
        if self._compiling_since is not None and not self._loaded:
            raise RefusedError(ResultCode.NOT_READY, f"{COMPILING}; ask again after that")

    def check(self) -> Status:
        """Say how far it is; a check for /diagnostics."""
        if self._failure:
            return Status(Level.ERROR, self._failure)
        if self._loaded:
            return Status(Level.OK, "kernels are loaded")
        if self._compiling_since is not None:
            lasted = time.monotonic() - self._compiling_since
            return Status(Level.WARN, f"{COMPILING}; for {lasted:.0f} s so far")
        return Status(Level.OK, "loads kernels" if self._thread else "kernels are not loaded yet")

    def _load(self) -> None:
        # It brings Numba, which nodes without kernels do not need.
        from intuitive_physics.kernels.cache import compilations_noted

        assert self._warm_up is not None
        try:
            with compilations_noted(self._note_compilation):
                self._warm_up()
        except Exception as error:
            self._failure = unexpected_errors(self._node).report(error, "loading the kernels")
            return
        if self._compiling_since is not None:
            took = time.monotonic() - self._compiling_since
            self._node.get_logger().info(f"kernels are compiled, after {took:.0f} s")
        spare_collections()
        with self._lock:
            self._loaded = True
        for guard in self._waiting:
            trigger(guard)

    def _note_compilation(self) -> None:
        if self._compiling_since is None:
            self._compiling_since = time.monotonic()
            self._node.get_logger().info(COMPILING)


def spare_collections() -> None:
    """Exempt what lives as long as the process from garbage collection.

    A collection that visits the objects of all modules and kernels takes 0.1 s of processor time
    and stops every thread: longer than a tick may be late, and several times as long on a busy
    machine.
    """
    gc.collect()
    gc.freeze()
