"""The predictor node as a process beside an idle learner, watched from outside."""

from __future__ import annotations

import os
import struct
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from intuitive_physics_msgs.msg import TrajectoryDistribution
from numpy.typing import NDArray
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

from benchmarks.prediction.feed import RATE, Feed
from intuitive_physics_ros.scripting import NodeProcess, Peer, PeerTimeoutError
from intuitive_physics_ros.topics import PREDICTIONS

# Module of the node that is measured
PREDICTOR = "intuitive_physics_predictor.nodes.predictor_node"
# Module of the node that is idle beside it
LEARNER = "intuitive_physics_learner.nodes.learner_node"
NODE = "/predictor_node"  # name of the node that is measured
HOLDS = 99.0  # 1/s, at least; as of the bars
# Samples in a message: 6 MB an object; two of them fill the shared memory of a participant
MOST_PUBLISHED = 1000
TRIES = 3  # of each number of samples, until one holds
FIRST = 60.0  # s to wait for the first message
SETTLING = 3.0  # s after the first message, or after a change, before anything counts
# Best effort as the publisher; deep, so that nothing is lost while this process is busy
QUEUE = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


@dataclass(frozen=True)
class Run:
    """What was seen of the node for some time."""

    seconds: float  # for how long
    rate: float  # 1/s, messages that arrived
    lost: float  # share of the predictions made whose message did not arrive
    # latency_median, latency_p99: ms from the tick, when the prediction was due, until its message
    # lay in the subscriber's queue
    latency_median: float
    latency_p99: float
    cpu: float  # share of one core
    # memory, growth: MB resident at the end, and since the first tenth of the time
    memory: float
    growth: float
    message_size: float  # MB


class NodeUnderTest:
    """Starts the nodes, feeds the predictor and receives its messages."""

    def __init__(self, feed: Feed, **parameters: object) -> None:
        arguments = [
            part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")
        ]
        self._heard: list[tuple[float, float, int, int]] = []
        # Its types do not say that a callback may have a second argument.
        hear: Any = self._hear
        self._feed = feed
        with ExitStack() as started:
            folder = started.enter_context(tempfile.TemporaryDirectory())
            database = Path(folder) / "learner.sqlite3"
            started.enter_context(NodeProcess(LEARNER, ["-p", f"database:={database}"]))
            self._predictor = started.enter_context(NodeProcess(PREDICTOR, arguments))
            self.peer = started.enter_context(Peer("bench", timeout=FIRST))
            self._subscription = self.peer.node.create_subscription(
                TrajectoryDistribution, PREDICTIONS, hear, QUEUE, raw=True
            )
            feed.start(self.peer)
            self._started = started.pop_all()

    def _watch(self, seconds: float) -> None:
        """Feed the node for some seconds; after each state take what it has sent since.

        When a message arrived is written on it by then. An executor would wait for each of them,
        and take a quarter of a core of the two that are the node's to do so.
        """
        due = time.monotonic()
        end = due + seconds
        while due < end:
            self._feed.publish()
            queue = self._subscription.handle
            with queue:
                while taken := queue.take_message(TrajectoryDistribution, True):
                    self._hear(*taken)
            due += 1.0 / RATE
            time.sleep(max(0.0, due - time.monotonic()))

    def _hear(self, message: bytes, info: dict[str, int]) -> None:
        """Keep stamp (s), arrival (s), number of the prediction and size of a message."""
        # CDR: four bytes that give the byte order, then header.stamp.
        sec, nanosec = struct.unpack_from("<iI", message, 4)
        # The seed, which grows by one each time, and the time it took come last.
        (number,) = struct.unpack_from("<Q", message, len(message) - 16)
        arrival = 1e-9 * info["received_timestamp"]
        self._heard.append((sec + 1e-9 * nanosec, arrival, number, len(message)))

    def set(self, **values: object) -> None:
        """Set parameters of the node."""
        request = SetParameters.Request(
            parameters=[
                Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
            ]
        )
        self.peer.call(SetParameters, f"{NODE}/set_parameters", request)

    def run(self, seconds: float) -> Run:
        """Watch the node, once it predicts steadily, in a thread of low priority (s)."""
        with ThreadPoolExecutor(1, initializer=_give_way) as thread:
            return thread.submit(self._measure, seconds).result()

    def _measure(self, seconds: float) -> Run:
        self._heard.clear()
        deadline = time.monotonic() + FIRST
        while not self._heard and time.monotonic() < deadline:
            self._watch(0.1)
        if not self._heard:
            raise PeerTimeoutError(f"waited {FIRST:.0f} s in vain for the first prediction")
        self._watch(SETTLING)
        self._heard.clear()
        pid = self._predictor.pid
        begun, used, memory = time.monotonic(), _cpu_seconds(pid), []
        while time.monotonic() - begun < seconds:
            self._watch(min(0.5, seconds / 20))
            memory.append(_resident_megabytes(pid))
        self._predictor.check_running()
        passed = time.monotonic() - begun
        return _run(np.array(self._heard), passed, (_cpu_seconds(pid) - used) / passed, memory)

    def __enter__(self) -> NodeUnderTest:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._started.close()


def largest_sample_count(node: NodeUnderTest, seconds: float) -> int:
    """Return the largest number of samples with which the node still predicts 99 times a second.

    It grows by half until it is too large, then the last gap is halved twice. Each number has a few
    tries: what else the machine does can only take away.
    """

    def holds(count: int) -> bool:
        node.set(sample_count=count)
        return any(node.run(seconds).rate >= HOLDS for _ in range(TRIES))

    good, bad = 0, 20
    while bad <= 10_000 and holds(bad):
        good, bad = bad, bad * 3 // 2
    for _ in range(2):
        middle = (good + bad) // 2
        if holds(middle):
            good = middle
        else:
            bad = middle
    return good


def _give_way() -> None:
    """Let all other threads go first: what feeds and measures is not to hold up the node."""
    # On Linux, 0 is the calling thread alone.
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def _run(heard: NDArray[np.float64], seconds: float, cpu: float, memory: list[float]) -> Run:
    stamps, arrivals, numbers, sizes = heard.T
    latencies = 1e3 * (arrivals - stamps)
    made = numbers[-1] - numbers[0] + 1
    return Run(
        seconds=seconds,
        rate=len(heard) / seconds,
        lost=float(1.0 - len(heard) / made),
        latency_median=float(np.median(latencies)),
        latency_p99=float(np.quantile(latencies, 0.99)),
        cpu=cpu,
        memory=memory[-1],
        growth=memory[-1] - memory[len(memory) // 10],
        message_size=float(1e-6 * sizes.mean()),
    )


def _cpu_seconds(pid: int) -> float:
    after_name = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    # utime and stime, fields 14 and 15 of the line (proc(5)).
    return (int(after_name[11]) + int(after_name[12])) / os.sysconf("SC_CLK_TCK")


def _resident_megabytes(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return 1e-6 * pages * os.sysconf("SC_PAGE_SIZE")
