"""The learner node as others see it: a process of its own, spoken to over DDS."""

import math
import os
import resource
import signal
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import (
    LearningOptions,
    Observation,
    ParameterBounds,
    ResultCode,
    StaticParameters,
)
from intuitive_physics_msgs.srv import (
    AddObservation,
    DeleteObservations,
    ExportObservations,
    GetStaticParameters,
    Learn,
    ListObservations,
    SetObservationStatus,
    SetStaticParameters,
)
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import parameter_names
from intuitive_physics.scene import Environment, Plane
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner import ConvergenceCriteria, ObservationStore, learn_from_store
from intuitive_physics_learner import LearningOptions as SearchOptions
from intuitive_physics_learner.nodes.observation_services import folder_below
from intuitive_physics_ros.conversions import (
    observation_to_message,
    static_parameters_from_message,
    static_parameters_to_message,
)
from intuitive_physics_ros.scripting import NodeProcess, Peer

PATIENCE = 20.0
"""Seconds to wait for what takes well under one, on a machine that is busy with other things."""

LATCHED = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)

SOON = "from intuitive_physics_learner.cost import cluster; cluster.CONNECT_TIMEOUT = 0.5"
"""Done before a node's start: it does not wait long for a cluster."""

ENDLESS = LearningOptions(method="random", max_iterations=10**7)

SERVICES = {
    AddObservation: ("add_observation", {}),
    GetStaticParameters: ("get_static_parameters", {}),
    SetStaticParameters: (
        "set_static_parameters",
        {"static_parameters": StaticParameters(materials=["without values"])},
    ),
    Learn: ("learn", {"options": LearningOptions(method="none")}),
    ListObservations: ("list_observations", {}),
    SetObservationStatus: ("set_observation_status", {}),
    DeleteObservations: ("delete_observations", {}),
    ExportObservations: ("export_observations", {"ids": ["none"]}),
}
"""Name of each service, and a request that changes nothing: it can be sent more than once."""


def start_learner(database, *parameters, **options):
    """Start the learner node on a database of the test's.

    It learns by CMA-ES, whose iterations are easily counted, and in the background only where a
    test says so.
    """
    arguments = [f"database:={database}", "method:=cma_es", "online:=false", *parameters]
    ros_arguments = [word for argument in arguments for word in ("-p", argument)]
    return NodeProcess("intuitive_physics_learner.nodes.learner_node", ros_arguments, **options)


class Caller:
    """A node of the test's own, and what it hears and calls.

    A server discovers a client's reader of replies on its own, possibly after the client sees the
    service as ready, and drops what it has to say until then. So each service is greeted before its
    first use, again and again until it answers; what a test asks is sent once and must be answered.
    """

    def __init__(self):
        self.peer = Peer("caller", timeout=PATIENCE)
        topic = "intuitive_physics/static_parameters"
        self.published = self.peer.listen(StaticParameters, topic, LATCHED)
        self.diagnostics = self.peer.listen(DiagnosticArray, "/diagnostics")
        self.observations = self.peer.node.create_publisher(
            Observation, "intuitive_physics/observations", LATCHED
        )
        self.action = ActionClient(
            self.peer.node, LearnParameters, "/learner_node/learn_parameters"
        )
        self.greeted = set()

    def close(self):
        self.peer.close()

    def spin_until(self, holds, patience=None):
        self.peer.spin_until(holds, "what the test waits for", patience)

    def greet(self, kind):
        """Make sure that a service's answers arrive."""
        if kind not in self.greeted:
            name, fields = SERVICES[kind]
            self.peer.call(kind, f"/learner_node/{name}", kind.Request(**fields))
            self.greeted.add(kind)

    def set_parameter(self, name, value):
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        answer = self.peer.call(SetParameters, "/learner_node/set_parameters", request)
        assert answer.results[0].successful, answer.results[0].reason

    def greet_action(self):
        """Make sure that the answers to goals and to questions for their results arrive."""
        if LearnParameters not in self.greeted:
            goal = LearnParameters.Goal(options=LearningOptions(method="none"))
            self.spin_until(self.action.server_is_ready)
            refused = self.peer.ask(lambda: self.action.send_goal_async(goal), "the refusal")
            self.peer.ask(refused.get_result_async, "the result of a refused goal")
            self.greeted.add(LearnParameters)

    def start_call(self, kind, **fields):
        self.greet(kind)
        return self.peer.send(kind, f"/learner_node/{SERVICES[kind][0]}", kind.Request(**fields))

    def call(self, kind, **fields):
        return self.result_of(self.start_call(kind, **fields))

    def add(self, observation):
        return self.call(AddObservation, observation=observation_to_message(observation))

    def add_all(self, observations):
        for observation in observations:
            self.add(observation)

    def start_goal(self, options, feedback=None):
        """Send a goal and return its handle and the future of its result."""
        self.greet_action()
        sent = self.action.send_goal_async(
            LearnParameters.Goal(options=options),
            None if feedback is None else lambda m: feedback.append(m.feedback),
        )
        self.spin_until(sent.done)
        assert sent.result().accepted
        return sent.result(), sent.result().get_result_async()

    def result_of(self, future):
        self.spin_until(future.done)
        return future.result()


def state_and_parent(pid):
    """State letter and parent of a process; of one that has gone, what a zombie has."""
    try:
        state, parent = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[:2]
    except OSError:
        return "Z", 0
    return state, int(parent)


def children_of(node):
    """Process ids of what a node has started and what still runs."""
    pids = [int(path.name) for path in Path("/proc").glob("[0-9]*")]
    parent = node.pid
    return [pid for pid in pids if alive(pid) and state_and_parent(pid)[1] == parent]


def alive(pid):
    return state_and_parent(pid)[0] != "Z"


@pytest.fixture
def start(tmp_path):
    """Start learner nodes on one database; none outlives its test."""
    started = []

    def start_one(*parameters, database=tmp_path / "learner.sqlite3", **options):
        started.append(start_learner(database, *parameters, **options))
        return started[-1]

    start_one.nodes = started
    yield start_one
    for node in started:
        node.stop(signal.SIGKILL)
    assert not [node.output for node in started if "Traceback" in node.output]


@pytest.fixture
def caller():
    made = Caller()
    yield made
    made.close()


def status_of(caller, name):
    """The newest level and message of a check, and its values."""
    for message in reversed(caller.diagnostics):
        for status in message.status:
            if status.name == f"learner_node: {name}":
                values = {pair.key: pair.value for pair in status.values}
                return status.level, status.message, values
    return None


def test_learns_the_true_parameters(start, caller, throws, true_parameters):
    start("max_iterations:=1500", "seed:=3")
    answer = caller.call(GetStaticParameters)
    assert answer.result.value == ResultCode.NOT_READY
    assert "add an observation" in answer.result.message
    answer = caller.call(Learn)
    assert answer.result.value == ResultCode.NO_OBSERVATIONS
    assert caller.published == []

    observed = throws(8, 3)
    for count, observation in enumerate(observed[:7], 1):
        answer = caller.add(observation)
        assert (answer.result.value, answer.added) == (ResultCode.OK, True)
        assert answer.observation_count == count
    again = caller.add(observed[0])
    assert (again.result.value, again.added, again.observation_count) == (0, False, 7)
    # The eighth comes by topic.
    caller.observations.publish(observation_to_message(observed[7]))
    caller.spin_until(lambda: caller.add(observed[0]).observation_count == 8)
    caller.spin_until(lambda: caller.published)
    assert caller.published[-1].version == 0
    assert list(caller.published[-1].materials) == ["ball", "floor"]

    answer = caller.call(Learn)
    assert answer.result.value == ResultCode.OK, answer.result.message
    assert answer.iterations == 1500
    assert answer.computation_time > 0.0
    learned = static_parameters_from_message(answer.static_parameters)
    assert (learned.version, learned.observation_count, learned.method) == (1, 8, "cma_es")
    got = learned.parameters.pair("ball", "floor")["restitution"]
    assert got == pytest.approx(true_parameters.pair("ball", "floor")["restitution"], abs=0.02)
    assert learned.identified[parameter_names(learned.materials).index("restitution[ball, floor]")]
    assert not learned.identified[0]
    caller.spin_until(lambda: caller.published[-1].version == 1)
    assert caller.call(GetStaticParameters).static_parameters.version == 1
    # One who comes late hears it too.
    late = Caller()
    late.spin_until(lambda: late.published)
    assert late.published[0].version == 1
    late.close()


def test_result_codes_of_wrong_requests(start, caller, glides, boxed):
    start("max_iterations:=10", "simulator:=event_driven")
    observation = glides(np.random.default_rng(0), 0.5)
    assert caller.add(observation).result.value == ResultCode.OK

    def code(**options):
        return caller.call(Learn, options=LearningOptions(**options)).result

    unknown = code(method="magic")
    assert unknown.value == ResultCode.UNKNOWN_METHOD
    assert "cma_es" in unknown.message
    inverted = ParameterBounds(kind="restitution", lower=0.9, upper=0.1)
    assert code(bounds=[inverted]).value == ResultCode.INVALID_BOUNDS
    assert "expected lower ≤ upper" in code(bounds=[inverted]).message
    crossed = ParameterBounds(kind="dynamic_friction", lower=0.5, upper=0.9)
    assert code(bounds=[crossed]).value == ResultCode.INVALID_BOUNDS
    nameless = ParameterBounds(kind="colour", lower=0.1, upper=0.9)
    assert code(bounds=[nameless]).value == ResultCode.INVALID_BOUNDS
    assert code(observation_ids=["nobody"]).value == ResultCode.UNKNOWN_NAME
    assert code(time_limit=math.nan).value == ResultCode.INVALID_INPUT
    assert code(cost_threshold=-1.0).value == ResultCode.INVALID_INPUT
    assert code().value == ResultCode.OK
    caller.set_parameter("distance", "max")
    assert code(method="cma_es").value == ResultCode.OK
    refused = code(method="levenberg_marquardt")
    assert refused.value == ResultCode.INVALID_INPUT
    assert "minimises no distance" in refused.message
    caller.set_parameter("distance", "mean")

    broken = observation_to_message(replace(observation, id="broken"))
    broken.objects[0].positions = broken.objects[0].positions[:-1]
    answer = caller.call(AddObservation, observation=broken)
    assert answer.result.value == ResultCode.INVALID_INPUT
    assert "positions" in answer.result.message
    answer = caller.call(SetStaticParameters, static_parameters=StaticParameters(materials=["a"]))
    assert answer.result.value == ResultCode.INVALID_INPUT
    assert caller.add(boxed).added
    assert code(observation_ids=["boxed"]).value == ResultCode.UNSUPPORTED_SCENE
    _, result = caller.start_goal(LearningOptions(method="magic"))
    assert caller.result_of(result).status == GoalStatus.STATUS_ABORTED
    assert caller.result_of(result).result.result.value == ResultCode.UNKNOWN_METHOD


def test_exports_stay_below_the_export_folder(tmp_path):
    top = tmp_path / "top"
    top.mkdir()
    (top / "link").symlink_to(tmp_path)
    assert folder_below("", top) == top.resolve()
    assert folder_below("a", top) == top.resolve() / "a"
    for inside in (top, top / "a" / "b", top / "a" / ".." / "b"):
        assert folder_below(str(inside), top).is_relative_to(top.resolve())
    for outside in (tmp_path, top / "..", top / "link", tmp_path / "topmost", Path("/")):
        assert folder_below(str(outside), Path("/")) == outside.resolve()
        with pytest.raises(InvalidInputError, match=r"expected one below .*export_folder"):
            folder_below(str(outside), top)
    (top / "loop").symlink_to(top / "loop")
    for nowhere in ("~nobody_of_that_name/x", "loop", "a\0b"):
        with pytest.raises(InvalidInputError, match="which leads nowhere"):
            folder_below(nowhere, top)


def test_users_look_after_the_observations(start, caller, glides, tmp_path):
    start()
    for name, material in (("a", "ball"), ("b", "ball"), ("c", "cork")):
        observation = glides(
            np.random.default_rng(0), 0.5, materials=(material,), start=7.0, id=name
        )
        assert caller.add(observation).added
    listed = caller.call(ListObservations, limit=2)
    assert (listed.result.value, listed.observation_count) == (ResultCode.OK, 3)
    assert [entry.id for entry in listed.observations] == ["a", "b"]
    (rest,) = caller.call(ListObservations, after=listed.observations[-1].number).observations
    assert (rest.id, rest.start_time, rest.status, rest.weight) == ("c", 7.0, "used", 1.0)
    assert (list(rest.materials), rest.object_count) == (["cork", "floor"], 1)

    def set_status(ids, status):
        answer = caller.call(SetObservationStatus, ids=ids, status=status, reason="kicked")
        return answer.result.value, answer.changed

    assert set_status(["a", "c"], "excluded") == (ResultCode.OK, 2)
    assert set_status(["a"], "used") == (ResultCode.OK, 1)
    assert set_status(["a"], "doubtful") == (ResultCode.INVALID_INPUT, 0)
    assert set_status(["x"], "used") == (ResultCode.UNKNOWN_NAME, 0)
    (excluded,) = caller.call(ListObservations, statuses=["excluded"]).observations
    assert (excluded.id, excluded.reason) == ("c", "kicked")
    wrong = caller.call(ListObservations, statuses=["good"])
    assert wrong.result.value == ResultCode.UNKNOWN_NAME

    elsewhere = caller.call(ExportObservations, folder=str(tmp_path / "elsewhere"))
    assert elsewhere.result.value == ResultCode.INVALID_INPUT
    assert not (tmp_path / "elsewhere").exists()
    assert caller.call(ExportObservations, folder="mine").exported == 2
    assert len(list(tmp_path.rglob("exports/mine/*.json"))) == 2
    caller.spin_until(lambda: caller.published and "cork" in caller.published[-1].materials)
    assert caller.call(DeleteObservations, ids=["c"]).deleted == 1
    caller.spin_until(lambda: "cork" not in caller.published[-1].materials)
    assert caller.call(DeleteObservations, ids=["c"]).result.value == ResultCode.UNKNOWN_NAME


def test_no_observation_is_lost_while_another_process_writes(start, caller, glides, tmp_path):
    start(first="import intuitive_physics_learner.nodes.observation_services as o;o.ADD_PATIENCE=1")
    caller.greet(AddObservation)
    observations = [glides(np.random.default_rng(0), 0.5, id=str(n)) for n in range(4)]
    other = sqlite3.connect(tmp_path / "learner.sqlite3", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    for observation in observations[:3]:
        caller.observations.publish(observation_to_message(observation))
    answer = caller.add(observations[3])
    assert answer.result.value == ResultCode.STORAGE_FAILED
    assert "another process" in answer.result.message
    caller.spin_until(lambda: queue_status(caller) == (DiagnosticStatus.WARN, "3"))
    other.execute("ROLLBACK")
    other.close()
    caller.spin_until(lambda: queue_status(caller) == (DiagnosticStatus.OK, "0"))
    stored = caller.call(ListObservations).observations
    assert [entry.id for entry in stored] == ["0", "1", "2"]


def queue_status(caller):
    """Level of the newest report on the queue, and how many observations wait in it."""
    status = status_of(caller, "observation queue")
    return status and (status[0], status[2]["waiting"])


def test_environment_that_the_engine_cannot_simulate(start, caller, glides):
    start("simulator:=bullet")
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    table = Environment([Plane("table", "floor", [0, 0, 1], 0.0, boundary=corners)])
    observation = glides(np.random.default_rng(0), 0.5)
    assert caller.add(replace(observation, environment=table)).added
    result = caller.call(Learn).result
    assert result.value == ResultCode.INCOMPATIBLE_ENVIRONMENT
    assert "plane table has a boundary" in result.message


def test_packages_that_are_not_installed(start, caller, glides):
    start(first="import sys; sys.modules['cma'] = None")
    caller.add(glides(np.random.default_rng(0), 0.5))
    result = caller.call(Learn, options=LearningOptions(method="cma_es")).result
    assert result.value == ResultCode.MISSING_DEPENDENCY
    assert "pip install cma" in result.message


def test_a_cluster_without_its_package_stops_it_with_one_line(start):
    node = start("cluster:=local:2", first="import sys; sys.modules['distributed'] = None")
    assert node.wait() == 1
    (reported,) = [line for line in node.output.splitlines() if "error" in line]
    assert "pip install distributed" in reported


def test_a_cluster_that_is_not_there(start, caller, glides):
    start("cluster:=127.0.0.1:9", first=SOON)
    caller.add(glides(np.random.default_rng(0), 0.5))
    result = caller.call(Learn).result
    assert result.value == ResultCode.CLUSTER_FAILED
    assert "does not answer" in result.message


def test_a_mistake_of_ours_is_an_internal_error(start, caller, glides):
    broken = (
        "from intuitive_physics_learner import learning_session;"
        "learning_session.identifiability_of_optimum = 0"
    )
    start("max_iterations:=5", first=broken)
    caller.add(glides(np.random.default_rng(0), 0.5))
    result = caller.call(Learn).result
    assert result.value == ResultCode.INTERNAL_ERROR
    assert "TypeError" in result.message


def test_two_processes_learn_the_same_as_one(start, caller, throws, tmp_path):
    node = start("simulator:=event_driven", "cluster:=local:2", own_group=True)
    caller.add_all(throws(5, 0))
    options = LearningOptions(max_iterations=300, seed=1)
    future = caller.start_call(Learn, options=options)
    # Two processes start first.
    caller.spin_until(future.done, 60.0)
    spread = future.result()
    assert spread.result.value == ResultCode.OK, spread.result.message
    learned = static_parameters_from_message(spread.static_parameters)
    # As Ctrl-C does, which reaches the processes of the cluster too.
    assert node.stop() == 0
    with ObservationStore(tmp_path / "alone.sqlite3") as store:
        store.add_all(throws(5, 0))
        asked = SearchOptions(method="cma_es", criteria=ConvergenceCriteria(300), seed=1)
        alone = learn_from_store(store, make_simulator("event_driven"), asked).learned
    assert learned.to_dict() == alone.to_dict()


def test_observations_of_the_topic_that_are_wrong_are_reported(start, caller, glides):
    start()
    broken = observation_to_message(glides(np.random.default_rng(0), 0.5))
    broken.objects[0].times = []
    caller.spin_until(lambda: caller.observations.get_subscription_count() == 1)
    caller.observations.publish(broken)

    def is_reported():
        status = status_of(caller, "observation input")
        return status and "rejected" in status[1]

    caller.spin_until(is_reported)
    assert caller.call(Learn).result.value == ResultCode.NO_OBSERVATIONS


def test_stays_responsive_and_busy_while_it_learns(start, caller, throws):
    start()
    caller.add_all(throws(6, 0))
    feedback = []
    goal, result = caller.start_goal(ENDLESS, feedback)
    caller.spin_until(lambda: feedback)
    caller.greet(GetStaticParameters)
    for _ in range(20):
        assert caller.call(GetStaticParameters).result.value == ResultCode.OK
    assert not result.done()
    busy = caller.call(Learn).result
    assert busy.value == ResultCode.BUSY
    assert "iteration" in busy.message
    _, refused = caller.start_goal(ENDLESS)
    assert caller.result_of(refused).result.result.value == ResultCode.BUSY
    # Observations are stored meanwhile.
    assert caller.add(throws(1, 9)[0]).observation_count == 7

    goal.cancel_goal_async()
    answer = caller.result_of(result)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.result.value == ResultCode.CANCELLED
    assert answer.result.iterations > 0
    assert caller.call(GetStaticParameters).static_parameters.version == 0
    # And it learns again.
    answer = caller.call(Learn, options=LearningOptions(max_iterations=20))
    assert (answer.result.value, answer.static_parameters.version) == (ResultCode.OK, 1)


def test_action_reports_its_progress(start, caller, throws):
    start()
    caller.add_all(throws(6, 0))
    feedback = []
    options = LearningOptions(method="hybrid_random", max_iterations=3000, seed=1)
    _, result = caller.start_goal(options, feedback)
    answer = caller.result_of(result)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.result.value == ResultCode.OK
    history = answer.result.cost_history
    assert len(history) == answer.result.iterations == 3000
    assert list(history) == sorted(history, reverse=True)
    caller.spin_until(lambda: feedback[-1].iteration == 3000)
    assert [cost for message in feedback for cost in message.cost_history] == list(history)
    assert all(message.max_iterations == 3000 for message in feedback)
    assert feedback[-1].time_left == 0.0
    assert answer.result.static_parameters.version == 1


def test_takes_over_parameters(start, caller):
    start()
    given = static_parameters_to_message(LearnedParameters.defaults(["ice", "steel"]))
    answer = caller.call(SetStaticParameters, static_parameters=given)
    assert (answer.result.value, answer.version) == (ResultCode.OK, 1)
    caller.spin_until(lambda: caller.published and caller.published[-1].version == 1)
    assert list(caller.published[-1].materials) == ["ice", "steel"]


def test_given_values_are_fixed_or_priors(start, caller, throws):
    start()
    caller.add_all(throws(4, 0))
    values = LearnedParameters.defaults(["ball", "floor"])
    fixed = static_parameters_to_message(values)
    pair = next(p for p in fixed.pairs if p.material_a != p.material_b)
    pair.restitution = 0.61
    name = "restitution[floor, ball]"
    held = SetStaticParameters.Request.FIXED
    answer = caller.call(SetStaticParameters, static_parameters=fixed, mode=held, names=[name])
    assert (answer.result.value, answer.version) == (ResultCode.OK, 1)
    pair.rolling_friction = 0.04
    pair.standard_deviations[2] = 0.001
    prior = SetStaticParameters.Request.PRIOR
    name = "rolling_friction[ball, floor]"
    answer = caller.call(SetStaticParameters, static_parameters=fixed, mode=prior, names=[name])
    assert (answer.result.value, answer.version) == (ResultCode.OK, 2)
    options = LearningOptions(method="random", max_iterations=50)
    learned = caller.call(Learn, options=options).static_parameters
    assert learned.version == 3
    coefficients = static_parameters_from_message(learned).parameters.pair("ball", "floor")
    assert coefficients["restitution"] == 0.61
    assert coefficients["rolling_friction"] != 0.04

    pair.restitution = 0.5
    bounds = [ParameterBounds(kind="restitution", lower=0.6, upper=0.9)]
    answer = caller.call(SetStaticParameters, static_parameters=fixed, bounds=bounds)
    assert answer.result.value == ResultCode.INVALID_INPUT
    assert "restitution[ball, ball] is 0.5; expected 0.6 to 0.9" in answer.result.message
    answer = caller.call(SetStaticParameters, static_parameters=fixed, mode=7)
    assert answer.result.value == ResultCode.INVALID_INPUT
    assert "mode is 7; expected one of 0 (prior), 1 (fixed), 2 (start)" in answer.result.message
    answer = caller.call(SetStaticParameters, static_parameters=fixed, names=["restitution[a, b]"])
    assert answer.result.value == ResultCode.UNKNOWN_NAME


def test_nothing_is_lost_by_kill_9(start, caller, throws):
    node = start()
    caller.add_all(throws(3, 0))
    before = caller.call(Learn, options=LearningOptions(max_iterations=50)).static_parameters
    caller.start_goal(ENDLESS)
    assert caller.add(throws(1, 9)[0]).added
    assert node.stop(signal.SIGKILL) == -signal.SIGKILL
    caller.close()

    start()
    again = Caller()
    again.spin_until(lambda: again.published)
    after = static_parameters_from_message(again.published[0])
    assert after.to_dict() == static_parameters_from_message(before).to_dict()
    assert again.add(throws(1, 10)[0]).observation_count == 5
    again.close()


def background_status(caller):
    """Message of the newest diagnostics about learning in the background."""
    status = status_of(caller, "learning in the background")
    return status[1] if status else ""


def test_learns_in_the_background_as_observations_arrive(start, caller, throws, true_parameters):
    start("online:=true", "online_seconds:=4.0", "online_priority:=normal")
    caller.spin_until(lambda: caller.observations.get_subscription_count() == 1)
    for observation in throws(6, 0, noise=0.003):
        caller.observations.publish(observation_to_message(observation))
    caller.spin_until(lambda: caller.published and caller.published[-1].version >= 1, 60.0)
    caller.spin_until(lambda: background_status(caller) == "waiting for observations", 60.0)
    newest = caller.call(GetStaticParameters).static_parameters
    assert caller.published[-1].version == newest.version
    learned = static_parameters_from_message(newest)
    got = learned.parameters.pair("ball", "floor")["restitution"]
    assert got == pytest.approx(true_parameters.pair("ball", "floor")["restitution"], abs=0.02)


def test_the_background_gives_way_and_can_be_turned_off_and_on(start, caller, throws):
    start("online:=true", "online_priority:=normal")
    caller.add_all(throws(200, 0))
    caller.spin_until(lambda: background_status(caller) == "learning", 60.0)
    _, result = caller.start_goal(LearningOptions(method="random", max_iterations=2000))
    caller.spin_until(lambda: background_status(caller).startswith("waits for the end"))
    assert caller.result_of(result).result.result.value == ResultCode.OK
    # That search has learned from all of them.
    caller.spin_until(lambda: background_status(caller) == "waiting for observations", 60.0)
    workers = children_of(start.nodes[0])
    assert len(workers) == 1
    caller.set_parameter("online", False)
    caller.spin_until(lambda: not children_of(start.nodes[0]), 1.0)
    caller.spin_until(lambda: background_status(caller).startswith("off"))
    caller.set_parameter("online", True)
    caller.spin_until(lambda: background_status(caller) == "waiting for observations", 60.0)
    assert start.nodes[0].stop() == 0
    caller.spin_until(lambda: not any(map(alive, workers)))


def test_full_disk(start, caller, glides):
    node = start()
    generator = np.random.default_rng(0)
    assert caller.add(glides(generator, 0.5)).added
    # No file of the node may grow any more: what a full disk looks like.
    resource.prlimit(node.pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))
    answer = caller.add(glides(generator, 0.5))
    assert answer.result.value == ResultCode.STORAGE_FAILED
    assert not answer.added
    options = LearningOptions(max_iterations=10)
    assert caller.call(Learn, options=options).result.value == ResultCode.STORAGE_FAILED
    # Room again: it goes on, and nothing was lost.
    unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    resource.prlimit(node.pid, resource.RLIMIT_FSIZE, unlimited)
    assert caller.add(glides(generator, 0.5)).observation_count == 2
    assert caller.call(Learn, options=options).result.value == ResultCode.OK


def level_of_room(caller):
    status = status_of(caller, "room for the database")
    return None if status is None else status[0]


def test_full_database_refuses_and_reports(start, caller, glides):
    node = start()
    generator = np.random.default_rng(0)
    assert caller.add(glides(generator, 0.5)).added
    caller.set_parameter("largest_database", 1000)
    answer = caller.add(glides(generator, 0.5))
    assert answer.result.value == ResultCode.STORAGE_FAILED
    assert "raise largest_database" in answer.result.message
    caller.spin_until(lambda: caller.observations.get_subscription_count() == 1)
    caller.observations.publish(observation_to_message(glides(generator, 0.5)))

    def is_refused():
        status = status_of(caller, "observation queue")
        refused = (DiagnosticStatus.ERROR, "1")
        return status and (status[0], status[2]["refused by a full database"]) == refused

    caller.spin_until(is_refused)
    caller.spin_until(lambda: level_of_room(caller) == DiagnosticStatus.WARN)
    caller.set_parameter("largest_database", 0)
    assert caller.add(glides(generator, 0.5)).observation_count == 2
    caller.spin_until(lambda: level_of_room(caller) == DiagnosticStatus.OK)
    assert node.output.count("beyond which no observation is added") == 1


def test_warning_before_the_disk_is_full(start, caller):
    node = start(f"least_free_space:={10**12}")
    caller.spin_until(lambda: level_of_room(caller) == DiagnosticStatus.WARN)
    caller.spin_until(lambda: "expected at least 1000000000000; make room" in node.output)
    caller.set_parameter("least_free_space", 0)
    caller.spin_until(lambda: level_of_room(caller) == DiagnosticStatus.OK)


def test_file_that_is_no_database_ends_the_node_with_one_line(start, tmp_path):
    garbage = tmp_path / "garbage"
    garbage.write_bytes(os.urandom(5000))
    node = start(database=garbage)
    assert node.wait() == 1
    (reported,) = [line for line in node.output.splitlines() if "error" in line]
    assert "is not an SQLite database" in reported


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ends_cleanly_while_it_learns(start, caller, throws, number):
    node = start()
    caller.add_all(throws(3, 0))
    feedback = []
    caller.start_goal(ENDLESS, feedback)
    caller.start_call(Learn)
    caller.spin_until(lambda: feedback)
    assert node.stop(number) == 0, node.output


def test_node_survives_callers_that_leave(start, caller, throws):
    node = start()
    caller.add_all(throws(3, 0))
    leaving = Caller()
    options = LearningOptions(method="random", max_iterations=3000)
    leaving.start_call(Learn, options=options)
    leaving.spin_until(lambda: leaving.diagnostics)
    leaving.close()
    busy = ResultCode.BUSY
    short = LearningOptions(max_iterations=10)
    caller.spin_until(lambda: caller.call(Learn, options=short).result.value != busy)
    assert node.is_running
    assert caller.call(GetStaticParameters).static_parameters.version == 2
