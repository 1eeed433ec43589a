"""Searches that are cancelled at random instants, whatever they simulate."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import LearningOptions, ResultCode
from intuitive_physics_msgs.srv import AddObservation
from rclpy.action import ActionClient

from benchmarks.torture.early_end import noted
from benchmarks.torture.nodes import LEARNER, PATIENCE, blamed_on_death, thrown_ball
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_bringup.connections import module
from intuitive_physics_learner.methods import METHODS
from intuitive_physics_ros.conversions import observation_to_message
from intuitive_physics_ros.scripting import NodeProcess, Peer

LATEST = 3.0  # s of a search after which it is cancelled at the latest
LONG = 590.0  # s that tumbling boxes were seen: a simulation of them takes seconds
TIMES_LONG = 4  # every so many cancelled searches learn from what takes long to simulate


@dataclass
class Cancels:
    """What cancels did."""

    # s of each, from the request to cancel a search to its result
    took: list[float] = field(default_factory=list)
    # searches that ended otherwise, and what ended it all early
    failures: list[str] = field(default_factory=list)


def measure_cancels(folder: Path, count: int, rng: np.random.Generator) -> Cancels:
    """Cancel `count` searches, some of which may have ended before."""
    found = Cancels()
    parameters = [f"database:={folder / 'cancelled.sqlite3'}", "online:=false"]
    given = [word for one in parameters for word in ("-p", one)]
    short, long = [thrown_ball(number) for number in range(5)], _long_observation()
    with (
        noted(found.failures),
        NodeProcess(module(LEARNER), given) as learner,
        Peer("torturer", PATIENCE) as peer,
        blamed_on_death(LEARNER, learner),
    ):
        for one in (*short, long):
            request = AddObservation.Request(observation=observation_to_message(one))
            peer.call(AddObservation, f"/{LEARNER}/add_observation", request)
        client = ActionClient(peer.node, LearnParameters, f"/{LEARNER}/learn_parameters")
        peer.spin_until(client.server_is_ready, "the action")
        for number in range(count):
            chosen = [long] if number % TIMES_LONG == 0 else short
            options = LearningOptions(
                method=str(rng.choice(sorted(METHODS))),
                max_iterations=1_000_000,
                observation_ids=[one.id for one in chosen],
            )
            _cancel_one(peer, client, options, rng.uniform(0.0, LATEST), found)
    return found


def _cancel_one(
    peer: Peer, client: ActionClient, options: LearningOptions, after: float, found: Cancels
) -> None:
    """Start a search and cancel it, unless it has ended before."""
    sent = client.send_goal_async(LearnParameters.Goal(options=options))
    peer.spin_until(sent.done, "the goal's answer")
    handle = sent.result()
    result = handle.get_result_async()
    peer.spin_for(after)
    if result.done():
        return
    begun = time.monotonic()
    handle.cancel_goal_async()
    peer.spin_until(result.done, "the end of a cancelled search")
    found.took.append(time.monotonic() - begun)
    end = result.result().result.result
    if end.value not in (ResultCode.CANCELLED, ResultCode.OK):
        found.failures.append(
            f"a cancelled search by {options.method} ended with {end.value} ({end.message})"
        )


def _long_observation() -> Observation:
    """Return one of boxes that tumble in a heap for minutes."""
    times = np.linspace(0.0, LONG, 30)
    boxes = tuple(
        ObservedObject(
            SceneObject(f"box {k}", "wood", Box((0.2, 0.1, 0.1))),
            Trajectory(times, np.tile([0.0, 0.0, 0.5 + k], (times.size, 1))),
            ObjectState((0.0, 0.0, 0.5 + k), angular_velocity=(1.0, 2.0, 3.0)),
        )
        for k in range(5)
    )
    return Observation(Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]), boxes, 0.0, "boxes")
