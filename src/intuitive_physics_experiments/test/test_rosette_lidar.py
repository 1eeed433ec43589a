"""A LiDAR whose pattern does not repeat, and what perception makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.scene import Environment, Plane
from intuitive_physics_experiments.rendering.camera import UP, Camera
from intuitive_physics_experiments.rendering.rosette_lidar import RosetteLidar, RosettePattern
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings


def seen_parts(directions: np.ndarray) -> int:
    """Number of squares of half a degree, at small angles, that directions (n, 3) meet."""
    squares = np.floor(directions[:, :2] / np.radians(0.5)).astype(int)
    return len({tuple(square) for square in squares})


def test_the_pattern_fills_its_cone_over_time() -> None:
    """It stays in the cone; a later cloud meets what an earlier one has not."""
    pattern = RosettePattern()
    clouds = [pattern.directions(pattern.times(0.1 * k, 0.1)) for k in range(10)]
    for directions in clouds:
        angles = np.degrees(np.arctan(np.linalg.norm(directions[:, :2], axis=1)))
        assert angles.max() <= 19.2 + 1e-9
        assert len(directions) == 10_000
    one, all_ten = seen_parts(clouds[0]), seen_parts(np.concatenate(clouds))
    cone = np.pi * (np.tan(np.radians(19.2)) / np.radians(0.5)) ** 2
    assert one < 0.75 * cone
    assert all_ten > 0.95 * cone


def test_readings_are_on_the_floor_and_on_the_ball() -> None:
    rng = np.random.default_rng(3)
    camera = Camera.looking_at([0.0, 0.0, 1.2], [2.5, 0.0, 0.0])
    floor = Environment([Plane("floor", "room", (0.0, 0.0, 1.0), 0.0)])
    lidar = RosetteLidar(camera, floor, RosettePattern(), 0.0, rng)
    center = np.array([2.2, 0.1, 0.12])
    points, times, owner = lidar.read(0.3, 0.1, [center], [0.12])
    world = points[0].astype(np.float64) @ camera.rotation.T + camera.position
    assert len(times) == len(owner) == points.shape[1]
    assert (owner == 0).sum() > 100
    away = np.linalg.norm(world[owner == 0] - center, axis=1)
    assert away == pytest.approx(0.12, abs=1e-5)
    assert world[owner == -1, 2] == pytest.approx(0.0, abs=1e-5)


def test_environment_and_a_rolling_ball_are_found_and_followed() -> None:
    """Ten clouds a second; in each the ball moves by 2 cm. It is followed at the times of its own
    readings, and its velocity is the one that it has."""
    rng = np.random.default_rng(5)
    camera = Camera.looking_at([0.0, 0.0, 1.2], [2.5, 0.0, 0.2])
    walls = [Plane("wall", "room", (-1.0, 0.0, 0.0), -4.5)]
    room = Environment([Plane("floor", "room", (0.0, 0.0, 1.0), 0.0), *walls])
    lidar = RosetteLidar(camera, room, RosettePattern(), 0.005, rng)
    up = camera.rotation.T @ UP
    settings = PerceptionSettings(up_hint=tuple(up.tolist()))
    pipeline = PerceptionPipeline(settings, np.random.default_rng(0))
    start, velocity, radius = np.array([2.3, -0.2, 0.12]), np.array([0.0, 0.2, 0.0]), 0.12
    followed = 0
    for n in range(30):
        begin = 0.1 * n
        times = lidar.pattern.times(begin, 0.1)
        balls = ([start + (times - 1.2)[:, None] * velocity], [radius]) if n >= 12 else ([], [])
        points, read, _ = lidar.read(begin, 0.1, *balls)
        offsets = (read - begin).astype(np.float32)[None]
        result = pipeline.process(points, begin, offsets=offsets)
        for item in result.objects:
            place = start + (result.time - 1.2) * velocity
            assert result.model.to_sensor(item.state.position) == pytest.approx(
                camera.to_optical(place), abs=0.02
            )
            followed += 1
    assert len(result.model.detected) == 2
    assert result.model.translation[2] == pytest.approx(1.2, abs=0.01)
    assert followed >= 8
    assert item.state.linear_velocity == pytest.approx(
        result.model.rotation @ camera.rotation.T @ velocity, abs=0.08
    )
