"""The benchmark of perception: recordings are read as they were written, and balls fall in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.perception.real_scenes import FRAME_TIME, GRAVITY
from benchmarks.perception.recorded import measure_recorded
from benchmarks.perception.recorded_frames import FLIGHT_FRAMES, NO_READING, Recording, Throws
from PIL import Image
from scipy.spatial.transform import Rotation

INTRINSICS = np.array([[100.0, 0.0, 80.0], [0.0, 100.0, 60.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    """A wall at 2 m, of which a corner was not read, from a camera that moves and turns."""
    depth = np.full((120, 160), 2000, dtype=np.uint16)
    depth[:5, :5] = NO_READING
    np.savetxt(tmp_path / "camera-intrinsics.txt", INTRINSICS)
    for k in range(FLIGHT_FRAMES):
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_euler("y", 0.002 * k).as_matrix()
        matrix[:3, 3] = 0.002 * k
        np.savetxt(tmp_path / f"frame-{k:06d}.pose.txt", matrix)
        Image.fromarray(depth).save(tmp_path / f"frame-{k:06d}.depth.png")
    return Recording(tmp_path)


def test_what_was_not_read_has_no_depth(recording: Recording) -> None:
    depth = recording.scene(0).depth
    assert np.unique(depth[:5, :5]) == [0.0]
    assert depth[60, 80] == pytest.approx(2.0)


def test_a_ball_falls_freely_in_the_frame_that_stands_still(recording: Recording) -> None:
    up = np.array([0.0, -1.0, 0.0])
    flights = []
    for seed in range(4):
        throws, places = Throws(up, np.random.default_rng(seed)), []
        for k in range(FLIGHT_FRAMES):
            pose = recording.pose(k)
            ball = throws.ball(k, recording.scene(k), pose)
            if ball is not None:
                places.append(pose.points(ball.center))
        flights.append(places)
    places = max(flights, key=len)
    assert len(places) >= 4
    accelerations = np.diff(places, 2, axis=0) / FRAME_TIME**2
    assert accelerations == pytest.approx(np.tile(-GRAVITY * up, (len(places) - 2, 1)), abs=1e-6)


def test_without_a_recording_nothing_is_measured(tmp_path: Path) -> None:
    outcome = measure_recorded(tmp_path, quick=True)
    assert not outcome.tables
    assert not outcome.key_figures
