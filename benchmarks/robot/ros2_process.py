"""The real `ros2` and `ros2 launch` as processes, for the tests that use them."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from intuitive_physics.processes import ChildProcess

# `ros2` of the environment that the tests run in
COMMAND = [sys.executable, "-u", "-c", "import sys; from ros2cli.cli import main; sys.exit(main())"]
# Arguments of `ros2` that start the suite
LAUNCH = ["launch", "intuitive_physics_bringup", "intuitive_physics.launch.py"]
STARTED = re.compile(r"process started with pid \[(\d+)\]")  # line of launch for each process


def environment(home: Path) -> dict[str, str]:
    """Return the environment of the tools, with a home folder of their own."""
    return {
        "AMENT_PREFIX_PATH": sys.prefix,
        **os.environ,
        "HOME": str(home),
        "XDG_DATA_HOME": str(home / "data"),
        "ROS_LOG_DIR": str(home / "log"),
        "NO_COLOR": "1",
    }


def ros2(home: Path, *arguments: str, timeout: float = 60.0) -> str:
    """Run one command of `ros2` to its end and return what it wrote; it must succeed.

    The daemon, which the first command starts, discovers nodes one after another: the command is
    repeated until the daemon has found the node.
    """
    end = time.monotonic() + timeout
    while True:
        ended = subprocess.run(
            [*COMMAND, *arguments],
            env=environment(home),
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
        if "Node not found" not in ended.stdout + ended.stderr or time.monotonic() > end:
            break
    assert ended.returncode == 0, f"ros2 {' '.join(arguments)}:\n{ended.stdout}{ended.stderr}"
    return ended.stdout


class Ros2Process(ChildProcess):
    """A command of `ros2` that runs on, in a process group of its own; ends with the block."""

    def __init__(self, home: Path, *arguments: str) -> None:
        command = [*COMMAND, *arguments]
        name = f"ros2 {' '.join(arguments)}"
        super().__init__(command, name=name, environment=environment(home), own_group=True)

    @property
    def children(self) -> list[int]:
        """Ids of the processes that launch started."""
        return [int(pid) for pid in STARTED.findall(self.output)]

    def pid_of(self, node: str) -> int:
        """Return the id of a node's newest process."""
        pids = re.findall(rf"\[{node}-\d+\]: process started with pid \[(\d+)\]", self.output)
        return int(pids[-1])

    def interrupt(self) -> float:
        """Press Ctrl-C; return how long it took, in s, until all had ended."""
        begun = time.monotonic()
        self.send_signal(signal.SIGINT)
        self.wait()
        return time.monotonic() - begun

    def left_behind(self) -> list[int]:
        """Ids of processes launch started that are still there."""
        return [pid for pid in self.children if Path(f"/proc/{pid}").exists()]

    def failed(self) -> list[int]:
        """Ids of processes that ended with another code than 0; not those whose code asyncio lost,
        which it reports as 255."""
        died = re.findall(r"process has died \[pid (\d+), exit code", self.output)
        lost = re.findall(r"Unknown child process pid (\d+)", self.output)
        return [int(pid) for pid in died if pid not in lost]
