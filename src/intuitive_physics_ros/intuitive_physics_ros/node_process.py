"""Nodes as processes of their own, started and watched from a script or a test."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from types import TracebackType

from intuitive_physics.errors import IntuitivePhysicsError

STOP_TIMEOUT = 15.0
"""Seconds a node has to end by itself before it is killed."""


class NodeProcessError(IntuitivePhysicsError):
    """A node's process ended, or did not say what was waited for."""


class NodeProcess:
    """One node, running, and what it has written so far.

    Parameters
    ----------
    module : with the node's `main`, such as "intuitive_physics_predictor.nodes.predictor_node"
    arguments : after `--ros-args`, such as ["-p", "rate:=50.0"]
    environment : of the process; None: that of this process
    """

    def __init__(
        self,
        module: str,
        arguments: Sequence[str] = (),
        *,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.module = module
        self.output = ""
        ros_arguments = ["--ros-args", *arguments] if arguments else []
        # The module is run as the installed executable would run it.
        run = f"from {module} import main; raise SystemExit(main())"
        self.process = subprocess.Popen(
            [sys.executable, "-u", "-c", run, *ros_arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=None if environment is None else dict(environment),
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def wait_for(self, text: str, timeout: float = 20.0) -> None:
        """Wait until the node has written `text`.

        Raises
        ------
        NodeProcessError
            When it has not after `timeout` seconds, or has ended without.
        """
        deadline = time.monotonic() + timeout
        while text not in self.output:
            self.check_running()
            if time.monotonic() > deadline:
                raise NodeProcessError(
                    f"{self.module} has not written {text!r} after {timeout:.0f} s, "
                    f"but:\n{self.output}"
                )
            time.sleep(0.02)

    def check_running(self) -> None:
        """Raise `NodeProcessError` with what the node wrote if it has ended."""
        code = self.process.poll()
        if code is not None:
            self._reader.join(STOP_TIMEOUT)
            raise NodeProcessError(f"{self.module} ended with code {code}:\n{self.output}")

    def wait(self, timeout: float) -> int:
        """Wait for the node to end by itself and return its exit code."""
        try:
            code = self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise NodeProcessError(f"{self.module} has not ended after {timeout:.0f} s") from None
        self._reader.join(STOP_TIMEOUT)
        return code

    def stop(self, number: int = signal.SIGINT) -> int:
        """Tell the node to stop, kill it if it does not, and return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.wait(STOP_TIMEOUT)
        except NodeProcessError:
            self.process.kill()
            return self.wait(STOP_TIMEOUT)

    def _read(self) -> None:
        lines = self.process.stdout
        if lines is not None:
            for line in lines:
                self.output += line

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()
