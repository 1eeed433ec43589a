"""The whole suite at work: a camera, the three nodes as processes, and what they predict."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from intuitive_physics_msgs.msg import TrajectoryDistribution
from rclpy.qos import QoSProfile, ReliabilityPolicy

from benchmarks.perception.end_to_end import states_stamp
from benchmarks.torture.camera import PERCEPTION_ARGUMENTS, Camera
from benchmarks.torture.early_end import EarlyEndError
from benchmarks.torture.nodes import LEARNER, PERCEPTION, PREDICTOR, Nodes
from intuitive_physics.processes.child_process import LONGEST
from intuitive_physics_ros.scripting import Peer
from intuitive_physics_ros.topics import PREDICTIONS

LONGEST_PERIOD = 0.25  # s; a longer time without a prediction is one in which nothing was followed
START_TIMEOUT = 90.0  # s until the first prediction, on a busy machine
# Deep, so that nothing is lost while nobody looks for some seconds
QUEUE = QoSProfile(depth=2000, reliability=ReliabilityPolicy.BEST_EFFORT)


class Predictions:
    """When predictions arrived.

    They are taken from the middleware's queue, where they carry the time of their arrival: an
    executor that waited for each would take from the nodes' two cores.
    """

    def __init__(self, peer: Peer) -> None:
        self._subscription = peer.node.create_subscription(
            TrajectoryDistribution, f"/{PREDICTIONS}", _leave, QUEUE, raw=True
        )

    def take(self) -> list[tuple[float, float]]:
        """Return the arrivals since the last call, and the stamps of their states; s, both."""
        found = []
        handle = self._subscription.handle
        with handle:
            while taken := handle.take_message(TrajectoryDistribution, True):
                data, info = taken
                found.append((1e-9 * info["received_timestamp"], 1e-9 * states_stamp(data)))
        return found

    def wait(self, stamp: float, timeout: float) -> bool:
        """Wait for a prediction from states of a time (s) or soon after it."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            if any(0.0 <= found - stamp < 2.0 * timeout for _, found in self.take()):
                return True
            time.sleep(0.02)
        return False

    def rate(self, seconds: float) -> float:
        """Return the predictions a second of the next `seconds` while something was followed."""
        self.take()
        time.sleep(seconds)
        return rate_of([arrival for arrival, _ in self.take()])


def rate_of(arrivals: Sequence[float]) -> float:
    """Return predictions a second while something was followed; 0 without any."""
    periods = np.diff(arrivals)
    followed = periods[periods < LONGEST_PERIOD]
    return float(followed.size / followed.sum()) if followed.size else 0.0


def _leave(_: bytes) -> None:
    """Take no message: all are taken from the queue."""


@dataclass
class Suite:
    """What runs."""

    peer: Peer  # that pings and calls
    nodes: Nodes  # as processes
    camera: Camera  # that perception sees through
    predictions: Predictions  # of the predictor
    diagnostics: list[DiagnosticArray]  # all messages since the start

    def said(self, node: str, level: bytes, since: int = 0) -> list[str]:
        """Return what a node has said on /diagnostics at a level."""
        return [
            status.message
            for message in self.diagnostics[since:]
            for status in message.status
            if status.name.startswith(f"{node}:") and status.level == level
        ]


@contextmanager
def running_suite(
    folder: Path, seed: int, *, has_clock: bool = False, longest: float = LONGEST
) -> Iterator[Suite]:
    """Start everything, and go on when the first prediction has come."""
    clock = ["-p", "use_sim_time:=true"] if has_clock else []
    arguments = dict.fromkeys((LEARNER, PREDICTOR), clock)
    arguments[PERCEPTION] = [*PERCEPTION_ARGUMENTS, *clock]
    with Camera(folder, seed, has_clock=has_clock) as camera, Peer("torturer", 60.0) as peer:
        diagnostics = peer.listen(DiagnosticArray, "/diagnostics", 100)
        predictions = Predictions(peer)
        with Nodes(folder, peer, arguments, longest) as nodes:
            if not predictions.wait(camera.time, START_TIMEOUT):
                nodes.revive()
                why = "; ".join(nodes.deaths) or "no node has died"
                raise EarlyEndError(f"no prediction within {START_TIMEOUT:.0f} s: {why}")
            yield Suite(peer, nodes, camera, predictions, diagnostics)
