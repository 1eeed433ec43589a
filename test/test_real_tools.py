"""The suite as a roboticist runs it: real `ros2 run`, `ros2 launch`, `ros2 param` and the like."""

from __future__ import annotations

import os
import signal
import sqlite3
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from benchmarks.robot.ros2_process import LAUNCH, Ros2Process, ros2
from benchmarks.torture.nodes import thrown_ball
from diagnostic_msgs.msg import DiagnosticArray
from intuitive_physics_msgs.msg import Environment, ObjectStates, TrajectoryDistribution
from intuitive_physics_msgs.srv import AddObservation

from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_ros.conversions import observation_to_message
from intuitive_physics_ros.qos import LATCHED
from intuitive_physics_ros.scripting import Peer
from intuitive_physics_ros.topics import ENVIRONMENT, OBJECT_STATES, OBSERVATIONS, STATIC_PARAMETERS

pytestmark = [pytest.mark.long, pytest.mark.needs("ros2launch")]

NODES = ("perception_node", "learner_node", "predictor_node")

LONGEST_END = 10.0
"""s from Ctrl-C after which launch kills what has not ended; a busy machine may come near."""

SERVICES = {
    *("add_observation", "list_observations", "set_observation_status", "delete_observations"),
    *("export_observations", "get_static_parameters", "set_static_parameters", "learn", "suggest"),
    *("predict", "query"),
}
"""Names of the services of the suite's own types."""

EVERY_NODE = """\
/**:
  ros__parameters:
    use_sim_time: true
    horizon: 1
/**/predictor_node:
  ros__parameters:
    rate: 20
    carry_forward: false
/**/learner_node:
  ros__parameters:
    online: false
"""
"""Parameters for nodes of any namespace, whole numbers among them; a machine of two cores can keep
two robots up with it."""

WITH_IMU = """\
/**/perception_node:
  ros__parameters:
    gravity_source: imu
"""
"""An IMU is heard only then."""

GIVEN_PARAMETERS = """\
{static_parameters: {
  materials: [wood], densities: [777.0], density_standard_deviations: [.nan],
  density_identified: [false], cost: .nan,
  pairs: [{material_a: wood, material_b: wood, static_friction: 0.5, dynamic_friction: 0.4,
           rolling_friction: 0.01, restitution: 0.6,
           standard_deviations: [.nan, .nan, .nan, .nan]}]}}"""
"""Static parameters of one material, measured elsewhere."""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two throws, in a folder whose name no shell and no parser of expressions likes.

    They begin when two robots on two cores have modelled the room, which takes them seconds.
    """
    folder = tmp_path_factory.mktemp("bags") / "it's 1"
    render_bag(folder, RenderSettings(throws=2, seed=3, lead_in=2.0, pause=0.6))
    return folder


@pytest.fixture
def home(tmp_path: Path):
    """A home of the tools; the daemon that they start ends with it."""
    yield tmp_path
    ros2(tmp_path, "daemon", "stop")


def listed_until(home: Path, complete: Callable[[str], bool], *arguments: str) -> str:
    """Run a command until the daemon, which discovers one thing after another, lists all."""
    end = time.monotonic() + 30.0
    while not complete(said := ros2(home, *arguments)):
        assert time.monotonic() < end, said
    return said


def observations(database: Path) -> int:
    with sqlite3.connect(database) as connection:
        return connection.execute("SELECT count(*) FROM observations").fetchone()[0]


@pytest.mark.parametrize(
    ("argument", "complaint"),
    [
        ("rate:=fast", "rate is 'fast'; expected a number"),
        ("cammera:=zed", "there is no launch argument 'cammera'; expected camera"),
    ],
)
def test_a_bad_argument_is_one_clear_line_and_starts_nothing(tmp_path, argument, complaint) -> None:
    # test_launch_file.py of the bringup tries each argument.
    with Ros2Process(tmp_path, *LAUNCH, argument) as launch:
        assert launch.wait() == 1
    errors = [line for line in launch.output.splitlines() if "ERROR" in line]
    assert len(errors) == 1, launch.output
    assert complaint in errors[0]
    assert launch.children == []


def test_error_in_a_node_ends_everything_with_one_sentence(tmp_path) -> None:
    (tmp_path / "mine.yaml").write_text("/**/predictor_node:\n  ros__parameters: {rate: fast}\n")
    (tmp_path / "damaged.mcap").write_text("no bag")
    for argument, error in (
        (f"params_file:={tmp_path / 'mine.yaml'}", "predictor_node failed, so everything"),
        (f"bag:={tmp_path / 'damaged.mcap'}", "replay_node failed, so everything was ended: "),
    ):
        with Ros2Process(tmp_path, *LAUNCH, argument) as launch:
            assert launch.wait() == 1, launch.output
        assert launch.left_behind() == []
        assert error in launch.output.splitlines()[-1], launch.output
        assert "Traceback" not in launch.output


def test_rviz_that_is_not_installed_is_one_clear_line_and_starts_nothing(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    with Ros2Process(tmp_path, *LAUNCH, "rviz:=true") as launch:
        assert launch.wait() == 1
    assert "rviz2 is not installed; expected rviz:=false" in launch.output
    assert launch.children == []


RECORD = ["launch", "intuitive_physics_bringup", "record.launch.py"]


def test_recording_without_rosbag2_is_one_clear_line(tmp_path, monkeypatch) -> None:
    """The wheels' own prefix has none, whatever else is on this machine."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    with Ros2Process(tmp_path, *RECORD, f"output:={tmp_path / 'bag'}") as launch:
        assert launch.wait() == 1
    errors = [line for line in launch.output.splitlines() if "ERROR" in line]
    assert len(errors) == 1, launch.output
    assert "is not installed; expected ros2 bag with its MCAP storage" in errors[0]


def test_a_session_is_recorded_by_ros2_bag(tmp_path, monkeypatch) -> None:
    """With the two packages of rosbag2, of which only the names are there, and a `ros2` that tells
    its arguments: the wheels have no rosbag2."""
    prefix, told = tmp_path / "rosbag2", tmp_path / "told"
    index = prefix / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    for name in ("ros2bag", "rosbag2_storage_mcap"):
        (index / name).touch()
    stub = prefix / "bin" / "ros2"
    stub.parent.mkdir()
    stub.write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" > "{told}"\n')
    stub.chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}{os.pathsep}{sys.prefix}")
    monkeypatch.setenv("PATH", f"{stub.parent}{os.pathsep}{os.environ['PATH']}")
    folder = tmp_path / "it's 1"
    with Ros2Process(tmp_path, *RECORD, f"output:={folder}", "namespace:=left") as launch:
        assert launch.wait() == 0, launch.output
    arguments = told.read_text().splitlines()
    assert arguments[:6] == ["bag", "record", "--storage", "mcap", "--output", str(folder)]
    assert "/left/camera/camera/depth/image_rect_raw" in arguments
    assert "/left/intuitive_physics/predictions" in arguments


def test_every_argument_is_listed(tmp_path) -> None:
    listed = ros2(tmp_path, *LAUNCH, "--show-args")
    for name in ("namespace", "camera", "color", "points", "log_level", "respawn", "bag"):
        assert f"'{name}'" in listed


def test_plain_nodes_meet_and_take_whole_numbers(home) -> None:
    """`ros2 run` three times under one namespace: all inputs have a publisher."""
    parameters = home / "everything.yaml"
    parameters.write_text(EVERY_NODE.replace("use_sim_time: true", "use_sim_time: false"))
    arguments = ["--ros-args", "-r", "__ns:=/one", "--params-file", str(parameters)]
    runs = [
        Ros2Process(
            home, "run", f"intuitive_physics_{node.removesuffix('_node')}", node, *arguments
        )
        for node in NODES
    ]
    try:
        with Peer("inspector", 60.0) as peer:
            for topic in (ENVIRONMENT, OBJECT_STATES, OBSERVATIONS, STATIC_PARAMETERS):
                peer.spin_until(
                    lambda topic=topic: (
                        peer.node.count_publishers(f"/one/{topic}")
                        and peer.node.count_subscribers(f"/one/{topic}")
                    ),
                    f"both ends of {topic}",
                )
        predictor = "/one/predictor_node"
        assert "20.0" in ros2(home, "param", "get", predictor, "rate")
        said = ros2(home, "param", "set", predictor, "rate", "50")
        assert "Set parameter successful" in said
        assert "50.0" in ros2(home, "param", "get", predictor, "rate")
        dumped = ros2(home, "param", "dump", predictor)
        (home / "dumped.yaml").write_text(dumped)
        assert "rate: 50.0" in dumped
        ros2(home, "param", "set", predictor, "rate", "30")
        ros2(home, "param", "load", predictor, str(home / "dumped.yaml"))
        assert "50.0" in ros2(home, "param", "get", predictor, "rate")
        assert "Read only: true" in ros2(home, "param", "describe", "/one/learner_node", "database")
    finally:
        for run in runs:
            run.interrupt()
    assert [run.wait() for run in runs] == [0, 0, 0]
    for run in runs:
        assert "Traceback" not in run.output


def robot(home: Path, name: str, bag: Path, *arguments: str) -> Ros2Process:
    return Ros2Process(
        home,
        *LAUNCH,
        f"namespace:={name}",
        f"bag:={bag}",
        "camera:=generic",
        f"params_file:={home / 'everything.yaml'}",
        *arguments,
    )


def test_two_robots_replay_side_by_side(home, bag) -> None:
    """Each has its own topics, clock, frame, database and diagnostics; default subscribers hear."""
    (home / "everything.yaml").write_text(EVERY_NODE)
    heard = {}
    with (
        Peer("inspector", 120.0) as peer,
        robot(home, "left", bag, "rate:=0.4") as left,
        robot(home, "right", bag, "rate:=0.4") as right,
    ):
        diagnostics = peer.listen(DiagnosticArray, "/diagnostics")
        for name in ("left", "right"):
            heard[name] = [
                peer.listen(ObjectStates, f"/{name}/intuitive_physics/object_states"),
                peer.listen(TrajectoryDistribution, f"/{name}/intuitive_physics/predictions"),
                peer.listen(Environment, f"/{name}/intuitive_physics/environment", LATCHED),
            ]
        for name, launch in (("left", left), ("right", right)):
            peer.spin_until(
                lambda launch=launch: "the bag is at its end" in launch.output, f"the end of {name}"
            )
        peer.spin_until(
            lambda: all(launch.output.count("observed sphere") >= 2 for launch in (left, right)),
            "both throws of both robots",
        )
        for name, launch in (("left", left), ("right", right)):
            states, predictions, environments = heard[name]
            assert {message.header.frame_id for message in environments} == {
                f"{name}/intuitive_physics/environment"
            }
            assert len(states) > 100
            assert len(predictions) > 10
            # A second clock or camera would make time go back again and again.
            assert "time went back" not in launch.output
            assert launch.interrupt() < LONGEST_END, launch.output
            assert launch.wait() == 0
            assert launch.left_behind() == []
            assert launch.failed() == [], launch.output
            database = home / "data" / "intuitive_physics" / name / "learner.sqlite3"
            assert observations(database) == 2
        names = {status.name.partition(":")[0] for one in diagnostics for status in one.status}
        assert {f"{name}/{node}" for name in ("left", "right") for node in NODES} <= names


def test_a_bag_played_again_adds_nothing(home, bag) -> None:
    (home / "everything.yaml").write_text(EVERY_NODE)
    for _ in range(2):
        # Slowly: on a busy machine perception needs seconds for the room before the first throw.
        with robot(home, "again", bag, "rate:=0.4") as launch:
            launch.wait_for("observed sphere", count=2)
            launch.wait_for("the bag is at its end")
            time.sleep(0.5)
            launch.interrupt()
    assert observations(home / "data" / "intuitive_physics" / "again" / "learner.sqlite3") == 2


def test_wrong_clock_is_logged(home, bag) -> None:
    """The stamps of a bag are old: without its clock nothing can be predicted."""
    arguments = [f"bag:={bag}", "camera:=generic", "use_sim_time:=false", "rate:=2"]
    with Ros2Process(home, *LAUNCH, *arguments) as launch:
        launch.wait_for("does not predict: object states arrive")
        assert "set use_sim_time" in launch.output


def test_a_node_that_was_killed_comes_back_with_what_it_knew(home) -> None:
    with Ros2Process(home, *LAUNCH, "respawn:=true", "namespace:=lasting") as launch:
        launch.wait_for("version 0 of the static parameters")
        ros2(
            home,
            "service",
            "call",
            "/lasting/learner_node/set_static_parameters",
            "intuitive_physics_msgs/srv/SetStaticParameters",
            GIVEN_PARAMETERS,
        )
        os.kill(launch.pid_of("learner_node"), signal.SIGKILL)
        launch.wait_for("version 1 of the static parameters")
        answer = ros2(
            home,
            "service",
            "call",
            "/lasting/learner_node/get_static_parameters",
            "intuitive_physics_msgs/srv/GetStaticParameters",
        )
        assert "densities=[777.0]" in answer, answer
        assert launch.interrupt() < LONGEST_END, launch.output
        assert launch.left_behind() == []


@pytest.mark.parametrize("delay", [0.6, 1.0, 1.6])
def test_ctrl_c_at_the_start_is_a_clean_end(tmp_path, delay) -> None:
    """Once Python itself has started, which no program has in its hands."""
    with Ros2Process(tmp_path, *LAUNCH) as launch:
        launch.wait_for("process started with pid", count=3)
        time.sleep(delay)
        assert launch.interrupt() < LONGEST_END, launch.output
        assert launch.wait() == 0
        assert launch.left_behind() == []
    assert "Traceback" not in launch.output
    assert "KeyboardInterrupt" not in launch.output
    assert launch.failed() == [], launch.output


def test_a_manager_leads_the_nodes(home) -> None:
    """As nav2's does, here by hand: `autostart:=false` starts nodes that wait."""
    with Ros2Process(home, *LAUNCH, "autostart:=false", "namespace:=led") as launch:
        launch.wait_for("waits to be configured", count=3)
        names = [f"/led/{name}" for name in NODES]
        listed_until(home, lambda said: set(names) <= set(said.split()), "lifecycle", "nodes")
        # test_lifecycle.py leads each of them to and fro.
        for led, transition, state in (
            (names, "configure", "inactive"),
            (names, "activate", "active"),
            (names[:1], "deactivate", "inactive"),
            (names[:1], "cleanup", "unconfigured"),
            (names[:1], "shutdown", "finalized"),
        ):
            for name in led:
                said = ros2(home, "lifecycle", "set", name, transition)
                assert "Transitioning successful" in said
            assert state in ros2(home, "lifecycle", "get", led[0])
        assert launch.interrupt() < LONGEST_END, launch.output
        assert launch.failed() == [], launch.output


def test_every_service_and_action_answers_the_command_line(home) -> None:
    """With requests that are empty: each is answered, if only by a refusal with its number."""
    with Ros2Process(home, *LAUNCH, "namespace:=asked") as launch:
        launch.wait_for("version 0 of the static parameters")
        with Peer("inspector", 60.0) as peer:
            peer.spin_until(
                lambda: peer.node.count_publishers("/asked/intuitive_physics/predictions"),
                "predictor",
            )
        mark = "[intuitive_physics_msgs/"
        listed = listed_until(
            home,
            lambda said: said.count(mark) >= len(SERVICES),
            *("service", "list", "--show-types"),
        )
        own = [line.split() for line in listed.splitlines() if mark in line]
        assert len(own) == len(SERVICES)
        for name, kind in own:
            assert name.rpartition("/")[2] in SERVICES
            said = ros2(home, "service", "call", name, kind.strip("[]"))
            assert "result=intuitive_physics_msgs.msg.ResultCode(value=" in said, said
        goal = "/asked/learner_node/learn_parameters"
        said = ros2(
            home, "action", "send_goal", goal, "intuitive_physics_msgs/action/LearnParameters", "{}"
        )
        assert "Goal finished with status: ABORTED" in said
        assert launch.failed() == [], launch.output


def test_search_gives_feedback_and_is_cancelled(home) -> None:
    name, kind = (
        "/busy/learner_node/learn_parameters",
        "intuitive_physics_msgs/action/LearnParameters",
    )
    with Ros2Process(home, *LAUNCH, "namespace:=busy") as launch:
        launch.wait_for("version 0 of the static parameters")
        with Peer("inspector", 60.0) as peer:
            seen = AddObservation.Request(observation=observation_to_message(thrown_ball(1)))
            assert peer.call(AddObservation, "/busy/learner_node/add_observation", seen).added
        endless = "{options: {method: random, max_iterations: 4000000}}"
        goal = ("action", "send_goal", "--feedback", name, kind, endless)
        with Ros2Process(home, *goal) as asked:
            asked.wait_for("Feedback:", count=2)
            said = ros2(
                home, "service", "call", f"{name}/_action/cancel_goal", "action_msgs/srv/CancelGoal"
            )
            assert "return_code=0" in said
            asked.wait_for("Goal finished with status: CANCELED", timeout=5.0)
        assert launch.interrupt() < LONGEST_END, launch.output
        assert launch.failed() == [], launch.output


def test_each_argument_of_launch_counts(home) -> None:
    """Those that no other test gives: names of single topics, and what is around the nodes."""
    (home / "everything.yaml").write_text(EVERY_NODE + WITH_IMU)
    inputs = ("depth_image", "camera_info", "points", "imu", "color")
    given = {name: f"/my/{name}" for name in inputs} | {
        "namespace": "some",
        "camera": "zed",
        "params_file": str(home / "everything.yaml"),
        "log_level": "debug",
        "use_sim_time": "true",
        "enclaves": "/mine",
        "discovery": "LOCALHOST",
        "peers": "127.0.0.1;127.0.0.2",
        "rviz": "false",
    }
    words = [f"{name}:={value}" for name, value in given.items()]
    with Ros2Process(home, *LAUNCH, *words) as launch:
        with Peer("inspector", 60.0) as peer:
            for topic in (*(given[name] for name in inputs), "/clock"):
                peer.spin_until(
                    lambda topic=topic: peer.node.count_subscribers(topic), f"who hears {topic}"
                )
        launch.wait_for("[DEBUG]")
        commands = [Path(f"/proc/{pid}/cmdline").read_text() for pid in launch.children]
        variables = [Path(f"/proc/{pid}/environ").read_text() for pid in launch.children]
        assert all("--enclave\0/mine/" in command for command in commands)
        assert all("ROS_STATIC_PEERS=127.0.0.1;127.0.0.2\0" in text for text in variables)
        assert launch.interrupt() < LONGEST_END, launch.output
        assert launch.failed() == [], launch.output
