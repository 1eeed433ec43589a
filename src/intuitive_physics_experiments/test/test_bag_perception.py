"""Perception run over bags: depth images with camera info, and point clouds."""

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
    perceive_recording,
    read_frames,
)
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC


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


def test_depth_images_are_guessed_with_their_camera(small_bag: Path) -> None:
    with BagReader(small_bag) as bag:
        source = find_frame_source(bag)
        assert (source.topic, source.camera_info_topic) == (DEPTH_TOPIC, CAMERA_INFO_TOPIC)
        time, points = next(iter(read_frames(bag, source)))
        assert time == pytest.approx(bag.start_time * 1e-9)
    truth = GroundTruth.load(small_bag)
    world = points @ truth.camera.rotation.T + truth.camera.position
    seen = np.isfinite(points[..., 2])
    distances = [np.abs(p.signed_distances(world[seen])) for p in truth.environment.planes]
    assert np.median(np.min(distances, axis=0)) < 0.01


def test_a_throw_becomes_an_observation_near_the_truth(small_bag: Path) -> None:
    truth = GroundTruth.load(small_bag)
    (throw,) = truth.throws
    settings = PerceptionSettings(known_objects=(KnownObject("foam", throw.radius, "foam"),))
    progress: list[tuple[int, int]] = []
    seen = perceive_recording(
        small_bag,
        settings,
        np.random.default_rng(0),
        on_progress=lambda done, total: progress.append((done, total)),
    )
    assert progress[-1] == (seen.source.frames, seen.source.frames)
    assert seen.model is not None
    assert len(seen.model.environment.planes) == 3
    assert seen.frames_with_spheres >= 28
    (observation,) = seen.observations
    (ball,) = observation.objects
    assert ball.object.material == "foam"
    sensor = seen.model.to_sensor(ball.trajectory.positions)
    world = sensor @ truth.camera.rotation.T + truth.camera.position
    times = ball.trajectory.times - truth.start_time * 1e-9
    inside = (times >= throw.start_time) & (times <= throw.end_time)
    errors = np.linalg.norm(world[inside] - throw.positions_at(times[inside]), axis=1)
    assert np.sqrt((errors**2).mean()) < 0.01


def test_clouds_are_read(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    points[7] = np.nan
    cloud_bag(tmp_path / "bag", points)
    with BagReader(tmp_path / "bag") as bag:
        frames = list(read_frames(bag, find_frame_source(bag)))
    assert [time for time, _ in frames] == pytest.approx([10.5, 11.5, 12.5])
    assert np.array_equal(frames[0][1][0], points, equal_nan=True)


def test_bags_that_show_no_scene_are_told_apart(
    tmp_path: Path, small_bag: Path, write_chatter: Callable[[Path], None]
) -> None:
    write_chatter(tmp_path / "chatter")
    with (
        BagReader(tmp_path / "chatter") as bag,
        pytest.raises(InvalidInputError, match=r"/chatter \(std_msgs/msg/String\)"),
    ):
        find_frame_source(bag)
    with BagReader(small_bag) as bag, pytest.raises(InvalidInputError, match="on /other"):
        find_frame_source(bag, "/other")
