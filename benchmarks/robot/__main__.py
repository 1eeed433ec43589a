"""`make bench-robot`: the suite started, killed and stopped as on a robot, by the real `ros2`.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from intuitive_physics_msgs.msg import TrajectoryDistribution

from benchmarks.command import Outcome, report_progress, run_benchmark, verdict
from benchmarks.perception.end_to_end import measure_end_to_end
from benchmarks.results.result import Cell, Column, Table
from benchmarks.robot.ros2_process import LAUNCH, Ros2Process
from benchmarks.running_nodes import PERCEPTION, PREDICTOR, SECOND, prediction_rate
from intuitive_physics.errors import InvalidInputError
from intuitive_physics_bringup.connections import NODES
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_ros.scripting import Peer, PeerTimeoutError
from intuitive_physics_ros.topics import (
    ENVIRONMENT,
    OBJECT_STATES,
    OBSERVATIONS,
    PREDICTIONS,
    STATIC_PARAMETERS,
)

# s that must not be exceeded
BARS = {"bringup_s": 8.0, "respawn_to_predicting_s": 5.0, "ctrl_c_s": 3.0}
# ms from an image to the distribution it leads to that must not be exceeded
END_TO_END_BARS = {"p50": 20.0, "p99": 35.0}
SEED = 20  # of the throws and of the camera's noise
# In the bag, one soon after another: nearly always an object is tracked
THROWS, QUICK_THROWS = 24, 12
STARTS, QUICK_STARTS = 3, 1  # how often the suite is started and stopped; the slowest counts
TIMEOUT = 120.0  # s to wait for anything
CONNECT_TIMEOUT = 30.0  # s that plain nodes have to find one another
WATCHED = 10.0  # s for which the predictions of two robots are counted
IN_FLIGHT = 0.3  # s after a kill in which messages of the killed node still arrive


@dataclass
class Predictions:
    """Predictions of one robot."""

    arrivals: list[float] = field(default_factory=list)  # s, on the monotonic clock
    states_stamps: list[int] = field(default_factory=list)  # ns, of the states they are made from

    def take(self, message: TrajectoryDistribution) -> None:
        """Note a prediction."""
        self.arrivals.append(time.monotonic())
        stamp = message.states_stamp
        self.states_stamps.append(SECOND * stamp.sec + stamp.nanosec)


@dataclass(frozen=True)
class Place:
    """The folder of a robot and its recorded camera images."""

    home: Path  # folder for logs and databases
    bag: Path  # of throws

    def launch(self, *arguments: str) -> Ros2Process:
        """Launch the suite, which sees the bag again and again."""
        bag = [f"bag:={self.bag}", "loop:=true", "camera:=generic"]
        return Ros2Process(self.home, *LAUNCH, *bag, *arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    return run_benchmark("robot", __doc__, run, arguments)


def run(options: argparse.Namespace) -> Outcome:
    """Measure all, one after the other."""
    if importlib.util.find_spec("ros2launch") is None:
        raise InvalidInputError(
            "ros2 launch is not installed in this environment; expected ROS 2's command line, "
            "which ros-jazzy-ros2cli and ros-jazzy-ros2launch bring"
        )
    with tempfile.TemporaryDirectory(prefix="bench-robot-") as folder:
        place = Place(Path(folder), Path(folder) / "throws")
        report_progress("rendering throws")
        throws = QUICK_THROWS if options.quick else THROWS
        render_bag(place.bag, RenderSettings(throws=throws, seed=SEED, pause=0.1))
        starts = [_start_and_stop(place) for _ in range(QUICK_STARTS if options.quick else STARTS)]
        respawns = {node: _respawn(place, node) for node in (PERCEPTION, PREDICTOR)}
        rates = _two_robots(place)
        connected = _connects_bare(place)
    end_to_end = measure_end_to_end(quick=True)
    figures = {
        "bringup_s": round(max(bringup for bringup, _ in starts), 2),
        "respawn_to_predicting_s": round(max(respawns.values()), 2),
        "ctrl_c_s": round(max(stop for _, stop in starts), 2),
        "two_robots_hz": [round(rate, 1) for rate in rates],
        "graph_connected_bare": connected,
        **end_to_end.key_figures,
    }
    return judged([_table(starts, respawns), *end_to_end.tables], figures)


def judged(tables: Sequence[Table], figures: Mapping[str, Any]) -> Outcome:
    """Return the outcome, valid where every bar was kept."""
    missed = _missed(figures)
    return Outcome(
        tables=tables,
        key_figures=figures,
        note="`ros2 launch` of the suite with a rendered bag that is replayed in a loop. "
        + verdict(missed),
        complaints=[f"bar missed: {miss}" for miss in missed],
        valid=not missed,
    )


def _start_and_stop(place: Place) -> tuple[float, float]:
    """Return the s from the command to the first prediction, and from Ctrl-C to the end of all."""
    report_progress("start and stop")
    with Peer("bench", TIMEOUT) as peer:
        predictions = _listen(peer, "")
        begin = time.monotonic()
        with place.launch() as launch:
            peer.spin_until(lambda: predictions.arrivals, "the first prediction")
            bringup = predictions.arrivals[0] - begin
            peer.spin_for(1.0)
            stop = launch.interrupt()
    return bringup, stop


def _respawn(place: Place, node: str) -> float:
    """Return the s from kill -9 of a node to the next prediction that it had its part in."""
    report_progress(f"kill -9 of {node}")
    with Peer("bench", TIMEOUT) as peer, place.launch("respawn:=true") as launch:
        predictions = _listen(peer, "")
        peer.spin_until(lambda: predictions.arrivals, "the first prediction")
        peer.spin_for(2.0)
        os.kill(launch.pid_of(node), signal.SIGKILL)
        killed = time.monotonic()
        peer.spin_for(IN_FLIGHT)
        # Newer states: both perception and predictor had their part in the prediction.
        first, newest = len(predictions.arrivals), max(predictions.states_stamps)
        peer.spin_until(lambda: max(predictions.states_stamps) > newest, f"{node} to work again")
        again = next(k for k, stamp in enumerate(predictions.states_stamps) if stamp > newest)
        assert again >= first
        return predictions.arrivals[again] - killed


def _two_robots(place: Place) -> list[float]:
    """Return predictions a second of two robots at a time."""
    report_progress("two robots")
    names = ("left", "right")
    with Peer("bench", TIMEOUT) as peer, ExitStack() as running:
        robots = [_listen(peer, f"/{name}") for name in names]
        for name in names:
            running.enter_context(place.launch(f"namespace:={name}"))
        peer.spin_until(lambda: all(robot.arrivals for robot in robots), "both robots to predict")
        since = time.monotonic()
        peer.spin_for(WATCHED)
        return [prediction_rate([t for t in robot.arrivals if t >= since]) for robot in robots]


def _connects_bare(place: Place) -> bool:
    """Return whether the three nodes find one another after a plain `ros2 run`."""
    report_progress("plain nodes")
    topics = (ENVIRONMENT, OBJECT_STATES, OBSERVATIONS, STATIC_PARAMETERS)
    with Peer("bench", CONNECT_TIMEOUT) as peer, ExitStack() as running:
        for node, package in NODES.items():
            running.enter_context(Ros2Process(place.home, "run", package, node))
        try:
            for topic in topics:
                peer.spin_until(_both_ends(peer, topic), f"both ends of {topic}")
        except PeerTimeoutError:
            return False
    return True


def _both_ends(peer: Peer, topic: str) -> Callable[[], int]:
    return lambda: peer.node.count_publishers(topic) and peer.node.count_subscribers(topic)


def _listen(peer: Peer, namespace: str) -> Predictions:
    predictions = Predictions()
    peer.node.create_subscription(
        TrajectoryDistribution, f"{namespace}/{PREDICTIONS}", predictions.take, 10
    )
    return predictions


def _table(starts: Sequence[tuple[float, float]], respawns: dict[str, float]) -> Table:
    rows: list[list[Cell]] = [["launch to first prediction", bringup] for bringup, _ in starts]
    rows += [["Ctrl-C to the end of all", stop] for _, stop in starts]
    rows += [[f"kill -9 of {node} to predictions", seconds] for node, seconds in respawns.items()]
    return Table("Start, stop, respawn", [Column("what"), Column("time", "s", ".2f")], rows)


def _missed(figures: Mapping[str, Any]) -> list[str]:
    missed = [
        f"{name} is {figures[name]}; expected at most {bar:g}"
        for name, bar in BARS.items()
        if not isinstance(value := figures[name], float) or value > bar
    ]
    missed += [
        f"{part} of end_to_end_ms is {figures['end_to_end_ms'][part]:g}; expected at most {bar:g}"
        for part, bar in END_TO_END_BARS.items()
        if not figures["end_to_end_ms"][part] <= bar
    ]
    if not figures["graph_connected_bare"]:
        missed.append("plain nodes do not find one another")
    return missed


if __name__ == "__main__":
    sys.exit(main())
