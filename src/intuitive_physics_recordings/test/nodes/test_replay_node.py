"""The replay node as a process of its own, heard over DDS."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from std_msgs.msg import Int32

from intuitive_physics_recordings.bag_writing import offered_qos
from intuitive_physics_recordings.depth_bag_writer import DEPTH_TOPIC, DepthBagWriter
from intuitive_physics_recordings.nodes import replay_node
from intuitive_physics_ros.qos import LATCHED
from intuitive_physics_ros.scripting import NodeProcess, Peer

from ..small_camera import SMALL

TIMEOUT = 20.0
"""s until something must have happened."""


@pytest.fixture
def listener() -> Iterator[Peer]:
    with Peer("listener", TIMEOUT) as peer:
        yield peer


@pytest.fixture
def depth_bag(tmp_path: Path) -> Path:
    path = tmp_path / "depth"
    with DepthBagWriter(path, SMALL) as writer:
        for i in range(30):
            writer.write(10**18 + i * 10_000_000, np.full((6, 8), i + 1, np.uint16))
    return path


def start(**parameters: object) -> NodeProcess:
    arguments = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    return NodeProcess("intuitive_physics_recordings.nodes.replay_node", arguments)


def finish(process: NodeProcess, code: int = 0) -> str:
    """Wait for the end, which has to have this code, and return what it wrote."""
    assert process.wait(TIMEOUT) == code, process.output
    assert "Traceback" not in process.output
    return process.output


@pytest.mark.parametrize("quality", ["best effort", "reliable"])
def test_every_message_arrives_as_it_was_recorded(
    listener: Peer, depth_bag: Path, quality: str
) -> None:
    # The queue holds the whole bag, so that a listener that is held up for a moment loses nothing.
    reliability = {
        "best effort": ReliabilityPolicy.BEST_EFFORT,
        "reliable": ReliabilityPolicy.RELIABLE,
    }
    qos = QoSProfile(depth=100, reliability=reliability[quality])
    heard = listener.listen(Image, DEPTH_TOPIC, qos)
    clock = listener.listen(Clock, "/clock", 100)
    process = start(bag=depth_bag, wait_for_subscribers=f"[{DEPTH_TOPIC}]")
    listener.spin_until(lambda: len(heard) == 30, "every message")
    finish(process)
    assert [np.frombuffer(m.data, "<u2")[0] for m in heard] == list(range(1, 31))
    assert heard[3].header.frame_id == SMALL.frame_id
    times = [message.clock.sec * 10**9 + message.clock.nanosec for message in clock]
    assert times == sorted(times)
    assert times[0] >= 10**18


def latched_and_unknown_bag(path: Path) -> None:
    typestore = get_typestore(Stores.ROS2_JAZZY)
    typestore.register(get_types_from_msg("int32 value", "strange_msgs/msg/Strange"))
    int32, strange = typestore.types["std_msgs/msg/Int32"], "strange_msgs/msg/Strange"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        latched = [offered_qos(1, transient_local=True)]
        maps = writer.add_connection(
            "/map", int32.__msgtype__, typestore=typestore, offered_qos_profiles=latched
        )
        others = writer.add_connection("/strange", strange, typestore=typestore)
        writer.write(maps, 10**18, typestore.serialize_cdr(int32(data=7), int32.__msgtype__))
        message = typestore.types[strange](value=1)
        writer.write(others, 10**18 + 1, typestore.serialize_cdr(message, strange))
        writer.write(
            maps, 10**18 + 3_000_000_000, typestore.serialize_cdr(int32(data=8), int32.__msgtype__)
        )


def test_latched_topics_reach_late_subscribers_and_unknown_types_are_skipped(
    listener: Peer, tmp_path: Path
) -> None:
    latched_and_unknown_bag(tmp_path / "bag")
    process = start(bag=tmp_path / "bag", loop="true", rate=0.01)
    listener.spin_until(lambda: listener.node.count_publishers("/map"), "the replay")
    listener.spin_for(1.0)
    heard = listener.listen(Int32, "/map", LATCHED)
    listener.spin_until(lambda: heard, "the latched message")
    process.send_signal(signal.SIGINT)
    output = finish(process)
    assert heard[0].data == 7
    assert "/strange is skipped: its type strange_msgs/msg/Strange is not installed" in output


@pytest.mark.parametrize(("inputs", "left_out"), [("true", True), ("false", False)])
def test_results_in_a_recorded_session_are_left_out(
    tmp_path: Path, inputs: str, left_out: bool
) -> None:
    typestore = get_typestore(Stores.ROS2_JAZZY)
    path = tmp_path / "session"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for number, (topic, kind) in enumerate(
            {
                "/camera/image": "sensor_msgs/msg/CompressedImage",
                "/intuitive_physics/object_states": "std_msgs/msg/Int32",
            }.items()
        ):
            connection = writer.add_connection(topic, kind, typestore=typestore)
            message = typestore.types[kind]
            data = (
                message(data=1)
                if "Int32" in kind
                else message(
                    typestore.types["std_msgs/msg/Header"](
                        typestore.types["builtin_interfaces/msg/Time"](1, 0), "camera"
                    ),
                    "png",
                    np.zeros(3, np.uint8),
                )
            )
            writer.write(connection, 10**18 + number, typestore.serialize_cdr(data, kind))
    process = start(bag=path, inputs_only=inputs, wait_timeout=0.1)
    output = finish(process)
    assert ("/object_states is left out: it is made again" in output) is left_out
    plays = next(
        line for line in output.splitlines() if " plays " in line and "all the same" not in line
    )
    assert ("/intuitive_physics/object_states" in plays) is not left_out
    assert "/camera/image" in plays


@pytest.mark.parametrize(
    "type_name",
    ["imported_by_a_bag/msg/Image", "os/msg/Path", "__main__/msg/X", "numpy.msg/msg/X", "x/srv/X"],
)
def test_only_packages_of_messages_are_imported(
    type_name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "imported_by_a_bag"
    (package / "msg").mkdir(parents=True)
    (package / "__init__.py").write_text("raise SystemExit('the code of a package ran')")
    (package / "msg" / "__init__.py").write_text("class Image: pass")
    monkeypatch.syspath_prepend(tmp_path)
    assert replay_node._message_class(type_name) is None
    assert "imported_by_a_bag" not in sys.modules


@pytest.mark.parametrize("message", [Image, Int32, Clock])
def test_packages_of_messages_are_known(message: type) -> None:
    package = message.__module__.split(".")[0]
    assert replay_node._message_class(f"{package}/msg/{message.__name__}") is message
    assert replay_node._message_class(f"{package}/msg/Missing") is None


def test_bad_bags_and_parameters_are_one_clear_error(depth_bag: Path) -> None:
    file = depth_bag / "depth.mcap"
    whole = file.read_bytes()
    cases: list[tuple[dict[str, Any], str]] = [
        ({"bag": depth_bag / "nowhere"}, "there is no bag"),
        ({}, "parameter bag is empty"),
        ({"bag": depth_bag, "start_offset": 99.0}, "expected an offset within the bag"),
        (
            {"bag": depth_bag, "wait_for_subscribers": "[/other]", "wait_timeout": 0.5},
            "nobody subscribed to /other, ",
        ),
        ({"bag": depth_bag, "rate": -1.0}, "parameter rate is -1.0"),
    ]
    running = [(start(**parameters), text) for parameters, text in cases[:3]]
    running += [(start(**parameters), text) for parameters, text in cases[3:]]
    for process, text in running:
        output = finish(process, 1)
        assert text in output
        assert len([line for line in output.splitlines() if "[INFO]" not in line]) == 1
    file.write_bytes(whole[: len(whole) // 2])
    process = start(bag=depth_bag)
    assert "cut short or damaged" in finish(process, 1)


def test_a_bag_nobody_listens_to_ends_with_a_clear_error(depth_bag: Path) -> None:
    process = start(bag=depth_bag, wait_for_subscribers=f"[{DEPTH_TOPIC}]", wait_timeout=0.5)
    output = finish(process, 1)
    assert f"waits 0.5 s at most for a subscriber of {DEPTH_TOPIC}" in output
    assert f"nobody subscribed to {DEPTH_TOPIC} within 0.5 s" in output
