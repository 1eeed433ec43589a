"""Searches that are cancelled at random instants, whatever they simulate."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import LearningOptions, ResultCode
from intuitive_physics_msgs.srv import AddObservation
from rclpy.action import ActionClient

from benchmarks.torture.nodes import LEARNER, PATIENCE, thrown_ball
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_bringup.connections import module
from intuitive_physics_learner.methods import METHODS
from intuitive_physics_ros.conversions import observation_to_message
from intuitive_physics_ros.scripting import NodeProcess, Peer

LATEST = 3.0
"""s of a search after which it is cancelled at the latest."""

LONG = 590.0
"""s that tumbling boxes were seen: a simulation of them takes seconds."""

TIMES_LONG = 4
"""Every so many cancelled searches learn from what takes long to simulate."""


def measure_cancels(folder: Path, count: int, rng: np.random.Generator) -> list[float]:
    """Return for each of `count` searches the s from the request to cancel it to its result.

    Parameters
    ----------
    folder : for the database
    rng : chooses methods and instants

    Raises
    ------
    RuntimeError
        When a search was not cancelled.
    """
    parameters = [f"database:={folder / 'cancelled.sqlite3'}", "online:=false"]
    given = [word for one in parameters for word in ("-p", one)]
    short, long = [thrown_ball(number) for number in range(5)], _long_observation()
    with NodeProcess(module(LEARNER), given), Peer("torturer", PATIENCE) as peer:
        for one in (*short, long):
            request = AddObservation.Request(observation=observation_to_message(one))
            peer.call(AddObservation, f"/{LEARNER}/add_observation", request)
        client = ActionClient(peer.node, LearnParameters, f"/{LEARNER}/learn_parameters")
        peer.spin_until(client.server_is_ready, "the action")
        took = []
        for number in range(count):
            chosen = [long] if number % TIMES_LONG == 0 else short
            options = LearningOptions(
                method=str(rng.choice(sorted(METHODS))),
                max_iterations=1_000_000,
                observation_ids=[one.id for one in chosen],
            )
            took.append(_cancel_one(peer, client, options, rng.uniform(0.0, LATEST)))
        return [seconds for seconds in took if seconds is not None]


def _cancel_one(
    peer: Peer, client: ActionClient, options: LearningOptions, after: float
) -> float | None:
    """Return the s from a cancel to the result; None where the search had ended before."""
    sent = client.send_goal_async(LearnParameters.Goal(options=options))
    peer.spin_until(sent.done, "the goal's answer")
    handle = sent.result()
    result = handle.get_result_async()
    peer.spin_for(after)
    if result.done():
        return None
    begun = time.monotonic()
    handle.cancel_goal_async()
    peer.spin_until(result.done, "the end of a cancelled search")
    took = time.monotonic() - begun
    found = result.result().result.result
    if found.value not in (ResultCode.CANCELLED, ResultCode.OK):
        raise RuntimeError(f"{options.method}: a cancelled search ended with {found}")
    return took


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
