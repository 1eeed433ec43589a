"""Bags as they are written and read, whole and damaged."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import (
    CAMERA_INFO_TOPIC,
    DEPTH_TOPIC,
    DepthBagWriter,
)

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


def test_what_is_written_is_read(tmp_path: Path) -> None:
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
