"""From a depth image to the predicted distribution: the three nodes as processes, watched."""

from __future__ import annotations

import struct
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from intuitive_physics_msgs.msg import ObjectStates, TrajectoryDistribution
from numpy.typing import NDArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image

from benchmarks.command import report_progress
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics_bringup.connections import NODES, module
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_recordings.bag_reader import BagMessage, BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC
from intuitive_physics_ros.qos import SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer
from intuitive_physics_ros.topics import OBJECT_STATES, PREDICTIONS

SEED = 23  # of the throws and of the camera's noise
THROWS, QUICK_THROWS = 20, 4  # one after another, in a full measurement and in a first look
RATE = 30.0  # images a second
# Throws of which nothing counts: the learner's and the predictor's first work is done in them
FIRST_THROWS = 1
MICROSECOND = 1000  # ns, to which stamps are rounded: as numbers of seconds they are true to 0.2 µs
TIMEOUT = 60.0  # s to wait for the nodes
LAST = 0.5  # s after the last image in which what it leads to arrives
STATES, DISTRIBUTION = f"/{OBJECT_STATES}", f"/{PREDICTIONS}"  # topics that are watched
# Best effort, so that nothing is sent again; deep, so that nothing is lost between two images
QUEUE = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


@dataclass
class Arrivals:
    """When what was made from an image first arrived, s since the epoch, by its stamp in ns."""

    # of the objects; only of images that show one
    states: dict[int, float] = field(default_factory=dict)
    distributions: dict[int, float] = field(default_factory=dict)  # that are predicted from them

    def latencies(self, arrived: dict[int, float]) -> NDArray[np.float64]:
        """Return ms from the stamps of images that show an object, in order of time."""
        return np.array([1e3 * (arrived[ns] - 1e-9 * ns) for ns in sorted(arrived)])


def measure_end_to_end(quick: bool, seed: int = SEED) -> tuple[dict[str, Any], list[Table]]:
    """Return key figures and table of the time from an image's stamp to what it leads to."""
    report_progress("from image to distribution: three nodes as processes")
    settings = RenderSettings(
        throws=FIRST_THROWS + (QUICK_THROWS if quick else THROWS), seed=seed, frame_rate=RATE
    )
    with tempfile.TemporaryDirectory(prefix="bench-end-to-end-") as folder:
        bag = Path(folder) / "bag"
        truth = render_bag(bag, settings)
        arrivals = _watch(bag, Path(folder), truth.throws[FIRST_THROWS].start_time)
    if not arrivals.distributions:
        raise RuntimeError("no image led to a distribution")
    p50, p99 = np.quantile(arrivals.latencies(arrivals.distributions), [0.5, 0.99])
    figures = {"p50": float(f"{p50:.4g}"), "p99": float(f"{p99:.4g}")}
    return {"end_to_end_ms": figures}, [_table(arrivals)]


def _watch(bag: Path, folder: Path, counted: float) -> Arrivals:
    """Play a bag to the three nodes; note what comes of images later than `counted` s in it."""
    with ExitStack() as started:
        for name in NODES:
            renamed: list[tuple[str, str]] = []
            parameters = [f"database:={folder / 'learner.sqlite3'}"] * (name == "learner_node")
            if name == "perception_node":
                parameters = ["input:=depth"]
                renamed = [("~/depth/image", DEPTH_TOPIC)]
                renamed += [("~/depth/camera_info", CAMERA_INFO_TOPIC)]
            arguments = [part for value in parameters for part in ("-p", value)]
            arguments += [part for a, b in renamed for part in ("-r", f"{a}:={b}")]
            started.enter_context(NodeProcess(module(name), arguments))
        peer = started.enter_context(Peer("bench", timeout=TIMEOUT))
        player = _Player(peer)
        player.play(bag, counted)
        return player.arrivals


class _Player:
    """Publishes recorded images as a camera would, and takes what arrives between two of them.

    When a message arrived the middleware writes on it; an executor that waited for each would take
    from the nodes' two cores.
    """

    def __init__(self, peer: Peer) -> None:
        self._subscriptions = {
            kind: peer.node.create_subscription(kind, topic, _leave, QUEUE, raw=True)
            for kind, topic in ((ObjectStates, STATES), (TrajectoryDistribution, DISTRIBUTION))
        }
        self._publishers = {
            CAMERA_INFO_TOPIC: peer.publisher(CameraInfo, CAMERA_INFO_TOPIC, SENSOR_DATA),
            DEPTH_TOPIC: peer.publisher(Image, DEPTH_TOPIC, SENSOR_DATA),
        }
        self._counted: set[int] = set()
        self.arrivals = Arrivals()

    def play(self, bag: Path, counted: float) -> None:
        """Publish each image when it is due, that moment its stamp; only those later than `counted`
        s in the bag count."""
        with BagReader(bag) as reader:
            begun = time.monotonic()
            for since, pair in recorded_images(reader):
                time.sleep(max(0.0, begun + since - time.monotonic()))
                now = time.time_ns() // MICROSECOND * MICROSECOND
                for message in pair:
                    self._publishers[message.topic].publish(with_stamp(message.data, now))
                if since > counted:
                    self._counted.add(now)
                self._take()
        time.sleep(LAST)
        self._take()

    def _take(self) -> None:
        """Note what has arrived."""
        for data, arrival in self._queued(ObjectStates):
            if deserialize_message(data, ObjectStates).objects:
                self._note(self.arrivals.states, _stamp(data, 4), arrival)
        for data, arrival in self._queued(TrajectoryDistribution):
            self._note(self.arrivals.distributions, states_stamp(data), arrival)

    def _queued(self, kind: type) -> Iterator[tuple[bytes, float]]:
        """Yield each message in a queue, and when it arrived, s since the epoch."""
        handle = self._subscriptions[kind].handle
        with handle:
            while taken := handle.take_message(kind, True):
                data, info = taken
                yield data, 1e-9 * info["received_timestamp"]

    def _note(self, arrived: dict[int, float], stamp: int, arrival: float) -> None:
        if stamp in self._counted:
            arrived.setdefault(stamp, arrival)


def _leave(_: bytes) -> None:
    """Take no message: all are taken from the queue."""


def states_stamp(data: bytes) -> int:
    """Return the stamp (ns) of the states that a serialised distribution was predicted from."""
    # After header.stamp come the frame's name, its length first, and states_stamp.
    (length,) = struct.unpack_from("<I", data, 12)
    after = 16 + length
    return _stamp(data, after + -after % 4)


def _stamp(data: bytes, at: int) -> int:
    seconds, nanoseconds = struct.unpack_from("<iI", data, at)
    stamp = int(seconds) * 1_000_000_000 + int(nanoseconds)
    return round(stamp / MICROSECOND) * MICROSECOND


def with_stamp(message: bytes, stamp: int) -> bytes:
    """Return a serialised message that begins with a header, with another stamp."""
    data = bytearray(message)
    # CDR: four bytes that give the byte order, then header.stamp.
    struct.pack_into("<iI", data, 4, *divmod(stamp, 1_000_000_000))
    return bytes(data)


def recorded_images(reader: BagReader) -> Iterator[tuple[float, list[BagMessage]]]:
    """Yield each image with its camera info, and the time of both since the start, s."""
    messages = reader.messages([DEPTH_TOPIC, CAMERA_INFO_TOPIC])
    for first, second in zip(messages, messages, strict=True):
        yield 1e-9 * (first.time - reader.start_time), [first, second]


def _table(arrivals: Arrivals) -> Table:
    received = {"states of objects": arrivals.states, "distribution": arrivals.distributions}
    found = {name: arrivals.latencies(one) for name, one in received.items()}
    rows: list[list[Cell]] = [
        [name, len(one), *(float(np.quantile(one, part)) for part in (0.5, 0.9, 0.99, 1.0))]
        for name, one in found.items()
    ]
    return Table(
        title="From the stamp of a depth image until others have what is made from it",
        note="Perception, learner and predictor as processes with default parameters; 640 × 480 "
        f"pixels, {RATE:g} images a second, one throw after another.",
        columns=[
            Column("received"),
            Column("images"),
            Column("median", "ms", ".1f"),
            Column("90 %", "ms", ".1f"),
            Column("99 %", "ms", ".1f"),
            Column("longest", "ms", ".1f"),
        ],
        rows=rows,
        remarks=[
            "Images that show an object; the benchmark publishes them from the same two cores.",
        ],
    )
