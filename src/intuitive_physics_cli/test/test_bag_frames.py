"""Frames of bags that others recorded."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.evaluation.recording_perception import (
    find_frame_source,
    read_frames,
)
from intuitive_physics_recordings.bag_reader import BagReader


def cloud_bag(path: Path, points: np.ndarray, topic: str = "/points") -> None:
    typestore = get_typestore(Stores.ROS2_JAZZY)
    types = typestore.types
    kind = "sensor_msgs/msg/PointCloud2"
    field = types["sensor_msgs/msg/PointField"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection(topic, kind, typestore=typestore)
        for i in range(3):
            stamp = types["builtin_interfaces/msg/Time"](sec=10 + i, nanosec=500_000_000)
            message = types[kind](
                header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="lidar"),
                height=1,
                width=len(points),
                fields=[
                    field(name=name, offset=4 * k, datatype=7, count=1)
                    for k, name in enumerate("xyz")
                ],
                is_bigendian=False,
                point_step=12,
                row_step=12 * len(points),
                data=points.astype("<f4").view(np.uint8).ravel(),
                is_dense=True,
            )
            writer.write(connection, 10**10 + i * 10**9, typestore.serialize_cdr(message, kind))


def test_clouds_are_read(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    points[7] = np.nan
    cloud_bag(tmp_path / "bag", points)
    with BagReader(tmp_path / "bag") as bag:
        frames = list(read_frames(bag, find_frame_source(bag)))
    assert [time for time, _ in frames] == pytest.approx([10.5, 11.5, 12.5])
    assert np.array_equal(frames[0][1][0], points, equal_nan=True)


def compressed_bag(path: Path, depth: np.ndarray) -> None:
    """A ROS 1 bag with compressed depth images, their camera, and compressed colours first."""
    types = get_typestore(Stores.ROS1_NOETIC).types
    typestore = get_typestore(Stores.ROS1_NOETIC)
    stamp = types["builtin_interfaces/msg/Time"](sec=7, nanosec=250_000_000)
    header = types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="optical")
    file = BytesIO()
    Image.fromarray(depth).save(file, "PNG")
    packed = np.frombuffer(bytes(12) + file.getvalue(), np.uint8)
    image = types["sensor_msgs/msg/CompressedImage"]
    window = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    height, width = depth.shape
    info = types["sensor_msgs/msg/CameraInfo"](
        header=header,
        height=height,
        width=width,
        distortion_model="plumb_bob",
        D=np.array([0.2, 0.0, 0.0, 0.0, 0.0]),
        K=np.array([10.0, 0.0, 3.5, 0.0, 10.0, 2.5, 0.0, 0.0, 1.0]),
        R=np.eye(3).ravel(),
        P=np.array([20.0, 0.0, 3.5, 0.0, 0.0, 20.0, 2.5, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0,
        binning_y=0,
        roi=window,
    )
    with Ros1Writer(path) as writer:
        for topic, message in (
            ("/camera/color/compressed", image(header, "rgb8; jpeg compressed bgr8", packed)),
            ("/camera/depth/camera_info", info),
            (
                "/camera/depth/image_rect/compressedDepth",
                image(header, "16UC1; compressedDepth png", packed),
            ),
        ):
            kind = message.__msgtype__
            connection = writer.add_connection(topic, kind, typestore=typestore)
            writer.write(connection, 7 * 10**9, typestore.serialize_ros1(message, kind))


@pytest.mark.parametrize(("rectified", "focal_length"), [(True, 20.0), (False, 10.0)])
def test_compressed_images_of_ros_1_are_read(tmp_path: Path, rectified, focal_length) -> None:
    depth = np.full((6, 8), 1500, np.uint16)
    compressed_bag(tmp_path / "robot.bag", depth)
    with BagReader(tmp_path / "robot.bag") as bag:
        source = find_frame_source(bag)
        assert source.topic == "/camera/depth/image_rect/compressedDepth"
        assert source.camera_info_topic == "/camera/depth/camera_info"
        ((time, points),) = read_frames(bag, source, rectified=rectified)
    assert time == 7.25
    # Half a pixel beside the principal point a distortion of 0.2 bends the ray by 0.05 %.
    expected = [0.5 / focal_length * 1.5, 0.5 / focal_length * 1.5, 1.5]
    np.testing.assert_allclose(points[3, 4], expected, rtol=1e-6 if rectified else 2e-3)


def test_a_bag_that_shows_no_scene_is_refused_with_what_it_has(
    tmp_path: Path, write_chatter: Callable[[Path], None]
) -> None:
    write_chatter(tmp_path / "chatter")
    with (
        BagReader(tmp_path / "chatter") as bag,
        pytest.raises(InvalidInputError, match=r"/chatter \(std_msgs/msg/String\)"),
    ):
        find_frame_source(bag)
