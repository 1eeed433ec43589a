"""A lifecycle manager leads the whole suite: what is known outlives each pause."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from benchmarks.running_nodes import LEARNER, PERCEPTION, PERCEPTION_ARGUMENTS, PREDICTOR
from benchmarks.torture.camera import EndlessCamera
from benchmarks.torture.nodes import Nodes, family, thrown_ball
from diagnostic_msgs.msg import DiagnosticArray
from intuitive_physics_msgs.msg import (
    Environment,
    LearningOptions,
    ObjectStates,
    ResultCode,
    StaticParameters,
    TrajectoryDistribution,
)
from intuitive_physics_msgs.srv import AddObservation, Learn, ListObservations

from intuitive_physics_ros.conversions import observation_to_message
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA
from intuitive_physics_ros.scripting import LifecycleManager

MANAGED = ["-p", "autostart:=false"]


class SuiteManager(LifecycleManager):
    """Leads the nodes as nav2's lifecycle manager does: a transition, and then the state."""

    def lead(self, node: str, label: str, state: str) -> None:
        assert self.change(node, label), f"{node} did not {label}"
        assert self.state(node) == state

    def pause(self, node: str) -> None:
        self.lead(node, "deactivate", "inactive")

    def go_on(self, node: str) -> None:
        self.lead(node, "activate", "active")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lifecycle")


@pytest.fixture(scope="module")
def manager() -> Iterator[SuiteManager]:
    with SuiteManager("manager", timeout=60.0) as peer:
        yield peer


@pytest.fixture(scope="module")
def nodes(folder: Path, manager: SuiteManager) -> Iterator[Nodes]:
    """All three, inactive after the first test."""
    arguments = dict.fromkeys((LEARNER, PREDICTOR), MANAGED)
    with Nodes(
        folder, manager, {**arguments, PERCEPTION: [*PERCEPTION_ARGUMENTS, *MANAGED]}
    ) as all_:
        for node in (LEARNER, PERCEPTION, PREDICTOR):
            assert manager.state(node) == "unconfigured"
            manager.lead(node, "configure", "inactive")
        yield all_
    for name, (took, code) in all_.stop().items():
        assert code == 0, name
        assert took < 5.0, name


def stored(manager: SuiteManager) -> list[str]:
    answer = manager.call(
        ListObservations, "/learner_node/list_observations", ListObservations.Request()
    )
    return [one.id for one in answer.observations]


def test_the_learner_keeps_observations_and_versions(nodes: Nodes, manager: SuiteManager) -> None:
    manager.go_on(LEARNER)
    ball = thrown_ball(7)
    seen = AddObservation.Request(observation=observation_to_message(ball))
    assert manager.call(AddObservation, "/learner_node/add_observation", seen).added
    heard = manager.listen(StaticParameters, "intuitive_physics/static_parameters", LATCHED)
    manager.spin_until(lambda: heard, "static parameters")
    manager.pause(LEARNER)
    manager.spin_until(
        lambda: not manager.node.count_publishers("intuitive_physics/static_parameters"),
        "the end of publishing",
    )
    heard.clear()
    manager.go_on(LEARNER)
    manager.spin_until(lambda: heard, "static parameters")
    assert stored(manager) == [ball.id]
    # The file is closed, and opened again.
    manager.pause(LEARNER)
    manager.lead(LEARNER, "cleanup", "unconfigured")
    moved = nodes.database.with_name("moved.sqlite3")
    nodes.database.rename(moved)
    moved.rename(nodes.database)
    manager.lead(LEARNER, "configure", "inactive")
    manager.go_on(LEARNER)
    assert stored(manager) == [ball.id]


def test_a_search_that_a_pause_ends_leaves_no_process(nodes: Nodes, manager: SuiteManager) -> None:
    learner = nodes.processes[LEARNER]
    diagnostics = manager.listen(DiagnosticArray, "/diagnostics")
    endless = Learn.Request(options=LearningOptions(method="random", max_iterations=10**7))
    answer = manager.send(Learn, "/learner_node/learn", endless)
    manager.spin_until(
        lambda: any(
            status.message.startswith("searching")
            for message in diagnostics
            for status in message.status
        ),
        "a search",
    )
    manager.pause(LEARNER)
    manager.spin_until(answer.done, "its end")
    assert answer.result().result.value == ResultCode.CANCELLED
    manager.spin_until(lambda: [*family(learner.pid)] == [learner.pid], "the end of its processes")
    manager.go_on(LEARNER)
    manager.spin_until(lambda: len(family(learner.pid)) == 2, "a process that waits for searches")


def test_perception_and_predictor_go_on_with_what_they_know(
    nodes: Nodes, manager: SuiteManager, folder: Path
) -> None:
    environments = manager.listen(Environment, "intuitive_physics/environment", LATCHED)
    states = manager.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
    predictions = manager.listen(
        TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA
    )

    def none_come(heard: list, seconds: float = 1.0) -> bool:
        manager.spin_for(0.3)
        heard.clear()
        manager.spin_for(seconds)
        return not heard

    with EndlessCamera(folder, seed=4):
        assert none_come(states)
        manager.go_on(PERCEPTION)
        manager.spin_until(lambda: environments and states, "an environment and states")
        assert none_come(predictions)
        manager.go_on(PREDICTOR)
        manager.spin_until(lambda: predictions, "predictions")
        manager.pause(PREDICTOR)
        assert none_come(predictions)
        manager.go_on(PREDICTOR)
        manager.spin_until(lambda: predictions, "predictions again")

        manager.pause(PERCEPTION)
        assert none_come(states)
        # Who comes late hears of the room while perception is inactive.
        late = manager.listen(Environment, "intuitive_physics/environment", LATCHED)
        manager.spin_until(lambda: late, "the environment")
        assert late[-1] == environments[-1]
        manager.go_on(PERCEPTION)
        manager.spin_until(lambda: states, "states again")
        # The room is not modelled anew, which would count from 1 again; it may be revised.
        versions = [message.version for message in environments]
        assert versions == sorted(set(versions))

        manager.pause(PERCEPTION)
        manager.lead(PERCEPTION, "cleanup", "unconfigured")
        manager.spin_until(
            lambda: not manager.node.count_publishers("intuitive_physics/environment"),
            "the end of the environment",
        )
        manager.lead(PERCEPTION, "configure", "inactive")
        environments.clear()
        manager.go_on(PERCEPTION)
        manager.spin_until(lambda: environments, "a new model of the room")
        assert environments[0].version == 1
        manager.spin_until(lambda: predictions, "predictions in it")


def test_node_that_is_shut_down_stays_finalized(nodes: Nodes, manager: SuiteManager) -> None:
    manager.lead(PREDICTOR, "shutdown", "finalized")
    assert "Traceback" not in "".join(one.output for one in nodes.processes.values())
