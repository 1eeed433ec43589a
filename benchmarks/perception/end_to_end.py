"""From a depth image to the predicted distribution: the three nodes as processes, watched."""

from __future__ import annotations

import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from intuitive_physics_msgs.msg import ObjectStates, TrajectoryDistribution
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message

from benchmarks.command import Outcome, report_progress
from benchmarks.results.result import Cell, Column, Table
from benchmarks.running_nodes import (
    LEARNER,
    PERCEPTION,
    PERCEPTION_ARGUMENTS,
    RATE,
    DepthPublisher,
    MessageQueue,
    header_stamp,
    parameter_arguments,
    recorded_images,
    states_stamp,
)
from intuitive_physics_bringup.connections import NODES, module
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_ros.scripting import NodeProcess, Peer
from intuitive_physics_ros.topics import OBJECT_STATES, PREDICTIONS

SEED = 23  # of the throws and of the camera's noise
THROWS, QUICK_THROWS = 20, 3  # one after another
FIRST_THROWS = 1  # do not count: the learner's and the predictor's first work is done in them
MICROSECOND = 1000  # ns, to which stamps are rounded: as seconds they are exact to 0.2 µs
TIMEOUT = 60.0  # s to wait for the nodes
LAST = 0.5  # s after the last image in which its states and distribution arrive

STATES, DISTRIBUTION = "states of objects", "distribution"


def measure_end_to_end(quick: bool) -> Outcome:
    """Measure the time from an image's stamp to the states and the distribution made from it."""
    report_progress("from image to distribution: three nodes as processes")
    throws = FIRST_THROWS + (QUICK_THROWS if quick else THROWS)
    with tempfile.TemporaryDirectory(prefix="bench-end-to-end-") as folder:
        bag = Path(folder) / "bag"
        truth = render_bag(bag, RenderSettings(throws=throws, seed=SEED, frame_rate=RATE))
        latencies = _measure(bag, Path(folder), truth.throws[FIRST_THROWS].start_time)
    if not latencies[DISTRIBUTION].size:
        raise RuntimeError("no image led to a distribution")
    p50, p99 = np.quantile(latencies[DISTRIBUTION], [0.5, 0.99])
    figures = {"p50": float(f"{p50:.4g}"), "p99": float(f"{p99:.4g}")}
    return Outcome([_table(latencies)], {"end_to_end_ms": figures})


def _measure(bag: Path, folder: Path, first: float) -> dict[str, NDArray[np.float64]]:
    """Play a bag to the three nodes; return latencies (n,) ms of images later than `first` s."""
    arguments = {
        PERCEPTION: PERCEPTION_ARGUMENTS,
        LEARNER: parameter_arguments(database=folder / "learner.sqlite3"),
    }
    with ExitStack() as started:
        for name in NODES:
            started.enter_context(NodeProcess(module(name), arguments.get(name, ())))
        peer = started.enter_context(Peer("bench", timeout=TIMEOUT))
        return _play(peer, bag, first)


def _play(peer: Peer, bag: Path, first: float) -> dict[str, NDArray[np.float64]]:
    """Publish each image when it is due, that moment its stamp, and take what arrives."""
    states = MessageQueue(peer, ObjectStates, f"/{OBJECT_STATES}")
    distributions = MessageQueue(peer, TrajectoryDistribution, f"/{PREDICTIONS}")
    publisher = DepthPublisher(peer)
    peer.spin_until(publisher.is_connected, "subscribers of images")
    stamps: set[int] = set()
    # s since the epoch of the first message of an image, by the image's stamp in ns
    arrivals: dict[str, dict[int, float]] = {STATES: {}, DISTRIBUTION: {}}

    def take() -> None:
        for data, arrival in states.take():
            if deserialize_message(data, ObjectStates).objects:
                arrivals[STATES].setdefault(_rounded(header_stamp(data)), arrival)
        for data, arrival in distributions.take():
            arrivals[DISTRIBUTION].setdefault(_rounded(states_stamp(data)), arrival)

    with BagReader(bag) as reader:
        begin = time.monotonic()
        for since, pair in recorded_images(reader):
            time.sleep(max(0.0, begin + since - time.monotonic()))
            now = time.time_ns() // MICROSECOND * MICROSECOND
            publisher.publish(pair, now)
            if since > first:
                stamps.add(now)
            take()
    time.sleep(LAST)
    take()
    return {
        name: np.array(
            [1e3 * (by_stamp[ns] - 1e-9 * ns) for ns in sorted(stamps & by_stamp.keys())]
        )
        for name, by_stamp in arrivals.items()
    }


def _rounded(stamp: int) -> int:
    return round(stamp / MICROSECOND) * MICROSECOND


def _table(latencies: dict[str, NDArray[np.float64]]) -> Table:
    rows: list[list[Cell]] = [
        [name, len(ms), *(float(np.quantile(ms, part)) for part in (0.5, 0.9, 0.99, 1.0))]
        for name, ms in latencies.items()
    ]
    return Table(
        title="From the stamp of a depth image until others have what is made from it",
        note="Perception, learner and predictor as processes with default parameters; 640 × 480 "
        f"pixels, {RATE:g} images a second, one throw after another.",
        columns=[
            Column("received"),
            Column("images"),
            *(Column(part, "ms", ".1f") for part in ("median", "90 %", "99 %", "longest")),
        ],
        rows=rows,
        remarks=[
            "Images that show an object; the benchmark publishes them from the same two cores.",
        ],
    )
