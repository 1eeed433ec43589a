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

import numpy as np
from intuitive_physics_msgs.msg import TrajectoryDistribution
from numpy.typing import NDArray
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from benchmarks.prediction.feed import Feed
from benchmarks.running_nodes import (
    LEARNER,
    PREDICTOR,
    RATE,
    SECOND,
    MessageQueue,
    header_stamp,
    parameter_arguments,
)
from intuitive_physics_bringup.connections import module
from intuitive_physics_ros.scripting import NodeProcess, Peer, PeerTimeoutError
from intuitive_physics_ros.topics import PREDICTIONS

HOLDS = 99.0  # 1/s, at least; as of the bars
# Samples in a message: 6 MB an object; two of them fill the shared memory of a participant
MOST_PUBLISHED = 1000
TRIES = 3  # of each number of samples, until one holds
FIRST = 60.0  # s to wait for the first message
SETTLING = 3.0  # s after the first message, or after a change, before anything counts


@dataclass(frozen=True)
class Run:
    """The work of the node for some time, in the order of the columns of its table."""

    seconds: float  # for how long
    rate: float  # 1/s, messages that arrived
    lost: float  # %, of the predictions whose message did not arrive
    # ms from the tick, when the prediction was due, until its message lay in the subscriber's queue
    latency_median: float
    latency_p99: float
    cpu: float  # %, of one core
    memory: float  # MB resident at the end
    growth: float  # MB since the first tenth of the time
    message_size: float  # MB


class NodeUnderTest(ExitStack):
    """The predictor with some parameters, fed, and an idle learner, until it is closed."""

    def __init__(self, feed: Feed, **parameters: object) -> None:
        super().__init__()
        self._feed = feed
        # Stamp (s), arrival (s), number of the prediction and size of each message
        self._received: list[tuple[float, float, int, int]] = []
        with ExitStack() as started:
            folder = Path(started.enter_context(tempfile.TemporaryDirectory()))
            database = parameter_arguments(database=folder / "learner.sqlite3")
            started.enter_context(NodeProcess(module(LEARNER), database))
            self._predictor = started.enter_context(
                NodeProcess(module(PREDICTOR), parameter_arguments(**parameters))
            )
            self._peer = started.enter_context(Peer("bench", timeout=FIRST))
            self._queue = MessageQueue(self._peer, TrajectoryDistribution, PREDICTIONS)
            feed.start(self._peer)
            self.push(started.pop_all())

    def _watch(self, seconds: float) -> None:
        """Feed the node for some seconds; after each state take the messages since the last."""
        due = time.monotonic()
        end = due + seconds
        while due < end:
            self._feed.publish()
            for message, arrival in self._queue.take():
                # The seed, which grows by one each time, and the time it took come last.
                (number,) = struct.unpack_from("<Q", message, len(message) - 16)
                stamp = header_stamp(message) / SECOND
                self._received.append((stamp, arrival, number, len(message)))
            due += 1.0 / RATE
            time.sleep(max(0.0, due - time.monotonic()))

    def set(self, **values: object) -> None:
        """Set parameters of the node."""
        request = SetParameters.Request(
            parameters=[
                Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
            ]
        )
        self._peer.call(SetParameters, f"/{PREDICTOR}/set_parameters", request)

    def run(self, seconds: float, settling: float = SETTLING) -> Run:
        """Watch the node for some seconds in a thread of low priority, once it predicts steadily.

        Nothing counts for `settling` s after the first message.
        """
        with ThreadPoolExecutor(1, initializer=_give_way) as thread:
            return thread.submit(self._measure, seconds, settling).result()

    def _measure(self, seconds: float, settling: float) -> Run:
        self._received.clear()
        deadline = time.monotonic() + FIRST
        while not self._received and time.monotonic() < deadline:
            self._watch(0.1)
        if not self._received:
            raise PeerTimeoutError(f"waited {FIRST:.0f} s in vain for the first prediction")
        self._watch(settling)
        self._received.clear()
        pid = self._predictor.pid
        begin, used, memory = time.monotonic(), _cpu_seconds(pid), []
        while time.monotonic() - begin < seconds:
            self._watch(min(0.5, seconds / 20))
            memory.append(_resident_megabytes(pid))
        self._predictor.check_running()
        passed = time.monotonic() - begin
        return _run(np.array(self._received), passed, (_cpu_seconds(pid) - used) / passed, memory)


def largest_sample_count(
    node: NodeUnderTest, seconds: float, settling: float = SETTLING, tries: int = TRIES
) -> int:
    """Return the largest number of samples with which the node still predicts 99 times a second.

    It grows by half until it is too large, then the last gap is halved twice. Each number has a few
    tries: other work of the machine can only take time away.
    """

    def holds(count: int) -> bool:
        node.set(sample_count=count)
        return any(node.run(seconds, settling).rate >= HOLDS for _ in range(tries))

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
    """Let all other threads go first: the benchmark must not hold up the node."""
    # On Linux, 0 is the calling thread alone.
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def _run(received: NDArray[np.float64], seconds: float, cpu: float, memory: list[float]) -> Run:
    stamps, arrivals, numbers, sizes = received.T
    latencies = 1e3 * (arrivals - stamps)
    made = numbers[-1] - numbers[0] + 1
    return Run(
        seconds=seconds,
        rate=len(received) / seconds,
        lost=float(100.0 * (1.0 - len(received) / made)),
        latency_median=float(np.median(latencies)),
        latency_p99=float(np.quantile(latencies, 0.99)),
        cpu=100.0 * cpu,
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
