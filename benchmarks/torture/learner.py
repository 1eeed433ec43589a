"""A learner as a process, its clients, and the observations that it has acknowledged."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import LearningOptions, ResultCode
from intuitive_physics_msgs.srv import AddObservation
from rclpy.action import ActionClient

from benchmarks.running_nodes import LEARNER, parameter_arguments
from benchmarks.torture.nodes import PATIENCE, blamed_on_death, thrown_ball
from intuitive_physics.observation import Observation
from intuitive_physics_bringup.connections import module
from intuitive_physics_learner import ObservationStore
from intuitive_physics_ros.conversions import observation_to_message
from intuitive_physics_ros.scripting import NodeProcess, Peer


@dataclass
class Acknowledged:
    """What a learner has acknowledged, over all of its lives."""

    ids: set[str] = field(default_factory=set)  # of observations
    version: int = 0  # newest of the static parameters

    def __len__(self) -> int:
        return len(self.ids) + self.version


class Learner:
    """A running learner and the peer that calls it."""

    def __init__(self, process: NodeProcess, peer: Peer, acknowledged: Acknowledged) -> None:
        self.process = process
        self.peer = peer
        self.acknowledged = acknowledged

    def add(self, observation: Observation, timeout: float = PATIENCE) -> Any:
        """Add an observation, and return the result of the call."""
        request = adding_request(observation)
        answer = self.peer.call(AddObservation, f"/{LEARNER}/add_observation", request, timeout)
        if answer.result.value == ResultCode.OK:
            self.acknowledged.ids.add(observation.id)
        return answer.result

    def add_ball(self, number: int) -> Any:
        """Add the observation of a thrown ball, and return the result of the call."""
        return self.add(thrown_ball(number))

    @cached_property
    def _searches(self) -> ActionClient:
        return ActionClient(self.peer.node, LearnParameters, f"/{LEARNER}/learn_parameters")

    def search(self, options: LearningOptions) -> tuple[Any, Any]:
        """Begin a search, and return the handle of its goal and the future of its result."""
        self.peer.spin_until(self._searches.server_is_ready, "the action", PATIENCE)
        goal = self._searches.send_goal_async(LearnParameters.Goal(options=options))
        self.peer.spin_until(goal.done, "the goal's answer", PATIENCE)
        handle = goal.result()
        return handle, handle.get_result_async()

    def end_of(self, search: Any, timeout: float) -> Any:
        """Wait for the result of a search, by its future."""
        self.peer.spin_until(search.done, "the end of a search", timeout)
        return search.result().result.result


@contextmanager
def running_learner(
    database: Path, acknowledged: Acknowledged | None = None, **parameters: object
) -> Iterator[Learner]:
    """Run a learner; its death is reported in place of an answer that does not come."""
    arguments = parameter_arguments(database=database, **parameters)
    with (
        NodeProcess(module(LEARNER), arguments) as process,
        Peer("torturer", PATIENCE) as peer,
        blamed_on_death(LEARNER, process),
    ):
        yield Learner(process, peer, Acknowledged() if acknowledged is None else acknowledged)


def adding_request(observation: Observation) -> AddObservation.Request:
    """Return a request to add an observation."""
    return AddObservation.Request(observation=observation_to_message(observation))


def lost_observations(database: Path, acknowledged: Acknowledged) -> set[str]:
    """Return the ids of acknowledged observations that are not in a database."""
    with ObservationStore(database) as store:
        return acknowledged.ids - {entry.id for entry in store.entries()}
