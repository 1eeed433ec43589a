"""The nodes under torture, and how they are watched."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters

from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_bringup.connections import NODES, module
from intuitive_physics_ros.scripting import NodeProcess, Peer

PATIENCE = 60.0
"""s to wait for the start of a node on a busy machine."""

ANSWER = 10.0
"""s after which a ping that was not answered counts as never answered."""

HANG = 1.0
"""s in which a node has to answer a ping; of the bars."""


class Nodes:
    """The three nodes as processes; one that has died is started again.

    Parameters
    ----------
    folder : for the learner's database
    peer : that pings them
    """

    def __init__(self, folder: Path, peer: Peer) -> None:
        self.database = folder / "learner.sqlite3"
        self.deaths: list[str] = []
        self.most_megabytes = 0.0
        self._peer = peer
        self._stack = ExitStack()
        self.processes: dict[str, NodeProcess] = {}
        for name in NODES:
            self._start(name)
        for name in NODES:
            self.ping(name, PATIENCE)

    def ping(self, name: str, longest: float = ANSWER) -> float:
        """Return how long a node took for an answer, s; `longest` where there was none."""
        begun = time.monotonic()
        request = GetParameters.Request(names=["use_sim_time"])
        try:
            self._peer.call(GetParameters, f"/{name}/get_parameters", request, longest)
        except Exception:
            if self.processes[name].process.poll() is None:
                return longest
        return time.monotonic() - begun

    def revive(self) -> None:
        """Note nodes that have died, with the last thing they said, and start them again."""
        for name, process in self.processes.items():
            if process.process.poll() is not None:
                said = process.output.strip().splitlines()[-1:] or ["nothing"]
                self.deaths.append(f"{name} (code {process.process.returncode}): {said[0]}")
                self._start(name)
                self.ping(name, PATIENCE)

    def measure_memory(self) -> None:
        """Note the most memory that a node has had."""
        for process in self.processes.values():
            status = Path(f"/proc/{process.process.pid}/status")
            if status.exists():
                for line in status.read_text().splitlines():
                    if line.startswith("VmHWM:"):
                        self.most_megabytes = max(self.most_megabytes, int(line.split()[1]) / 1e3)

    def stop(self) -> dict[str, tuple[float, int]]:
        """Stop all nodes, one after another, and return the time each took, s, and its code."""
        found = {}
        for name, process in self.processes.items():
            begun = time.monotonic()
            code = process.stop()
            found[name] = (time.monotonic() - begun, code)
        return found

    def _start(self, name: str) -> None:
        parameters: Sequence[str] = ()
        if name == "learner_node":
            parameters = ("-p", f"database:={self.database}")
        process = NodeProcess(module(name), parameters)
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
