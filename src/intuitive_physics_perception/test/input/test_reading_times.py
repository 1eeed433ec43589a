"""Times of readings: as drivers of LiDARs write them, of rows, and of a sensor that moves."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.input.reading_times import (
    as_of_start,
    reading_span,
    times_of_cloud,
    times_of_rows,
)

STAMP = 1_789_000_000.25
SCAN = np.linspace(0.0, 0.1, 12)
"""s, in one scan."""


def cloud(name: str, values: np.ndarray, datatype: int) -> Message:
    record = np.zeros(values.shape, dtype=[("xyz", "<f4", 3), (name, values.dtype)])
    record[name] = values
    return Message(
        header=Message(stamp=Message(sec=int(STAMP), nanosec=round(1e9 * (STAMP % 1.0)))),
        data=record.tobytes(),
        width=values.shape[1],
        height=values.shape[0],
        point_step=record.itemsize,
        row_step=record.itemsize * values.shape[1],
        fields=[
            Message(name="x", offset=0, datatype=7, count=1),
            Message(name=name, offset=12, datatype=datatype, count=1),
        ],
    )


@pytest.mark.parametrize(
    ("name", "values", "datatype", "expected"),
    [
        ("t", np.round(1e9 * SCAN).astype("<u4"), 6, SCAN),  # Ouster
        ("time", (SCAN - 0.1).astype("<f4"), 7, SCAN - 0.1),  # Velodyne, from the last packet
        ("timestamp", STAMP + SCAN, 8, SCAN),  # Hesai, RoboSense
        ("timestamp", 1e9 * (STAMP + SCAN), 8, SCAN),  # livox_ros_driver2
        ("offset_time", np.round(1e9 * SCAN).astype("<u4"), 6, SCAN),  # of Livox's own messages
    ],
)
def test_times_of_points_are_those_of_the_driver(name, values, datatype, expected) -> None:
    offsets = times_of_cloud(cloud(name, values.reshape(3, 4), datatype))
    # Doubles of nanoseconds since 1970 are 0.26 µs apart, and those of seconds 0.24 µs.
    assert offsets == pytest.approx(expected.reshape(3, 4), abs=1e-6)
    assert offsets.dtype == np.float32


@pytest.mark.parametrize(
    ("name", "values", "datatype"),
    [
        ("timestamp", 5000.0 + SCAN, 8),  # of the sensor's own clock, since it was switched on
        ("time", np.full(12, np.nan, "<f4"), 7),
        ("t", np.arange(12, dtype="<u2"), 4),
        ("intensity", SCAN.astype("<f4"), 7),
    ],
)
def test_other_times_and_fields_are_none(name, values, datatype) -> None:
    message = cloud(name, values.reshape(3, 4), datatype)
    assert times_of_cloud(message) is None
    message.fields = [Message(name="time", offset=4096, datatype=7, count=1)]
    assert times_of_cloud(message) is None


def test_rows_are_exposed_one_after_the_other() -> None:
    down, up = times_of_rows(480, 2, 3e-5), times_of_rows(480, 2, -3e-5)
    assert down[:, 0] == pytest.approx(3e-5 * np.arange(480), abs=1e-8)
    assert up == pytest.approx(down[::-1], abs=1e-8)


def test_a_sensor_that_turns_and_drives_reads_what_stands_still(rng) -> None:
    """x = P(0)⁻¹ P(t) x_t; between poses 10 ms apart the error is at most (ω dt)² r / 8."""
    world = rng.uniform([-8.0, -8.0, 1.0], [8.0, 8.0, 3.0], (6, 50, 3))
    offsets = np.sort(rng.uniform(0.0, 0.1, (6, 50)).astype(np.float32), axis=None).reshape(6, 50)
    speed, rate = np.array([0.8, 0.3, 0.0]), 1.0

    def pose(time: float) -> RigidTransform:
        return RigidTransform(
            speed * time + [1.0, 2.0, 0.0], Rotation.from_rotvec([0, 0, rate * time]).as_quat()
        )

    pairs = zip(offsets.flat, world.reshape(-1, 3), strict=True)
    read = [pose(float(t)).inverse.points(p) for t, p in pairs]
    points = np.array(read, dtype=np.float32).reshape(world.shape)
    times = np.linspace(0.0, 0.1, 11)
    moved = as_of_start(points, offsets, times, [pose(float(t)) for t in times])
    truth = pose(0.0).inverse.points(world.reshape(-1, 3)).reshape(world.shape)
    bound = (rate * 0.01) ** 2 * 12.0 / 8.0
    assert np.abs(moved - truth).max() < bound + 1e-5
    assert np.abs(points - truth).max() > 0.3


def test_a_frame_lasts_from_its_first_reading_to_its_last() -> None:
    """Where nothing was read there is no time either."""
    points = np.ones((2, 2, 3), np.float32)
    points[0, 0] = np.nan
    offsets = np.array([[-0.1, -0.05], [-0.02, 0.0]], np.float32)
    assert reading_span(points, offsets) == pytest.approx((-0.05, 0.0))
    assert reading_span(points * np.nan, offsets) == (0.0, 0.0)
    assert reading_span(points, None) == (0.0, 0.0)
    with pytest.raises(InvalidInputError, match="expected one for each point"):
        reading_span(points, offsets[:1])
