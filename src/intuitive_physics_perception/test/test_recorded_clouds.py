"""LiDAR scans of a hall with an exercise ball on a chair (tothtekla/SphereCalib)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.environment.environment_model import NoEnvironmentError
from intuitive_physics_perception.scene import perceive_cloud
from intuitive_physics_perception.settings import PerceptionSettings

SETTINGS = PerceptionSettings(up_hint=(0.0, 0.0, 1.0))


@pytest.mark.needs("recordings")
@pytest.mark.parametrize("scan", [1, 2, 4, 5, 7])
def test_the_ball_and_the_planes_are_found_and_nothing_else(
    recording: Callable[[str], Path], scan: int
) -> None:
    cloud = np.load(recording(f"lidar_ball_{scan}.npz"))["xyz"]
    for seed in range(2):
        environment, spheres = perceive_cloud(cloud, SETTINGS, np.random.default_rng(seed))
        normals = np.stack([plane.normal for plane in environment.planes])
        assert len(normals) >= 3
        assert normals[0] == pytest.approx([0, 0, 1])
        upright = np.abs(normals[:, 2]) < np.sin(np.radians(8.0))
        assert upright.sum() >= 2
        assert len(spheres) == 1
        assert 0.28 <= spheres[0].radius <= 0.305
        assert 1.7 < spheres[0].range < 3.2
        # On the seat of a chair.
        assert 0.3 < spheres[0].center[2] - spheres[0].radius < 0.7


@pytest.mark.needs("recordings")
@pytest.mark.parametrize("scan", [8, 9])
def test_the_ball_is_found_by_another_sensor(recording: Callable[[str], Path], scan: int) -> None:
    """Five scan lines meet the ball, 2° apart, of a beam that is wider than a camera's pixel."""
    cloud = np.load(recording(f"lidar_ball_{scan}.npz"))["xyz"]
    for seed in range(2):
        _, spheres = perceive_cloud(cloud, SETTINGS, np.random.default_rng(seed))
        assert len(spheres) == 1
        assert 0.28 <= spheres[0].radius <= 0.31


@pytest.mark.parametrize(
    ("points", "error"),
    [
        (np.zeros((0, 3)), NoEnvironmentError),
        (np.full((100, 3), np.nan), NoEnvironmentError),
        (np.zeros((100, 2)), InvalidInputError),
        ([["a", "b", "c"]], InvalidInputError),
    ],
)
def test_what_is_no_scene_gives_one_error(points, error) -> None:
    with pytest.raises(error, match="expected"):
        perceive_cloud(points, SETTINGS, np.random.default_rng(0))
