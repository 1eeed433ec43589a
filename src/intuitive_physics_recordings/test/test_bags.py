"""Bags as they are written and read, whole and damaged."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import (
    CAMERA_INFO_TOPIC,
    DEPTH_TOPIC,
    DepthBagWriter,
)
from intuitive_physics_recordings.observation_bag import suite_typestore

from .small_camera import SMALL


def write_small(path: Path, frames: int = 5) -> list[np.ndarray]:
    images = [np.random.default_rng(i).integers(0, 9000, (6, 8), np.uint16) for i in range(frames)]
    with DepthBagWriter(path, SMALL) as writer:
        for i, image in enumerate(images):
            writer.write(10**18 + i * 33_333_333, image)
    return images


def read_all(path: Path) -> None:
    with BagReader(path) as bag:
        for message in bag.messages():
            bag.decode(message)


def test_depth_bag_is_read_as_it_was_written(tmp_path: Path) -> None:
    images = write_small(tmp_path / "bag")
    with BagReader(tmp_path / "bag") as bag:
        assert [(t.name, t.type, t.message_count) for t in bag.topics] == [
            (CAMERA_INFO_TOPIC, "sensor_msgs/msg/CameraInfo", 5),
            (DEPTH_TOPIC, "sensor_msgs/msg/Image", 5),
        ]
        assert bag.start_time == 10**18
        assert bag.duration == pytest.approx(4 * 0.033333333)
        infos = [bag.decode(m) for m in bag.messages([CAMERA_INFO_TOPIC])]
        read = [bag.decode(m) for m in bag.messages([DEPTH_TOPIC])]
        late = list(bag.messages([DEPTH_TOPIC], start_offset=0.05))
    assert np.array_equal(infos[0].k.reshape(3, 3), SMALL.matrix())
    for i, (message, image) in enumerate(zip(read, images, strict=True)):
        assert np.array_equal(message.data.view("<u2").reshape(6, 8), image)
        assert (message.encoding, message.header.frame_id) == ("16UC1", SMALL.frame_id)
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert stamp == 10**18 + i * 33_333_333
    assert len(late) == 3


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(share=st.floats(0.0, 0.999))
def test_a_truncated_mcap_is_one_clear_error(
    tmp_path_factory: pytest.TempPathFactory, share: float
) -> None:
    path = tmp_path_factory.mktemp("truncated") / "bag"
    write_small(path)
    file = path / "bag.mcap"
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    for where in (path, file):
        with (
            pytest.raises(InvalidInputError, match="cut short or damaged"),
            BagReader(where) as bag,
        ):
            list(bag.messages())


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_flipped_bytes_never_escape_as_another_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("flipped") / "bag"
    write_small(path, frames=2)
    file = path / "bag.mcap"
    content = bytearray(file.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    file.write_bytes(bytes(content))
    with contextlib.suppress(InvalidInputError):
        read_all(path)


def test_sqlite_bags_are_read_and_truncated_ones_refused(
    tmp_path: Path, write_chatter: Callable[[Path], None]
) -> None:
    path = tmp_path / "bag"
    write_chatter(path)
    with BagReader(path) as bag:
        messages = list(bag.messages())
        assert len(messages) == 200
        assert bag.decode(messages[3]).data == "hello 3" * 50
    (file,) = path.glob("*.db3")
    whole = file.read_bytes()
    for share in (0.0, 0.1, 0.5, 0.9):
        file.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InvalidInputError):
            read_all(path)


def test_missing_things_are_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="there is no bag"):
        BagReader(tmp_path / "nowhere")
    with pytest.raises(InvalidInputError, match=r"metadata\.yaml"):
        BagReader(tmp_path)
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(InvalidInputError, match=r"ends in \.mcap, \.db3, \.bag"):
        BagReader(tmp_path / "notes.txt")
    write_small(tmp_path / "bag")
    (tmp_path / "bag" / "bag.mcap").unlink()
    with pytest.raises(InvalidInputError, match="missing"):
        BagReader(tmp_path / "bag")


def test_an_unknown_topic_is_named_with_those_there_are(tmp_path: Path) -> None:
    write_small(tmp_path / "bag")
    with BagReader(tmp_path / "bag") as bag, pytest.raises(UnknownNameError, match=DEPTH_TOPIC):
        list(bag.messages(["/other"]))


def test_images_of_another_size_are_not_written(tmp_path: Path) -> None:
    with (
        pytest.raises(InvalidInputError, match="expected"),
        DepthBagWriter(tmp_path / "bag", SMALL) as writer,
    ):
        writer.write(0, np.zeros((2, 2), np.uint16))


RUN = "__import__('pathlib').Path({path!r}).touch()"
"""What a file would like to have run."""

NAMED = {1: "std_msgs/msg/Int32", 2: "intuitive_physics_msgs/msg/Shape"}
"""Types whose definition is taken from a bag of ROS 1 or 2."""

HOSTILE = {
    "type": ("x/msg/A:\n    {run}\nclass B", "int32 value\n"),
    "text of a type": ('x/msg/A"""\n    {run}\n    """', "int32 value\n"),
    "known type": ("std_msgs/msg/Int32:\n    {run}\nclass B", "int32 data\n"),
    "field": ("{named}", "int32 value = {run}\n"),
    "name of a field": ("{named}", "int32 value: {run}\n"),
    "constant": ("{named}", "string NAME='{run}'\nstring OTHER=\\'+{run}+\\'\nint32 value\n"),
    "default": ("{named}", "string value '\\' + {run} + \\''\n"),
    "part": ("{named}", "x/A:{run} value\n"),
    "definition of a part": (
        "{named}",
        "x/Part value\n" + 80 * "=" + "\nMSG: x/Part:\n    {run}\nclass B\nint32 value\n",
    ),
}
"""Type and definition of messages, by where these have something to run."""


@pytest.mark.parametrize("where", HOSTILE)
@pytest.mark.parametrize("ros", [1, 2])
def test_nothing_in_a_bag_is_run(tmp_path: Path, where: str, ros: int) -> None:
    run = RUN.format(path=str(tmp_path / "ran"))
    name, definition = (
        text.replace("{named}", NAMED[ros]).replace("{run}", run) for text in HOSTILE[where]
    )
    path = tmp_path / ("hostile.bag" if ros == 1 else "hostile")
    if ros == 1:
        with Ros1Writer(path) as writer:
            topic = writer.add_connection("/topic", name, msgdef=definition, md5sum="0" * 32)
            writer.write(topic, 10**18, bytes(64))
    else:
        with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topic = writer.add_connection("/topic", name, msgdef=definition, rihs01="RIHS01_0")
            writer.write(topic, 10**18, bytes(64))
    with contextlib.suppress(InvalidInputError), BagReader(path, suite_typestore()) as reader:
        for message in reader.messages():
            reader.decode(message)
    assert not (tmp_path / "ran").exists()
