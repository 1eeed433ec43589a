"""The nodes under torture, and how they are watched."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters

from benchmarks.torture.early_end import EarlyEndError
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.processes.child_process import LONGEST
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_bringup.connections import NODES, module
from intuitive_physics_ros.scripting import NodeProcess, Peer, PeerTimeoutError

# Names of the nodes
PERCEPTION, LEARNER, PREDICTOR = "perception_node", "learner_node", "predictor_node"
PATIENCE = 60.0  # s to wait for the start of a node on a busy machine
ANSWER = 30.0  # s after which a ping that was not answered counts as never answered


class Nodes:
    """Nodes as processes; one that has died is started again."""

    def __init__(
        self,
        folder: Path,
        peer: Peer,
        arguments: Mapping[str, Sequence[str]] = MappingProxyType({}),
        longest: float = LONGEST,
        modules: Mapping[str, str] | None = None,
    ) -> None:
        self._modules = {name: module(name) for name in NODES} if modules is None else modules
        self._longest = longest
        self._arguments = arguments
        self.database = folder / "learner.sqlite3"
        self.deaths: list[str] = []
        self.most_megabytes = 0.0
        self._peer = peer
        self._stack = ExitStack()
        self.processes: dict[str, NodeProcess] = {}
        for name in self._modules:
            self._start(name)
        for name in self._modules:
            self.ping(name, PATIENCE)

    def ping(self, name: str, longest: float = ANSWER) -> float:
        """Return how long a node took for an answer, s; `longest` where there was none."""
        begun = time.monotonic()
        request = GetParameters.Request(names=["use_sim_time"])
        try:
            self._peer.call(GetParameters, f"/{name}/get_parameters", request, longest)
        except Exception:
            if self.processes[name].is_running:
                return longest
        return time.monotonic() - begun

    def revive(self) -> list[str]:
        """Note nodes that have died, with the last thing they said, and start them again."""
        died = []
        for name, process in self.processes.items():
            if not process.is_running:
                self.deaths.append(last_words(name, process))
                died.append(name)
                self._start(name)
                self.ping(name, PATIENCE)
        return died

    def measure_memory(self) -> None:
        """Note the most memory that a node, with what it started, has had."""
        peaks = [peak_megabytes(process.pid) for process in self.processes.values()]
        self.most_megabytes = max(self.most_megabytes, *peaks)

    def stop(self) -> dict[str, tuple[float, int]]:
        """Stop all nodes, one after another, and return the time each took, s, and its code."""
        found = {}
        for name, process in self.processes.items():
            begun = time.monotonic()
            code = process.stop()
            found[name] = (time.monotonic() - begun, code)
        return found

    def _start(self, name: str) -> None:
        arguments = [*self._arguments.get(name, ())]
        if name == LEARNER:
            arguments += ["-p", f"database:={self.database}"]
        process = NodeProcess(self._modules[name], arguments, longest=self._longest)
        self.processes[name] = self._stack.enter_context(process)

    def __enter__(self) -> Nodes:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stack.close()


def last_words(name: str, process: NodeProcess) -> str:
    """Return of a node that has died its name, its exit code, and the last thing it said."""
    code = process.wait()
    said = process.output.strip().splitlines()[-1:] or ["nothing"]
    return f"{name} died (code {code}) and said last: {said[0]}"


@contextmanager
def blamed_on_death(name: str, process: NodeProcess) -> Iterator[None]:
    """Say that a node died where it did, instead of that it does not answer or is not there."""
    try:
        yield
    except (PeerTimeoutError, OSError):
        if process.is_running:
            raise
        raise EarlyEndError(last_words(name, process)) from None


def family(pid: int) -> dict[int, str]:
    """Return a process and all that it or its children started, with their command lines."""
    found: dict[int, str] = {}
    waiting = [pid]
    while waiting:
        folder = Path(f"/proc/{(one := waiting.pop())}")
        with suppress(FileNotFoundError, ProcessLookupError):
            found[one] = (folder / "cmdline").read_text().replace("\0", " ")
            for task in (folder / "task").iterdir():
                waiting += [int(child) for child in (task / "children").read_text().split()]
    return found


def megabytes(pid: int) -> float:
    """Return the resident memory of a process and of what it started, MB."""
    pages = 0
    for one in family(pid):
        with suppress(FileNotFoundError):
            pages += int(Path(f"/proc/{one}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def peak_megabytes(pid: int) -> float:
    """Return the most resident memory of a process and of each that it started and that runs, MB.

    The peaks of several processes need not have been at one time: their sum is an upper bound.
    """
    kilobytes = 0
    for one in family(pid):
        with suppress(FileNotFoundError, ProcessLookupError):
            status = Path(f"/proc/{one}/status").read_text()
            # A process that has ended and was not waited for has no such line.
            kilobytes += sum(map(int, re.findall(r"^VmHWM:\s+(\d+) kB$", status, re.MULTILINE)))
    return kilobytes * 1024 / 1e6


def thrown_ball(number: int) -> Observation:
    """Return an observation of a ball that was thrown, another one for each number."""
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


def worst(values: Mapping[str, Any] | Sequence[float]) -> float:
    """Return the largest of some values, zero of none."""
    return max(values.values() if isinstance(values, Mapping) else values, default=0.0)
