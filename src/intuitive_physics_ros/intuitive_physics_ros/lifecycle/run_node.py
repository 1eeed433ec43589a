"""One node from start to clean shutdown: the whole `main` of every node executable."""

from __future__ import annotations

import faulthandler
import os
import pwd
import re
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle, NameValidationException, ParameterException
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
)
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.processes.segments import remove_abandoned_segments
from intuitive_physics_ros.lifecycle.managed_node import ManagedNode
from intuitive_physics_ros.lifecycle.start_node import STOP_SIGNALS
from intuitive_physics_ros.parameters import unknown_overrides
from intuitive_physics_ros.rclpy_internals import RCLError, release
from intuitive_physics_ros.unexpected_errors import unexpected_errors

START_ERRORS = (IntuitivePhysicsError, NameValidationException, ParameterException, RCLError)
"""Errors that a user's mistake at the start raises; any other is a bug and shows its traceback."""

END_OF_SPINNING = (ConditionReachedException, ExternalShutdownException, ShutdownException)
"""Exceptions that an executor raises when it is to stop."""

STOP_LIMIT = 1.7
"""s from the first signal after which the process ends whatever it is doing. Nodes promise to end
within 2 s; the rest is for a busy machine."""

HANG_LIMIT = STOP_LIMIT + 0.8
"""s after which the process ends if the middleware waits for ever with Python's lock: then nothing
in Python can end it, and launch would kill it after ten seconds."""

SWITCH_INTERVAL = 5e-4
"""s after which a waiting thread gets Python; the default is 5 ms. A callback needs it again after
each call of the middleware, so beside a thread that computes or imports it would wait for it many
times, and a tick must not wait that long. Our choice."""

FAREWELL_LIMIT = 0.3
"""s that subscribers have at the end to acknowledge what was published last."""


def run_node(factory: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Make a node, run it on a single-threaded executor until it is stopped, clean up.

    A `ManagedNode` is started as its parameter `autostart` says.

    Ctrl-C (SIGINT), SIGTERM and `rclpy.try_shutdown` end it; signals that come while it ends
    change nothing. What does not end by itself within `STOP_LIMIT` is ended then: so a node writes
    to disk before it answers, and not at its end. An `IntuitivePhysicsError` that leaves a callback
    is logged; any other exception is reported by `unexpected_errors`; the node goes on. A node that
    holds threads, processes or files closes them in its `destroy_node`, up to which it may publish;
    `farewell` waits until others have got what it published.

    Parameters
    ----------
    factory : makes the node, usually its class; called once ROS is initialised
    args : command line; None takes that of the process

    Returns
    -------
    int
        Exit code: 0 after a clean end, 1 when it could not start, which one line on standard
        error explains.
    """
    stop = StopSignal()
    sys.setswitchinterval(SWITCH_INTERVAL)
    _ensure_log_folder()
    node: Node | None = None
    try:
        freed = remove_abandoned_segments()
        rclpy.init(
            args=sys.argv if args is None else list(args),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        node = factory()
        if isinstance(node, ManagedNode):
            node.start()
    except START_ERRORS as error:
        _leave(node)
        return _explain(error)
    except RuntimeError as error:
        # rclpy has no class of its own for a quality of service that a parameter gives wrongly.
        _leave(node)
        if "QoS override" not in str(error):
            raise
        return _explain(error)
    try:
        _warn_of_unknown_overrides(node)
        if freed:
            node.get_logger().info(
                f"removed {freed / 1e6:.0f} MB of shared memory of processes that were killed"
            )
        _spin(node, stop)
    finally:
        _leave(node)
        stop.ignore_rest()
    return 0


def _leave(node: Node | None) -> None:
    """Destroy a node, where one was made, and leave ROS before the process ends."""
    if node is not None:
        node.destroy_node()
    rclpy.try_shutdown()


def _spin(node: Node, stop: StopSignal) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stop.when_set(executor.wake)
    try:
        while True:
            ready: Any = executor.wait_for_ready_callbacks(condition=stop.is_set)
            callback, entity = ready[0], ready[1]
            callback()
            error = callback.exception()
            if isinstance(error, END_OF_SPINNING):
                raise error
            if isinstance(error, IntuitivePhysicsError):
                node.get_logger().error(str(error))
            elif error is not None:
                unexpected_errors(node).report(error, "a callback")
                release(entity)
    except END_OF_SPINNING:
        pass
    finally:
        executor.shutdown()


def farewell(publishers: Iterable[Publisher], limit: float = FAREWELL_LIMIT) -> None:
    """Wait up to `limit` s until reliable subscribers have all that was published.

    Else the last messages may die with this process.
    """
    end = time.monotonic() + limit
    for publisher in publishers:
        left = max(0.0, end - time.monotonic())
        publisher.wait_for_all_acked(Duration(seconds=left))


def _ensure_log_folder() -> None:
    # rclpy.init fails when none of these names a folder for logs, as under some service managers.
    if not any(os.environ.get(name) for name in ("ROS_LOG_DIR", "ROS_HOME", "HOME")):
        os.environ["ROS_LOG_DIR"] = str(_log_folder())


def _log_folder() -> Path:
    """Return the folder systemd made for logs, else the user's own, else a new one."""
    given = os.environ.get("LOGS_DIRECTORY", "").partition(":")[0]
    folder = Path(given) if given else Path(pwd.getpwuid(os.getuid()).pw_dir) / ".ros" / "log"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        # Nobody else can have made it, or a link in its place, beforehand.
        return Path(tempfile.mkdtemp(prefix="ros_log_"))
    return folder


def _warn_of_unknown_overrides(node: Node) -> None:
    for name in unknown_overrides(node):
        node.get_logger().warning(
            f"parameter {name} was given, but this node has none of that name: it is ignored"
        )


def _explain(error: Exception) -> int:
    # rcl ends its messages with the places in its sources they passed through.
    sentence = re.sub(r",? at \S+:\d+", "", " ".join(str(error).split()))
    print(f"{Path(sys.argv[0]).name}: error: {sentence}", file=sys.stderr, flush=True)
    return 1


class StopSignal:
    """Is set by the first SIGINT or SIGTERM of this process; later ones change nothing.

    `STOP_LIMIT` after it the process ends with code 0, if it is still there; `HANG_LIMIT` after it
    with code 1, and the places where its threads were, if it hangs with Python's lock.

    rclpy's own handlers end its context at once, under the feet of callbacks and threads that
    publish. With this one everything still works until the node has been destroyed.

    Make it in the main thread, before `rclpy.init`, which must install no handlers of its own.
    """

    def __init__(self) -> None:
        # The handler interrupts itself when signals come fast, so it must take no lock.
        self._has_come = False
        self._event = threading.Event()
        self._lock = threading.Lock()
        self._action: Callable[[], None] = lambda: None
        # A handler in Python runs only once the main thread is back from waiting in C. What
        # arrives here arrives at once.
        self._arrivals, self._wakeup = socket.socketpair()
        self._wakeup.setblocking(False)
        for number in STOP_SIGNALS:
            signal.signal(number, self._set)
        signal.set_wakeup_fd(self._wakeup.fileno(), warn_on_full_buffer=False)
        os.register_at_fork(
            before=_hold_back, after_in_parent=_let_through, after_in_child=_leave_to_parent
        )
        threading.Thread(target=self._await, name="stop signal", daemon=True).start()

    def is_set(self) -> bool:
        """Whether a signal has come."""
        return self._has_come or self._event.is_set()

    def when_set(self, action: Callable[[], None]) -> None:
        """Call `action` from another thread as soon as a signal comes, at once if one has."""
        with self._lock:
            self._action = action
            if self._event.is_set():
                action()

    def ignore_rest(self) -> None:
        """Ignore SIGINT for good, even while Python itself ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    def _await(self) -> None:
        self._arrivals.recv(1)
        # This clock needs no lock of Python.
        faulthandler.dump_traceback_later(HANG_LIMIT, exit=True)
        with self._lock:
            self._event.set()
            # An executor that was shut down meanwhile has nobody left to wake.
            with suppress(InvalidHandle):
                self._action()
        time.sleep(STOP_LIMIT)
        print(
            f"{Path(sys.argv[0]).name}: ended while this was still under way: "
            + ", ".join(sorted(_unfinished())),
            file=sys.stderr,
            flush=True,
        )
        os._exit(0)

    def _set(self, number: int, frame: FrameType | None) -> None:
        self._has_come = True


def _unfinished() -> set[str]:
    """Names of the threads that run, besides the one that asks."""
    return {each.name for each in threading.enumerate() if each is not threading.current_thread()}


# A forked worker shares the socket: a signal to the worker would stop the node. So signals wait
# until the worker has become one that SIGTERM ends and that leaves SIGINT to the node.


def _hold_back() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)


def _let_through() -> None:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)


def _leave_to_parent() -> None:
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _let_through()
