"""The three nodes as processes: start them, feed them, hear them, have them learn."""

from __future__ import annotations

import sys
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import Environment, Observation, ResultCode, TrajectoryDistribution
from numpy.typing import NDArray
from rclpy.action import ActionClient

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_bringup.connections import NODES, module
from intuitive_physics_experiments.rendering.corner_room import BALL_RADII, ROOM_MATERIAL
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC
from intuitive_physics_ros.conversions import static_parameters_from_message
from intuitive_physics_ros.qos import LATCHED, RELIABLE, SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer
from intuitive_physics_ros.topics import ENVIRONMENT, OBSERVATIONS, PREDICTIONS

REPLAY_MODULE = "intuitive_physics_recordings.nodes.replay_node"  # The node that plays bags
SETTLING_TIME = 1.5  # s after the last frame in which the last observation is finished and stored
ACTION = "/learner_node/learn_parameters"  # Name of the learner's action
BAR_WIDTH = 28  # Characters of the bar


class Progress:
    """Headings of stages, and one bar that is drawn over itself where a person watches."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._live = sys.stdout.isatty()
        self._bar_length = 0

    def stage(self, text: str) -> None:
        """Begin a stage."""
        self.end_bar()
        print(f"[{time.monotonic() - self._start:5.1f} s] {text}", flush=True)

    def detail(self, text: str) -> None:
        """Say something within a stage."""
        self.end_bar()
        print(f"          {text}", flush=True)

    def bar(self, done: float, total: float, text: str = "") -> None:
        """Show how far a stage is; not in a log, where each step would be a line."""
        if not self._live:
            return
        part = min(1.0, done / total) if total > 0 else 1.0
        filled = int(part * BAR_WIDTH)
        line = f"          {'█' * filled}{'·' * (BAR_WIDTH - filled)} {100 * part:3.0f} % {text}"
        print("\r" + line.ljust(self._bar_length), end="", flush=True)
        self._bar_length = len(line)

    def end_bar(self) -> None:
        """Leave the bar behind."""
        if self._bar_length:
            print(flush=True)
            self._bar_length = 0


class Suite(AbstractContextManager["Suite"]):
    """Starts perception, learner and predictor, and stops them at the end.

    The learner keeps what it receives in the file `database`, the predictor predicts `horizon` s
    ahead. When they end, each node's output is written into `log_folder`.
    """

    def __init__(self, database: Path, horizon: float, log_folder: Path) -> None:
        balls = list(BALL_RADII.items())
        parameters: dict[str, list[str]] = {
            "perception_node": [
                "input:=depth",
                f"plane_material:={ROOM_MATERIAL}",
                f"known_object_names:=[{', '.join(name for name, _ in balls)}]",
                f"known_object_radii:=[{', '.join(str(radius) for _, radius in balls)}]",
                f"known_object_materials:=[{', '.join(name for name, _ in balls)}]",
            ],
            # The demo asks for one search, which starts from the same place each time.
            "learner_node": [f"database:={database}", "online:=false"],
            # The bag's stamps are of the day it was rendered.
            "predictor_node": [f"horizon:={horizon}", "carry_forward:=false"],
        }
        inputs = [("~/depth/image", DEPTH_TOPIC), ("~/depth/camera_info", CAMERA_INFO_TOPIC)]
        self._log_folder = log_folder
        self.nodes: dict[str, NodeProcess] = {}
        try:
            for name in NODES:
                renamed = inputs if name == "perception_node" else []
                arguments = [part for value in parameters[name] for part in ("-p", value)]
                arguments += [part for a, b in renamed for part in ("-r", f"{a}:={b}")]
                self.nodes[name] = NodeProcess(module(name), arguments)
        except BaseException:
            self.stop()
            raise

    def wait_until_up(self, peer: Peer) -> None:
        """Wait until all three nodes are seen by others."""

        def all_are_seen() -> bool:
            self.check()
            return set(NODES) <= set(peer.node.get_node_names())

        peer.spin_until(all_are_seen, f"the nodes {', '.join(NODES)}")

    def check(self) -> None:
        """Raise `NodeProcessError` if a node has ended."""
        for process in self.nodes.values():
            process.check_running()

    def stop(self) -> None:
        """Stop all nodes and keep what they wrote."""
        for name, process in self.nodes.items():
            process.stop()
            (self._log_folder / f"{name}.log").write_text(process.output, encoding="utf-8")

    def __exit__(self, *_: object) -> None:
        self.stop()


@dataclass
class Heard:
    """Messages of the nodes; distributions with the time each arrived (s, monotonic)."""

    environments: list[Environment]
    observations: list[Observation]
    distributions: list[tuple[float, TrajectoryDistribution]] = field(default_factory=list)

    def clear(self) -> None:
        """Forget what was heard but the environments, which are sent only once."""
        self.observations.clear()
        self.distributions.clear()


def listen(peer: Peer) -> Heard:
    """Begin to hear the nodes."""
    heard = Heard(
        peer.listen(Environment, ENVIRONMENT, LATCHED),
        peer.listen(Observation, OBSERVATIONS, RELIABLE),
    )
    peer.node.create_subscription(
        TrajectoryDistribution,
        PREDICTIONS,
        lambda message: heard.distributions.append((time.monotonic(), message)),
        SENSOR_DATA,
    )
    return heard


def replay(bag: Path, rate: float, suite: Suite, peer: Peer, progress: Progress) -> None:
    """Play a bag from start to end while the nodes watch."""
    with BagReader(bag) as reader:
        duration = reader.duration / rate
    arguments = ["-p", f"bag:={bag}", "-p", f"rate:={rate}", "-p", "clock:=false"]
    arguments += ["-p", f"wait_for_subscribers:=[{DEPTH_TOPIC}]"]
    with NodeProcess(REPLAY_MODULE, arguments) as player:
        start = time.monotonic()
        while player.is_running:
            peer.spin_for(0.1)
            suite.check()
            progress.bar(time.monotonic() - start, duration + 1.0)
            if time.monotonic() - start > duration + 60.0:
                raise IntuitivePhysicsError(f"replaying {bag} does not end:\n{player.output}")
        code = player.wait(10.0)
        if code != 0:
            raise IntuitivePhysicsError(
                f"replaying {bag} failed with code {code}:\n{player.output}"
            )
    peer.spin_for(SETTLING_TIME)
    progress.end_bar()


@dataclass(frozen=True, eq=False)
class Learned:
    """Answer of the learner."""

    parameters: LearnedParameters  # θ_s with its uncertainty
    cost_history: NDArray[np.float64]  # (iterations,) m, best J after each iteration
    seconds: float  # it took


def learner_client(peer: Peer) -> ActionClient:
    """Return a client of the learn action, to be made well before it is used.

    A server drops its answer when it has not discovered the client yet, and a goal cannot be sent
    twice: the learner would learn twice.
    """
    return ActionClient(peer.node, LearnParameters, ACTION)


def learn(
    peer: Peer,
    client: ActionClient,
    method: str,
    iterations: int,
    seed: int,
    progress: Progress,
    timeout: float = 120.0,
) -> Learned:
    """Learn from all observations the learner has stored, with a client from `learner_client`."""
    peer.spin_until(client.server_is_ready, f"the action {ACTION}")
    goal = LearnParameters.Goal()
    goal.options.method = method
    goal.options.max_iterations = iterations
    goal.options.seed = seed

    def show(message: Any) -> None:
        feedback = message.feedback
        text = f"J {1e3 * feedback.best_cost:.1f} mm"
        progress.bar(feedback.iteration, feedback.max_iterations or iterations, text)

    sent = client.send_goal_async(goal, feedback_callback=show)
    peer.spin_until(sent.done, f"the action {ACTION} to take a goal")
    if not sent.result().accepted:
        raise IntuitivePhysicsError("the learner refused to learn; its log says why")
    answer = sent.result().get_result_async()
    peer.spin_until(answer.done, "the learner to finish", timeout)
    progress.end_bar()
    result = answer.result().result
    if result.result.value != ResultCode.OK:
        raise IntuitivePhysicsError(f"learning failed: {result.result.message}")
    return Learned(
        static_parameters_from_message(result.static_parameters),
        np.array(result.cost_history),
        result.computation_time,
    )
