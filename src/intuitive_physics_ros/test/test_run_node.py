"""Nodes live and end as they should, tried with a small node in a process of its own."""

import os
import signal
import sys
import time
import uuid
from pathlib import Path
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import Float64

from intuitive_physics.processes import ChildProcess
from intuitive_physics_ros.lifecycle import run_node as run_node_module
from intuitive_physics_ros.scripting import Peer

SMALL_NODE = Path(__file__).parent / "small_node.py"
PATIENCE = 15.0
"""Seconds to wait for what takes well under one, on a machine that is busy with other things."""


@pytest.fixture
def start():
    """Start small nodes; none outlives its test."""
    started = []

    def start_one(*arguments, environment=None):
        command = [sys.executable, "-u", str(SMALL_NODE), *arguments]
        started.append(ChildProcess(command, environment=environment))
        return started[-1]

    yield start_one
    for node in started:
        node.stop(signal.SIGKILL)


@pytest.fixture
def caller():
    """Make a node of the test's own, with a way to spin it until something holds."""
    with Peer("caller", PATIENCE) as peer:
        yield peer


@pytest.mark.parametrize(
    "signals",
    [
        (signal.SIGINT,),
        (signal.SIGTERM,),
        (signal.SIGINT, signal.SIGINT, signal.SIGINT),
        (signal.SIGTERM, signal.SIGINT),
    ],
)
def test_signals_end_it_clean(start, signals):
    node = start()
    node.wait_for("ready")
    for number in signals:
        node.send_signal(number)
    assert node.wait(PATIENCE) == 0, node.output
    assert node.output.count("closed") == 1
    assert "Traceback" not in node.output


def test_late_second_interrupts_change_nothing(start):
    node = start()
    node.wait_for("ready")
    end = time.monotonic() + PATIENCE
    while node.is_running and time.monotonic() < end:
        node.send_signal(signal.SIGINT)
        time.sleep(0.002)
    assert node.wait(PATIENCE) == 0, node.output
    assert "Traceback" not in node.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_while_it_starts(start, number):
    node = start("--slow-start")
    node.wait_for("starting")
    assert node.stop(number) == 0, node.output
    assert "Traceback" not in node.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_while_its_module_is_imported(number, tmp_path):
    slow = "import time; print('imports', flush=True); time.sleep(60)"
    (tmp_path / "slow_module.py").write_text(slow)
    start = "from intuitive_physics_ros.lifecycle import start_node"
    run = f"{start}; start_node.run_module('slow_module')"
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    process = ChildProcess([sys.executable, "-c", run], environment=environment)
    process.wait_for("imports\n", PATIENCE)
    assert process.stop(number) == 0
    assert process.output == "imports\n"


@pytest.mark.parametrize("place", ["start", "callback", "end"])
def test_node_ends_at_any_moment(start, caller, place):
    node = start(*{"start": ["--endless-start"], "end": ["--slow-end"]}.get(place, []))
    if place == "start":
        node.wait_for("starting")
    else:
        node.wait_for("ready")
    if place == "callback":
        publisher = caller.node.create_publisher(Float64, "/small/number", 10)
        caller.spin_until(lambda: publisher.get_subscription_count() == 1, "the node hears")
        publisher.publish(Float64(data=14.0))
        node.wait_for("sleeps")
    assert node.stop(signal.SIGINT) == 0, node.output
    assert "ended while this was still under way: MainThread" in node.output
    assert "Traceback" not in node.output


def test_a_node_that_hangs_with_the_lock_of_python_ends_and_says_where(start):
    node = start("--locked-end")
    node.wait_for("ready")
    assert node.stop(signal.SIGINT) == 1
    assert "small_node.py" in node.output
    assert "in destroy_node" in node.output


def test_an_unexpected_error_is_reported_once_and_leaves_it_alive(start, caller):
    node, levels = start(), []
    node.wait_for("ready")
    caller.node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda m: levels.extend(
            (s.level, s.message) for s in m.status if s.name == "small: unexpected errors"
        ),
        10,
    )
    publisher = caller.node.create_publisher(Float64, "/small/number", 10)
    caller.spin_until(lambda: publisher.get_subscription_count() == 1, "the node hears")
    caller.spin_until(lambda: (DiagnosticStatus.OK, "none") in levels, "that nothing went wrong")
    publisher.publish(Float64(data=13.0))
    node.wait_for("a callback failed: ValueError: 13 brings bad luck (")
    caller.spin_until(lambda: levels[-1][0] == DiagnosticStatus.WARN, "a warning")
    for _ in range(5):
        publisher.publish(Float64(data=13.0))
    caller.spin_until(lambda: levels[-1][0] == DiagnosticStatus.ERROR, "an error")
    assert "ValueError in small_node.py:" in levels[-1][1]
    assert "_on_number" in levels[-1][1]
    answers = []
    caller.node.create_subscription(Float64, "/small/double", lambda m: answers.append(m.data), 10)
    caller.spin_until(lambda: publisher.publish(Float64(data=4.0)) or answers, "an answer")
    assert node.stop(signal.SIGINT) == 0
    # Once when it was new, once when it made the error state.
    assert node.output.count("13 brings bad luck") == 2, node.output


def test_worker_it_forked_can_be_ended_and_leaves_it_alive(start):
    node = start("--worker")
    node.wait_for("ready")
    assert f"worker ended by signal {signal.SIGTERM:d}" in node.output
    time.sleep(0.5)
    assert node.is_running
    assert node.stop(signal.SIGINT) == 0, node.output


@pytest.mark.parametrize(
    ("argument", "complaint"),
    [
        (
            "rate:=0.5",
            "parameter rate is 0.5; expected a number, 1.0 to",
        ),
        ("rate:=2000", "parameter rate is 2000; expected a number, 1.0 to"),
        ("rate:=true", "parameter rate is True; expected a number, 1.0 to"),
        ("lengths:=[a]", "parameter lengths is ['a']; expected a list of numbers"),
        ("rate:=.nan", "parameter rate is nan"),
        ("rate:=fast", "parameter rate is 'fast'"),
        ("count:=11", "parameter count is 11; expected a whole number, 1 to 10"),
        ("mode:=slow", "parameter mode is 'slow'; expected a string, one of fast, exact"),
        ("names:=[1, 2]", "parameter names is"),
        ("names:=[impossible]", "names are impossible; expected possible ones"),
        ("foo", "Couldn't parse parameter override rule"),
    ],
)
def test_bad_parameter_is_one_clear_line(start, argument, complaint):
    node = start("--ros-args", "-p", argument)
    assert node.wait(PATIENCE) == 1
    errors = [line for line in node.output.splitlines() if "error:" in line]
    assert len(errors) == 1, node.output
    assert errors[0].startswith("small_node.py: error: ")
    assert complaint in errors[0]
    assert "Traceback" not in node.output


def test_whole_numbers_are_taken_for_doubles(start, caller):
    start("--ros-args", "-p", "rate:=50", "-p", "lengths:=[1, 2]").wait_for("ready")
    client = AsyncParameterClient(caller.node, "/small")
    caller.spin_until(client.services_are_ready, "services of parameters")
    values = caller.ask(lambda: client.get_parameters(["rate", "lengths"]), "their values").values
    rate, lengths = values
    assert (rate.type, rate.double_value) == (ParameterType.PARAMETER_DOUBLE, 50.0)
    assert list(lengths.double_array_value) == [1.0, 2.0]


def test_unknown_parameter_is_logged(start):
    node = start("--ros-args", "-p", "ratte:=1.0")
    node.wait_for("parameter ratte was given, but this node has none of that name")
    assert node.stop(signal.SIGINT) == 0


def test_runs_without_home(start, tmp_path):
    environment = {k: v for k, v in os.environ.items() if k not in ("HOME", "ROS_LOG_DIR")}
    node = start(environment={**environment, "LOGS_DIRECTORY": str(tmp_path / "logs")})
    node.wait_for("ready")
    assert node.stop(signal.SIGINT) == 0, node.output
    assert list(tmp_path.glob("logs/*.log"))


def test_removes_shared_memory_of_what_was_killed(start):
    # As Fast DDS names a segment, and the file that its process holds the lock of.
    name = f"fastrtps_{uuid.uuid4().hex[:16]}"
    files = [Path("/dev/shm") / name, Path("/dev/shm") / f"{name}_el"]
    for file in files:
        file.write_bytes(b"x")
        os.utime(file, (time.time() - 60.0,) * 2)
    start().wait_for("ready")
    assert not [file for file in files if file.exists()]


@pytest.mark.parametrize("home", ["home", "file"])
def test_logs_are_the_users_own(monkeypatch, tmp_path, home):
    (tmp_path / "file").write_text("no folder")
    entry = SimpleNamespace(pw_dir=str(tmp_path / home))
    monkeypatch.delenv("LOGS_DIRECTORY", raising=False)
    monkeypatch.setattr("pwd.getpwuid", lambda user: entry)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folders = {run_node_module._log_folder() for _ in range(2)}
    if home == "home":
        assert folders == {tmp_path / "home" / ".ros" / "log"}
    else:
        # Nobody can know the name beforehand, and nobody else can look in.
        assert len(folders) == 2
        assert all(folder.stat().st_mode & 0o777 == 0o700 for folder in folders)


def test_bad_input_leaves_it_alive(start, caller):
    node = start()
    answers = []
    publisher = caller.node.create_publisher(Float64, "/small/number", 10)
    caller.node.create_subscription(Float64, "/small/double", lambda m: answers.append(m.data), 10)
    caller.spin_until(lambda: publisher.get_subscription_count() == 1, "the node hears")
    caller.spin_until(lambda: caller.node.count_publishers("/small/double") == 1, "the node speaks")
    publisher.publish(Float64(data=0.0))
    node.wait_for("number is 0; expected another")
    for _ in range(3):
        publisher.publish(Float64(data=-1.0))
    caller.spin_until(lambda: publisher.publish(Float64(data=4.0)) or answers, "an answer")
    assert answers[0] == 8.0
    # What it has written is known for sure once it has ended.
    assert node.stop(signal.SIGINT) == 0
    assert node.output.count("~/number rejected: number is -1; expected above zero") == 1


def test_diagnostics_tell_of_the_input(start, caller):
    start().wait_for("ready")
    seen = {}
    caller.node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: seen.update({s.name: s for s in m.status}), 10
    )
    publisher = caller.node.create_publisher(Float64, "/small/number", 10)

    def told(level, words):
        status = seen.get("small: number", DiagnosticStatus())
        return status.level == level and words in status.message

    caller.spin_until(
        lambda: told(DiagnosticStatus.WARN, "nothing arrived yet on ~/number"),
        "that nothing arrived yet",
    )
    assert seen["small: name"].level == DiagnosticStatus.OK
    assert seen["small: name"].hardware_id == "/small"
    caller.spin_until(
        lambda: publisher.publish(Float64(data=1.0)) or told(b"\0", "arrives"),
        "that something arrives",
    )
    caller.spin_until(
        lambda: publisher.publish(Float64(data=-1.0)) or told(b"\2", "above zero"),
        "that one is refused",
    )
    caller.spin_until(
        lambda: told(DiagnosticStatus.ERROR, "nothing arrived on ~/number for"),
        "that nothing arrives any more",
    )
    caller.spin_until(
        lambda: publisher.publish(Float64(data=1.0)) or told(b"\0", "arrives"),
        "that something arrives",
    )


def test_diagnostics_come_once_a_second_though_simulated_time_stands(start, caller):
    start("--ros-args", "-p", "use_sim_time:=true")
    times = []
    caller.node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: times.append(time.monotonic()), 10
    )
    caller.spin_until(lambda: len(times) == 6, "six messages")
    # The first may have waited for discovery; on a busy machine single ones come late.
    assert (times[5] - times[1]) / 4 > 0.5


def test_second_node_of_the_same_name_is_reported_by_both(start, caller):
    levels = []

    def note(message):
        levels.extend(s.level for s in message.status if s.name == "small: name")

    caller.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
    first, second = start(), start()
    first.wait_for("2 nodes have the name /small")
    second.wait_for("2 nodes have the name /small")
    caller.spin_until(lambda: DiagnosticStatus.WARN in levels, "a warning")
    assert second.stop(signal.SIGINT) == 0
    first.wait_for("/small is the only node of this name")
    assert first.stop(signal.SIGINT) == 0


def test_parameters_are_checked_while_it_runs(start, caller):
    start().wait_for("ready")
    client = AsyncParameterClient(caller.node, "/small")
    caller.spin_until(client.services_are_ready, "services of parameters")

    def set_to(name, value):
        parameters = [Parameter(name, value=value)]
        return caller.ask(lambda: client.set_parameters(parameters), f"{name} set").results[0]

    assert set_to("count", 5).successful
    assert set_to("limit", 2).successful
    assert set_to("lengths", [1, 2]).successful
    values = caller.ask(lambda: client.get_parameters(["limit", "lengths"]), "their values").values
    limit, lengths = values
    assert (limit.type, limit.double_value) == (ParameterType.PARAMETER_DOUBLE, 2.0)
    assert list(lengths.double_array_value) == [1.0, 2.0]
    assert set_to("mode", "exact").successful
    for name, value, reason in [
        ("rate", 50.0, "read-only"),
        ("count", 0, "range"),
        ("count", 2.5, "type"),
        ("mode", "slow", "one of fast, exact"),
        ("limit", float("nan"), "limit is nan; expected a number"),
    ]:
        result = set_to(name, value)
        assert not result.successful, name
        assert reason in result.reason.lower(), result.reason


def test_parameters_describe_themselves(start, caller):
    start().wait_for("ready")
    client = AsyncParameterClient(caller.node, "/small")
    caller.spin_until(client.services_are_ready, "services of parameters")
    names = ["rate", "count", "mode"]
    rate, count, mode = caller.ask(
        lambda: client.describe_parameters(names), "their descriptions"
    ).descriptors
    assert (rate.description, rate.read_only) == ("Hz of the sensor", True)
    assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (
        1.0,
        1000.0,
    )
    assert (count.integer_range[0].from_value, count.integer_range[0].to_value) == (1, 10)
    assert "one of fast, exact" in mode.additional_constraints
