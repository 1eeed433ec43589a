"""The nodes under torture, and how they are watched."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np
from rcl_interfaces.srv import GetParameters

from benchmarks.running_nodes import LEARNER, parameter_arguments
from benchmarks.torture.early_end import EarlyEndError
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.processes.child_process import LONGEST
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_bringup.connections import NODES, module
from intuitive_physics_ros.scripting import NodeProcess, Peer, PeerTimeoutError

PATIENCE = 60.0  # s to wait for the start of a node on a busy machine
ANSWER = 30.0  # s after which a ping that was not answered counts as never answered


class Nodes(ExitStack):
    """Nodes as processes, the three of the suite or other modules; a dead one is started again.

    Command-line arguments after `--ros-args` and modules are by the names of the nodes. A node runs
    for `longest` s at most. The peer pings them.
    """

    def __init__(
        self,
        folder: Path,
        peer: Peer,
        arguments: Mapping[str, Sequence[str]],
        longest: float = LONGEST,
        modules: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__()
        self._modules = {name: module(name) for name in NODES} if modules is None else modules
        self._longest = longest
        self._arguments = arguments
        self._peer = peer
        self.database = folder / "learner.sqlite3"
        self.deaths: list[str] = []
        self.processes: dict[str, NodeProcess] = {}
        for name in self._modules:
            self._start(name)
        for name in self._modules:
            self.ping(name, PATIENCE)

    def ping(self, name: str, longest: float = ANSWER) -> float:
        """Return the time (s) until a node answers; `longest` where it does not."""
        begin = time.monotonic()
        try:
            ping(self._peer, name, longest)
        except Exception:
            if self.processes[name].is_running:
                return longest
        return time.monotonic() - begin

    def revive(self) -> list[str]:
        """Note the last words of nodes that have died, start them again, and return their names."""
        died = [name for name, process in self.processes.items() if not process.is_running]
        for name in died:
            self.deaths.append(last_words(name, self.processes[name]))
            self._start(name)
            self.ping(name, PATIENCE)
        return died

    def peak_megabytes(self) -> float:
        """Return the most memory that any of the nodes, with its children, has had."""
        return max(peak_megabytes(process.pid) for process in self.processes.values())

    def stop(self) -> dict[str, tuple[float, int]]:
        """Stop all nodes, one after another, and return the time each took, s, and its code."""
        stops = {}
        for name, process in self.processes.items():
            begin = time.monotonic()
            code = process.stop()
            stops[name] = (time.monotonic() - begin, code)
        return stops

    def _start(self, name: str) -> None:
        arguments = [*self._arguments.get(name, ())]
        if name == LEARNER:
            arguments += parameter_arguments(database=self.database)
        process = NodeProcess(self._modules[name], arguments, longest=self._longest)
        self.processes[name] = self.enter_context(process)


def ping(peer: Peer, node: str, timeout: float) -> None:
    """Wait until a node answers."""
    request = GetParameters.Request(names=["use_sim_time"])
    peer.call(GetParameters, f"/{node}/get_parameters", request, timeout)


def last_words(name: str, process: NodeProcess) -> str:
    """Return the name of a dead node, its exit code, and the last line that it wrote."""
    code = process.wait()
    line = process.output.strip().splitlines()[-1:] or ["nothing"]
    return f"{name} died (code {code}) and said last: {line[0]}"


@contextmanager
def blamed_on_death(name: str, process: NodeProcess) -> Iterator[None]:
    """Report the death of a node in place of the missing answer or file that follows from it."""
    try:
        yield
    except (PeerTimeoutError, OSError):
        if process.is_running:
            raise
        raise EarlyEndError(last_words(name, process)) from None


def family(pid: int) -> dict[int, str]:
    """Return a process and its descendants, with their command lines."""
    commands: dict[int, str] = {}
    waiting = [pid]
    while waiting:
        member = waiting.pop()
        folder = Path(f"/proc/{member}")
        with suppress(FileNotFoundError, ProcessLookupError):
            commands[member] = (folder / "cmdline").read_text().replace("\0", " ")
            for task in (folder / "task").iterdir():
                waiting += [int(child) for child in (task / "children").read_text().split()]
    return commands


def megabytes(pid: int) -> float:
    """Return the resident memory of a process and of its descendants, MB."""
    pages = 0
    for member in family(pid):
        with suppress(FileNotFoundError):
            pages += int(Path(f"/proc/{member}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def peak_megabytes(pid: int) -> float:
    """Return the most resident memory of a process and of each running descendant, MB.

    The peaks of several processes need not have been at one time: their sum is an upper bound.
    """
    kilobytes = 0
    for member in family(pid):
        with suppress(FileNotFoundError, ProcessLookupError):
            status = Path(f"/proc/{member}/status").read_text()
            # A process that has ended and was not waited for has no such line.
            kilobytes += sum(map(int, re.findall(r"^VmHWM:\s+(\d+) kB$", status, re.MULTILINE)))
    return kilobytes * 1024 / 1e6


def thrown_ball(number: int) -> Observation:
    """Return an observation of a thrown ball, a different one for each number."""
    times = np.linspace(0.0, 0.5, 16)
    velocity = np.array([1.0 + 1e-4 * number, 0.0, 1.0])
    places = [0.0, 0.0, 0.5] + np.outer(times, velocity) + np.outer(times**2, [0.0, 0.0, -4.905])
    ball = ObservedObject(
        SceneObject("ball", "rubber", Sphere(0.05)),
        Trajectory(times + number, places),
        ObjectState((0.0, 0.0, 0.5), linear_velocity=velocity),
    )
    floor = Environment([Plane("floor", "wood", (0, 0, 1), 0.0)])
    return Observation(floor, (ball,), float(number), f"throw {number}")
