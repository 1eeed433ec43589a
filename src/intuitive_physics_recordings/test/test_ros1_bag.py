"""Bags of ROS 1: what was recorded comes as messages of ROS 2."""

from __future__ import annotations

import bz2
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import InputLimits, limits, use_limits
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.ros1_bag import unpacked

TYPES = get_typestore(Stores.ROS1_NOETIC)
TYPES.register(get_types_from_msg("float32 strength\n", "robot_msgs/msg/Grip"))
TYPES.register(
    get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", "tf/msg/tfMessage")
)
DEPTH, INFO = "/camera/depth/image_rect", "/camera/depth/camera_info"


@pytest.fixture(autouse=True)
def limits_as_before():
    before = limits()
    yield
    use_limits(before)


def header(k):
    stamp = TYPES.types["builtin_interfaces/msg/Time"](sec=100 + k, nanosec=5)
    return TYPES.types["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="optical")


def camera_info(k):
    window = TYPES.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return TYPES.types["sensor_msgs/msg/CameraInfo"](
        header=header(k),
        height=6,
        width=8,
        distortion_model="plumb_bob",
        D=np.array([0.1, 0.2, 0.3, 0.4, 0.5]),
        K=np.arange(9.0),
        R=np.eye(3).ravel(),
        P=np.arange(12.0),
        binning_x=0,
        binning_y=0,
        roi=window,
    )


def image(k, pixels):
    return TYPES.types["sensor_msgs/msg/Image"](
        header=header(k),
        height=6,
        width=8,
        encoding="16UC1",
        is_bigendian=0,
        step=16,
        data=pixels.view(np.uint8).ravel(),
    )


def transforms():
    kind = TYPES.types["geometry_msgs/msg/Transform"]
    one = TYPES.types["geometry_msgs/msg/TransformStamped"](
        header(0),
        "camera",
        kind(
            TYPES.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0),
            TYPES.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        ),
    )
    return TYPES.types["tf/msg/tfMessage"]([one])


def write(path: Path, compression=None, frames=3) -> list[np.ndarray]:
    images = [np.random.default_rng(k).integers(0, 9000, (6, 8), np.uint16) for k in range(frames)]
    writer = Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        topics = {
            name: writer.add_connection(name, kind, typestore=TYPES, latching=latched)
            for name, kind, latched in (
                (DEPTH, "sensor_msgs/msg/Image", None),
                (INFO, "sensor_msgs/msg/CameraInfo", 1),
                ("/tf", "tf/msg/tfMessage", None),
                ("/grip", "robot_msgs/msg/Grip", None),
            )
        }
        grip = TYPES.types["robot_msgs/msg/Grip"](1.0)
        for k, pixels in enumerate(images):
            for name, message in (
                (INFO, camera_info(k)),
                (DEPTH, image(k, pixels)),
                ("/tf", transforms()),
                ("/grip", grip),
            ):
                kind = topics[name].msgtype
                time = 100_000_000_000 + 33_000_000 * k
                writer.write(topics[name], time, TYPES.serialize_ros1(message, kind))
    return images


@pytest.mark.parametrize("compression", [None, *Writer.CompressionFormat])
def test_messages_come_as_those_of_ros_2(tmp_path, compression) -> None:
    images = write(tmp_path / "robot.bag", compression)
    with BagReader(tmp_path / "robot.bag") as bag:
        # What ROS 2 has no type for is left out.
        assert [(one.name, one.type, one.message_count, one.latched) for one in bag.topics] == [
            (INFO, "sensor_msgs/msg/CameraInfo", 3, True),
            (DEPTH, "sensor_msgs/msg/Image", 3, False),
            ("/tf", "tf2_msgs/msg/TFMessage", 3, False),
        ]
        assert bag.start_time == 100_000_000_000
        assert bag.duration == pytest.approx(0.066)
        everything = [bag.decode(one) for one in bag.messages()]
        assert len(everything) == 9
        seen = [bag.decode(one) for one in bag.messages([DEPTH])]
        info = bag.decode(next(bag.messages([INFO])))
        tf = bag.decode(next(bag.messages(["/tf"])))
        assert len(list(bag.messages([DEPTH], start_offset=0.04))) == 1
    for k, (message, pixels) in enumerate(zip(seen, images, strict=True)):
        assert np.array_equal(message.data.view("<u2").reshape(6, 8), pixels)
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (100 + k, 5)
        assert message.header.frame_id == "optical"
    assert np.array_equal(info.k, np.arange(9.0))
    assert np.array_equal(info.d, [0.1, 0.2, 0.3, 0.4, 0.5])
    assert tf.transforms[0].child_frame_id == "camera"
    assert tf.transforms[0].transform.translation.z == 3.0


@pytest.fixture(scope="module")
def small_bag(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("ros1") / "small.bag"
    write(path, Writer.CompressionFormat.BZ2, frames=1)
    return path.read_bytes()


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.integers(0, 10_000), st.integers(1, 255))
def test_a_damaged_bag_is_one_sentence(tmp_path, small_bag, at, change) -> None:
    content = bytearray(small_bag)
    content[at % len(content)] ^= change
    path = tmp_path / "robot.bag"
    path.write_bytes(content)
    try:
        sentence = "expected"
        with BagReader(path) as bag:
            for message in bag.messages():
                bag.decode(message)
    except InvalidInputError as error:
        sentence = str(error)
    assert "expected" in sentence


@pytest.mark.parametrize("compression", list(Writer.CompressionFormat))
def test_a_chunk_that_unpacks_to_too_much_is_refused(tmp_path, compression) -> None:
    path = tmp_path / "robot.bag"
    write(path, compression)
    use_limits(InputLimits(largest_unpacked=1000))
    with (
        BagReader(path) as bag,
        pytest.raises(InvalidInputError, match="raise the limit largest_unpacked"),
    ):
        list(bag.messages())


def test_a_chunk_that_ends_too_soon_is_named() -> None:
    with pytest.raises(InvalidInputError, match="it was cut short"):
        unpacked(bz2.BZ2Decompressor, Path("robot.bag"), bz2.compress(bytes(1000))[:-20])
