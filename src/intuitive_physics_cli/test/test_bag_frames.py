"""Frames of bags that others recorded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
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


def test_a_bag_that_shows_no_scene_is_refused_with_what_it_has(
    tmp_path: Path, write_chatter: Callable[[Path], None]
) -> None:
    write_chatter(tmp_path / "chatter")
    with (
        BagReader(tmp_path / "chatter") as bag,
        pytest.raises(InvalidInputError, match=r"/chatter \(std_msgs/msg/String\)"),
    ):
        find_frame_source(bag)
