"""A process that is started for a script or a test, and what it has written so far."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from intuitive_physics.errors import IntuitivePhysicsError

PATIENCE = 60.0
"""s to wait for what takes a few at most, on a machine that is busy with other things."""

STOP_TIMEOUT = 15.0
"""s that a process has to end by itself before it is killed."""

READ_TIMEOUT = 5.0
"""s to wait for the rest of what a process that has ended has written. What it started may hold its
output open for ever."""

LONGEST = 3600.0
"""s for which a process runs at most unless it is given another limit."""

Self = TypeVar("Self", bound="ChildProcess")


class ProcessFailedError(IntuitivePhysicsError):
    """A process ended, or did not write what was waited for."""


class ChildProcess:
    """A process whose output is read as it comes; as a context it is stopped at the end.

    Parameters
    ----------
    command : program and arguments
    name : by which errors name it; None: the program
    environment : of the process; None: that of this process
    folder : in which it runs; None: that of this process
    own_group : whether it leads a process group, so that signals reach all that it starts
    longest : s after which it is killed, should it still run
    """

    def __init__(
        self,
        command: Sequence[str],
        *,
        name: str | None = None,
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
        own_group: bool = False,
        longest: float = LONGEST,
    ) -> None:
        self.name = command[0] if name is None else name
        self._lines: list[str] = []
        self._own_group = own_group
        self.process = subprocess.Popen(
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env=None if environment is None else dict(environment),
            cwd=folder,
            start_new_session=own_group,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._limit = threading.Timer(longest, self.send_signal, [signal.SIGKILL])
        self._limit.daemon = True
        self._limit.start()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self.process.pid

    @property
    def output(self) -> str:
        """Text that it has written so far."""
        return "".join(self._lines)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def wait_for(self, text: str, timeout: float = PATIENCE, count: int = 1) -> None:
        """Wait until it has written `text`, `count` times.

        Raises
        ------
        ProcessFailedError
            When it has not after `timeout` seconds, or has ended without.
        """
        deadline = time.monotonic() + timeout
        while self.output.count(text) < count:
            if not self.is_running:
                self._reader.join(READ_TIMEOUT)
                if self.output.count(text) < count:
                    self.check_running()
            elif time.monotonic() > deadline:
                raise ProcessFailedError(
                    f"{self.name} has not written {text!r} after {timeout:.0f} s, "
                    f"but:\n{self.output}"
                )
            time.sleep(0.02)

    def check_running(self) -> None:
        """Raise `ProcessFailedError` with what it wrote if it has ended."""
        code = self.process.poll()
        if code is not None:
            self._reader.join(READ_TIMEOUT)
            raise ProcessFailedError(f"{self.name} ended with code {code}:\n{self.output}")

    def wait(self, timeout: float = PATIENCE) -> int:
        """Wait for it to end by itself and return its exit code.

        Raises
        ------
        ProcessFailedError
            When it has not ended after `timeout` seconds.
        """
        try:
            code = self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise ProcessFailedError(
                f"{self.name} has not ended after {timeout:.0f} s, but written:\n{self.output}"
            ) from None
        self._limit.cancel()
        self._reader.join(READ_TIMEOUT)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal to it, or to its group; to one that has ended, none."""
        if self.is_running:
            if self._own_group:
                os.killpg(self.pid, number)
            else:
                self.process.send_signal(number)

    def stop(self, number: int = signal.SIGINT, timeout: float = STOP_TIMEOUT) -> int:
        """Send a signal, kill it if that does not end it in time, and return its exit code."""
        self.send_signal(number)
        try:
            return self.wait(timeout)
        except ProcessFailedError:
            self.send_signal(signal.SIGKILL)
            return self.wait(STOP_TIMEOUT)

    def _read(self) -> None:
        for line in self.process.stdout or ():
            self._lines.append(line)

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
