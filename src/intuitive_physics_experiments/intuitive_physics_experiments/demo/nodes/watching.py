"""Replay a bag to the nodes and hear what they make of it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

from intuitive_physics_msgs.msg import (
    Environment,
    Observation,
    TrajectoryDistribution,
)

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_experiments.demo.nodes.suite import Suite
from intuitive_physics_experiments.demo.progress import Progress
from intuitive_physics_experiments.rendering.depth_bag_writer import DEPTH_TOPIC
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_ros.node_process import NodeProcess
from intuitive_physics_ros.peer import Peer
from intuitive_physics_ros.qos import LATCHED, RELIABLE, SENSOR_DATA

REPLAY_MODULE = "intuitive_physics_recordings.nodes.replay_node"
SETTLING_TIME = 1.5
"""Seconds after the last frame in which the last observation is finished and stored."""


@dataclass
class Heard:
    """Messages of the nodes; distributions with the time each arrived (s, monotonic)."""

    environments: list[Environment] = field(default_factory=list)
    observations: list[Observation] = field(default_factory=list)
    distributions: list[tuple[float, TrajectoryDistribution]] = field(default_factory=list)

    def clear(self) -> None:
        """Forget what was heard but the environments, which are sent only once."""
        self.observations.clear()
        self.distributions.clear()


def listen(peer: Peer) -> Heard:
    """Begin to hear the nodes."""
    heard = Heard()
    subscribe = peer.node.create_subscription
    subscribe(Environment, "/perception_node/environment", heard.environments.append, LATCHED)
    subscribe(Observation, "/perception_node/observation", heard.observations.append, RELIABLE)
    subscribe(
        TrajectoryDistribution,
        "/predictor_node/trajectory_distribution",
        lambda message: heard.distributions.append((time.monotonic(), message)),
        SENSOR_DATA,
    )
    return heard


def replay(bag: Path, rate: float, suite: Suite, peer: Peer, progress: Progress) -> None:
    """Play a bag from start to end while the nodes watch.

    Raises
    ------
    IntuitivePhysicsError
        When a node ends, or the bag cannot be played.
    """
    with BagReader(bag) as reader:
        duration = reader.duration / rate
    arguments = ["-p", f"bag:={bag}", "-p", f"rate:={rate}", "-p", "clock:=false"]
    arguments += ["-p", f"wait_for_subscribers:=[{DEPTH_TOPIC}]"]
    with NodeProcess(REPLAY_MODULE, arguments) as player:
        start = time.monotonic()
        while player.process.poll() is None:
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
