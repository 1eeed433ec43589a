"""A floor that is not flat is modelled as uneven as it is, and objects on it are found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.plane_relief import fitted_relief
from intuitive_physics_perception.environment.range_cloud import RangeCloud
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

SAG = 0.02
"""m by which a floor sags over 2 m, 1 m to each side of its middle."""

MIDDLE = 1.5


def bowl(x, y):
    return SAG * ((x - MIDDLE) ** 2 + y**2)


def grass(height):
    """Blades of 1 cm, evenly from 0 to a height."""
    blades = np.random.default_rng(1).uniform(0.0, height, (600, 600))
    return lambda x, y: blades[(100 * x).astype(int) % 600, (100 * y).astype(int) % 600]


@dataclass
class Ground:
    """A floor of any heights, none below z = 0, where the floor of the room is."""

    heights: object

    def hit(self, origin, rays):
        down = np.where(rays[..., 2] < -0.05, rays[..., 2], np.nan)
        highest, lowest = ((z - origin[2]) / down for z in (0.3, -0.001))
        t = np.full(down.shape, np.inf)
        for part in np.linspace(0.0, 1.0, 600):
            now = highest + part * (lowest - highest)
            places = origin + np.nan_to_num(now)[..., None] * rays
            below = places[..., 2] <= self.heights(places[..., 0], places[..., 1])
            t = np.where(below & np.isinf(t) & np.isfinite(now), now, t)
        return t, -rays[..., 2] / np.linalg.norm(rays, axis=-1)


@dataclass
class Seen:
    """What the rays of a camera that stands still have met."""

    depth: object
    cosine: object

    def hit(self, origin, rays):
        return self.depth, self.cosine


@pytest.fixture(scope="module")
def make_ground(make_small_room):
    """A camera of little noise that looks down on 2 m of ground, and the ground."""

    def make(heights):
        room = make_small_room(tilt=50.0, height=1.5, walls=(), noise_quadratic=0.0004, seed=2)
        return room, Seen(*Ground(heights).hit(room.origin, room.rays))

    return make


GROUNDS = {"bowl": bowl, "grass of 1 cm": grass(0.01), "grass of 2 cm": grass(0.02)}


@pytest.mark.parametrize("heights", GROUNDS.values(), ids=GROUNDS)
def test_uneven_ground_is_no_foreground_and_a_ball_on_it_is_found(make_ground, heights) -> None:
    room, ground = make_ground(heights)
    pipeline = PerceptionPipeline(PerceptionSettings(), np.random.default_rng(0))
    frames, radius, found, followed = 0, 0.06, 0, set()
    for k in range(40):
        x, y = MIDDLE, 0.02 * (k - 30)
        z = float(heights(np.array([x]), np.array([y]))[0]) + radius
        place = np.array([x, y, z])
        balls = [(place, radius)] if k >= 20 else []
        points = room.points(balls=balls, extra=[ground])
        result = pipeline.process(points, k / 30)
        if result.model is None or result.is_new_model:
            continue
        if not balls:
            frames += 1
            clusters = ForegroundFinder(result.model, pipeline.settings).find(points)
            assert clusters.foreground < 1e-3 * clusters.readings
            assert not result.objects
            assert not result.detections
            continue
        followed |= {item.object.id for item in result.objects}
        truth = room.to_camera(place)
        found += any(
            isinstance(detection, DetectedSphere)
            and np.linalg.norm(result.model.to_sensor(detection.center) - truth) < 0.02
            for detection in result.detections
        )
    assert frames > 5
    assert found >= 18
    assert len(followed) == 1


def test_an_organised_and_an_unorganised_frame_have_the_same_foreground(make_ground) -> None:
    room, ground = make_ground(bowl)
    frames = [room.points(extra=[ground]) for _ in range(4)]
    model = model_environment(frames, PerceptionSettings(), np.random.default_rng(0))
    assert model.detected[0].relief is not None
    finder = ForegroundFinder(model, PerceptionSettings())
    ball = ((MIDDLE, 0.0, 0.06), 0.06)
    frame = room.points(balls=[ball], extra=[ground])
    organised = finder.find(frame).foreground
    assert organised == pytest.approx(finder.find(frame.reshape(1, -1, 3)).foreground, abs=5)


def cloud_of(rng, heights, noise=0.001):
    """Readings all over a square of 2 m, 2 m below the sensor, with the floor's normal as z."""
    x, y = rng.uniform(-1.0, 1.0, (2, 8000))
    z = -2.0 + heights(x, y) + noise * rng.normal(size=x.size)
    return RangeCloud.of_scene(
        np.column_stack([x, y, z]), RangeNoise(noise, 0.0, 0.1, 0.0), PerceptionSettings()
    )


def test_the_relief_is_the_polynomial_that_was_read(rng) -> None:
    def heights(x, y):
        return 0.012 * x * x - 0.009 * x * y + 0.004 * y

    cloud = cloud_of(rng, heights)
    plane = np.array([0.0, 0.0, 1.0, -2.0])
    relief, on = fitted_relief(cloud, plane, np.flatnonzero(cloud.near(plane)), [])
    assert on.size > 0.99 * len(cloud.points)
    x, y = rng.uniform(-1.0, 1.0, (2, 200))
    over = relief.heights(np.column_stack([x, y, np.full(200, -2.0)]))
    # Least squares of 6 coefficients: the deviation of a height is about √(6 / n) of the noise.
    assert over == pytest.approx(heights(x, y), abs=6.0 * 0.001 * np.sqrt(6 / 8000))


def test_a_flat_floor_with_things_on_it_has_no_relief(rng) -> None:
    book = cloud_of(rng, lambda x, y: np.where((np.abs(x) < 0.3) & (np.abs(y) < 0.2), 0.03, 0.0))
    plane = np.array([0.0, 0.0, 1.0, -2.0])
    assert fitted_relief(book, plane, np.flatnonzero(book.near(plane)), []) is None
