"""Rendered bags are whole, true to their ground truth, and damage is told in one clear error."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.rendered_bag import (
    RenderSettings,
    render_bag,
    reuse_or_render_bag,
)
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import (
    CAMERA_INFO_TOPIC,
    DEPTH_TOPIC,
    DepthBagWriter,
)

SMALL = Camera.looking_at((0, 0, 1), (1, 1, 0), width=8, height=6, focal_length=6.0)


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


def test_a_rendered_bag_shows_the_ball_where_the_truth_has_it(small_bag: Path) -> None:
    truth = GroundTruth.load(small_bag)
    (throw,) = truth.throws
    camera = truth.camera
    empty, shares = None, []
    with BagReader(small_bag) as bag:
        for message in bag.messages([DEPTH_TOPIC]):
            image = bag.decode(message).data.view("<u2").reshape(camera.height, camera.width)
            time = (message.time - truth.start_time) * 1e-9
            if empty is None:
                empty = image.astype(float)
            if not throw.start_time <= time <= throw.end_time:
                continue
            center = throw.positions_at(np.array([time]))[0]
            column, row = np.rint(camera.project(center)).astype(int)
            patch = image[row - 2 : row + 3, column - 2 : column + 3] / 1000.0
            expected = np.linalg.norm(center - camera.position) - throw.radius
            ray = np.linalg.norm(camera.rays()[row, column])
            shares.append(np.median(patch) * ray - expected)
    assert len(shares) == 31
    assert np.abs(shares).max() < 0.03


def test_ground_truth_round_trip(small_bag: Path, tmp_path: Path) -> None:
    truth = GroundTruth.load(small_bag)
    truth.save(tmp_path)
    again = GroundTruth.load(tmp_path)
    assert again.static_parameters.to_dict() == truth.static_parameters.to_dict()
    assert np.array_equal(again.throws[0].motion.positions, truth.throws[0].motion.positions)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "other"}'])
def test_damaged_ground_truth_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "ground_truth.json").write_text(text)
    with pytest.raises(InvalidInputError):
        GroundTruth.load(tmp_path)


def test_same_settings_same_bag_and_it_is_reused(small_bag: Path, tmp_path: Path) -> None:
    wanted = RenderSettings(throws=1, seed=1, lead_in=0.5, throw_duration=1.0, pause=0.3)
    copy = tmp_path / small_bag.name
    render_bag(copy, wanted)
    for name in (f"{copy.name}.mcap", "metadata.yaml", "ground_truth.json"):
        assert (copy / name).read_bytes() == (small_bag / name).read_bytes()
    before = (copy / f"{copy.name}.mcap").stat().st_mtime_ns
    reuse_or_render_bag(copy, wanted)
    assert (copy / f"{copy.name}.mcap").stat().st_mtime_ns == before
    with pytest.raises(InvalidInputError, match="exists already"):
        render_bag(copy, wanted)


def test_nothing_is_left_of_a_render_that_failed(tmp_path: Path, needs_open3d: None) -> None:
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_bag(tmp_path / "bag", RenderSettings(throws=1), interrupt)
    assert list(tmp_path.iterdir()) == []


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
    with pytest.raises(InvalidInputError, match=r"\.mcap or \.db3"):
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


def test_a_settings_change_renders_anew_but_foreign_folders_stay(tmp_path: Path) -> None:
    foreign = tmp_path / "photos"
    foreign.mkdir()
    (foreign / "cat.jpg").write_text("miaow")
    with pytest.raises(InvalidInputError, match="ground truth"):
        reuse_or_render_bag(foreign, RenderSettings())
    assert (foreign / "cat.jpg").exists()
    shutil.rmtree(foreign)
