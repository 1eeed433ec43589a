"""One node from start to clean shutdown: the whole `main` of every node executable."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
)
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_ros.parameters import unknown_overrides
from intuitive_physics_ros.stop_signal import StopSignal

START_ERRORS = (IntuitivePhysicsError, NameValidationException, ParameterException, RCLError)
"""What a user's mistake at start-up raises; anything else is a bug and shows its traceback."""

END_OF_SPINNING = (ConditionReachedException, ExternalShutdownException, ShutdownException)


def run_node(factory: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Make a node, run it on a single-threaded executor until it is told to stop, clean up.

    Ctrl-C (SIGINT), SIGTERM and `rclpy.try_shutdown` end it; signals that come while it ends
    change nothing. An `IntuitivePhysicsError` that leaves a callback is logged and the node goes
    on. A node that holds threads, processes or files closes them in its `destroy_node`, up to
    which it may publish.

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
    _ensure_log_folder()
    try:
        rclpy.init(
            args=None if args is None else list(args),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        node = factory()
    except START_ERRORS as error:
        rclpy.try_shutdown()
        return _explain(error)
    try:
        _warn_of_unknown_overrides(node)
        _spin(node, stop)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
        stop.ignore_rest()
    return 0


def _spin(node: Node, stop: StopSignal) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stop.when_set(executor.wake)
    try:
        while True:
            callback, _, _ = executor.wait_for_ready_callbacks(condition=stop.is_set)
            callback()
            error = callback.exception()
            if isinstance(error, IntuitivePhysicsError):
                node.get_logger().error(str(error))
            elif error is not None:
                raise error
    except END_OF_SPINNING:
        pass
    finally:
        executor.shutdown()


def _ensure_log_folder() -> None:
    # rclpy.init fails when none of these tells it where to log, as under some service managers.
    if not any(os.environ.get(name) for name in ("ROS_LOG_DIR", "ROS_HOME", "HOME")):
        folder = Path(tempfile.gettempdir()) / f"ros_log_{os.getuid()}"
        os.environ["ROS_LOG_DIR"] = str(folder)


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
