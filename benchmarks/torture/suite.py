"""The whole suite at work: a camera, the three nodes as processes, and their predictions."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from intuitive_physics_msgs.msg import TrajectoryDistribution

from benchmarks.running_nodes import (
    LEARNER,
    PERCEPTION,
    PERCEPTION_ARGUMENTS,
    PREDICTOR,
    SECOND,
    MessageQueue,
    parameter_arguments,
    prediction_rate,
    states_stamp,
)
from benchmarks.torture.camera import EndlessCamera
from benchmarks.torture.early_end import EarlyEndError
from benchmarks.torture.nodes import Nodes
from intuitive_physics.processes.child_process import LONGEST
from intuitive_physics_ros.scripting import Peer
from intuitive_physics_ros.topics import PREDICTIONS

START_TIMEOUT = 90.0  # s until the first prediction, on a busy machine


class Predictions:
    """Times of the predictions that a peer receives."""

    def __init__(self, peer: Peer) -> None:
        # Deep, so that nothing is lost while the queue is left alone for some seconds.
        self._queue = MessageQueue(peer, TrajectoryDistribution, f"/{PREDICTIONS}", depth=2000)

    def take(self) -> list[tuple[float, float]]:
        """Return the arrivals since the last call, and the stamps of their states; s, both."""
        return [(arrival, states_stamp(data) / SECOND) for data, arrival in self._queue.take()]

    def wait(self, stamp: float, timeout: float) -> bool:
        """Return whether a prediction from states of a time (s) or soon after it comes in time."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            if any(0.0 <= states - stamp < 2.0 * timeout for _, states in self.take()):
                return True
            time.sleep(0.02)
        return False

    def rate(self, seconds: float) -> float:
        """Return the predictions a second of the next `seconds` while an object is tracked."""
        self.take()
        time.sleep(seconds)
        return prediction_rate([arrival for arrival, _ in self.take()])


@dataclass
class Suite:
    """All that runs, and the diagnostics since the start."""

    peer: Peer
    nodes: Nodes
    camera: EndlessCamera
    predictions: Predictions
    diagnostics: list[DiagnosticArray]

    def reports(self, node: str, level: bytes, since: int = 0) -> list[str]:
        """Return what a node reported on /diagnostics at a level, after `since` messages."""
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
    """Start everything, the nodes with the camera's clock or their own, until the first prediction.

    Raises `EarlyEndError` when no prediction comes. A node runs for `longest` s at most.
    """
    clock = parameter_arguments(use_sim_time="true") if has_clock else []
    arguments = dict.fromkeys((LEARNER, PREDICTOR), clock)
    arguments[PERCEPTION] = [*PERCEPTION_ARGUMENTS, *clock]
    with EndlessCamera(folder, seed, has_clock=has_clock) as camera, Peer("torturer", 60.0) as peer:
        diagnostics = peer.listen(DiagnosticArray, "/diagnostics", 100)
        predictions = Predictions(peer)
        with Nodes(folder, peer, arguments, longest) as nodes:
            if not predictions.wait(camera.time, START_TIMEOUT):
                nodes.revive()
                why = "; ".join(nodes.deaths) or "no node has died"
                raise EarlyEndError(f"no prediction within {START_TIMEOUT:.0f} s: {why}")
            yield Suite(peer, nodes, camera, predictions, diagnostics)
