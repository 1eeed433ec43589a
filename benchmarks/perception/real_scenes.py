"""Real depth frames without a ball, and balls rendered into them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.perception.truth import TrueBall
from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise, NoisyDepthCamera
from intuitive_physics_experiments.rendering.depth_renderer import (
    DepthImage,
    ImageRegion,
    cast_sphere,
)
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.settings import PerceptionSettings

RADII = (0.03, 0.05, 0.07)  # m, of the balls
NEAREST, FARTHEST = 0.45, 3.2  # m, range of the balls' centres
# Least and largest distance, in radii, from a ball to the nearest reading of the scene
FREE_GAP, CLOSE_GAP = (2.0, 6.0), (0.1, 1.0)
NO_EDGE_FAULTS = DepthNoise()  # faults of the camera without those at edges
# Faults of the camera for every second placement of balls
EDGE_FAULTS = DepthNoise(fattening=1, flying=0.25)
FRAME_TIME = 1.0 / 30.0  # s
GRAVITY = 9.81  # m/s², of throws
# Random places that are tried for a ball before a scene counts as having no room for it
ATTEMPTS = 400


@dataclass(frozen=True)
class PlacedBall:
    """A ball in a scene: centre (3,) m in the sensor's frame, radius in m."""

    center: NDArray[np.float64]
    radius: float


@dataclass(frozen=True, eq=False)
class RealScene:
    """A depth frame that shows no ball."""

    name: str  # of its file
    depth: NDArray[np.float32]  # (height, width) m, 0 where nothing was read
    intrinsics: NDArray[np.float64]  # (3, 3) of the pinhole camera, pixels

    @property
    def tuning(self) -> bool:
        """Whether it is of the half that may be tuned on; the other half is only reported."""
        return hashlib.sha256(self.name.encode()).digest()[0] % 2 == 0

    @cached_property
    def rays(self) -> NDArray[np.float32]:
        """Directions (height, width, 3) of the pixels, z = 1."""
        height, width = self.depth.shape
        v, u = np.mgrid[:height, :width]
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1)
        return np.asarray(pixels @ np.linalg.inv(self.intrinsics).T, dtype=np.float32)

    @cached_property
    def surface(self) -> cKDTree:
        """Every second reading of the scene in both directions, to measure distances from."""
        part = (slice(None, None, 2), slice(None, None, 2))
        points = self.rays[part] * self.depth[part][..., None]
        return cKDTree(points[self.depth[part] > 0.0])

    @cached_property
    def gravity(self) -> NDArray[np.float64]:
        """Gravity (3,) m/s² in the sensor's frame, from what the scene stands on.

        If balls fell in another direction, perception would conclude from their flights that it
        has the wrong support, and would restart with a new model of the environment.
        """
        frame = self.points(np.round(1000.0 * self.depth).astype(np.uint16))
        model = model_environment([frame], PerceptionSettings(), np.random.default_rng(0))
        return -GRAVITY * model.rotation[2]

    def gap(self, ball: PlacedBall) -> float:
        """Return the distance from a ball to the nearest reading, in its radii."""
        return float(self.surface.query(ball.center)[0]) / ball.radius - 1.0

    def points(self, millimetres: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Return the points (height, width, 3) m of an image in mm, NaN where nothing was read."""
        depth = np.where(millimetres > 0, 0.001 * millimetres, np.nan).astype(np.float32)
        return self.rays * depth[..., None]


def load_scenes(folder: Path) -> list[RealScene]:
    """Return the scenes of a folder by name; none where there is no such folder."""
    scenes = []
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as data:
            if "depth" not in data or "K" not in data:
                raise InvalidInputError(
                    f"{path} has {', '.join(data.files)}; expected depth (height, width) uint16 mm "
                    "and K (3, 3)"
                )
            depth = (0.001 * data["depth"]).astype(np.float32)
            scenes.append(RealScene(path.stem, depth, data["K"].astype(np.float64)))
    return scenes


class SceneCamera:
    """A camera that takes noisy frames of one scene with balls in it."""

    def __init__(self, scene: RealScene, noise: DepthNoise, rng: np.random.Generator) -> None:
        self.scene = scene
        self._image = DepthImage(scene.depth, np.ones_like(scene.depth))
        self._camera = NoisyDepthCamera(
            self._image, float(np.mean(np.diag(scene.intrinsics)[:2])), noise, rng
        )

    def read(self, balls: Sequence[PlacedBall] = ()) -> tuple[NDArray[np.float32], list[TrueBall]]:
        """Return a frame of points (height, width, 3) m, and the balls with their visible
        pixels."""
        if not balls:
            return self.scene.points(self._camera.read()), []
        image, owner = rendered(self.scene, balls)
        rows, columns = (np.flatnonzero((owner >= 0).any(axis=axis)) for axis in (1, 0))
        region = ImageRegion(
            slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
        )
        inside = (region.rows, region.columns)
        part = DepthImage(image.depth[inside], image.incidence_cosine[inside])
        truth = [
            TrueBall(k, ball.center, np.zeros(3), ball.radius, int((owner == k).sum()), None)
            for k, ball in enumerate(balls)
        ]
        return self.scene.points(self._camera.read(part, region)), truth


def rendered(scene: RealScene, balls: Sequence[PlacedBall]) -> tuple[DepthImage, NDArray[np.int16]]:
    """Return the ideal image of a scene with balls, and by pixel the number of the ball that is
    seen there, -1 for none."""
    depth, cosine = scene.depth.copy(), np.ones_like(scene.depth)
    owner = np.full(depth.shape, -1, dtype=np.int16)
    for k, ball in enumerate(balls):
        inside = _window(scene, ball)
        cast, incidence = cast_sphere(scene.rays[inside], ball.center, ball.radius)
        nearer = (cast > 0.0) & ((depth[inside] == 0.0) | (cast < depth[inside]))
        depth[inside][nearer] = cast[nearer]
        cosine[inside][nearer] = incidence[nearer]
        owner[inside][nearer] = k
    return DepthImage(depth, cosine), owner


def place_ball(
    scene: RealScene, gap: tuple[float, float], rng: np.random.Generator
) -> PlacedBall | None:
    """Return a ball in full view whose distance to the nearest reading, in radii, lies in `gap`;
    None where there is no room for it."""
    height, width = scene.depth.shape
    for _ in range(ATTEMPTS):
        radius = float(rng.choice(RADII))
        row = int(rng.integers(height // 10, height - height // 10))
        column = int(rng.integers(width // 10, width - width // 10))
        behind = float(scene.depth[row, column])
        if behind == 0.0:
            continue
        ray = scene.rays[row, column].astype(np.float64)
        wanted = rng.uniform(*gap)
        depth = min(behind, FARTHEST)
        while depth > NEAREST:
            ball = PlacedBall(depth * ray, radius)
            ball_gap = scene.gap(ball)
            if ball_gap >= wanted:
                if ball_gap <= gap[1] and is_in_view(scene, [ball], 0.95):
                    return ball
                break
            depth -= max(0.5 * (wanted - ball_gap) * radius, 0.02 * radius)
    return None


def place_touching_balls(scene: RealScene, rng: np.random.Generator) -> list[PlacedBall]:
    """Return two balls of one size that touch each other and nothing else, side by side as the
    camera sees them, give or take 30°; none where there is no room."""
    for _ in range(ATTEMPTS // 10):
        first = place_ball(scene, (1.0, 8.0), rng)
        if first is None:
            return []
        toward = first.center / np.linalg.norm(first.center)
        across = rng.normal(size=3)
        across -= across @ toward * toward
        across /= np.linalg.norm(across)
        turned = rng.uniform(-1.0, 1.0) * np.radians(30.0)
        direction = np.cos(turned) * across + np.sin(turned) * toward
        second = PlacedBall(first.center + 2.0 * first.radius * direction, first.radius)
        if scene.gap(second) > 1.0 and is_in_view(scene, [first, second], 0.6):
            return [first, second]
    return []


def throw_ball(scene: RealScene, rng: np.random.Generator, most: int) -> list[PlacedBall]:
    """Return the places, 1/30 s apart, of a ball that flies until it is near a reading, leaves the
    image or is hidden; at most `most`."""
    start = place_ball(scene, FREE_GAP, rng)
    if start is None:
        return []
    velocity = rng.normal([0.0, -1.2, 0.0], [0.9, 0.4, 0.5])
    flight = []
    for k in range(most):
        time = k * FRAME_TIME
        ball = PlacedBall(
            start.center + time * velocity + 0.5 * time**2 * scene.gravity, start.radius
        )
        if not _in_range(ball) or scene.gap(ball) < 1.0 or not is_in_view(scene, [ball], 0.95):
            break
        flight.append(ball)
    return flight


def is_in_view(scene: RealScene, balls: Sequence[PlacedBall], part: float) -> bool:
    """Return whether the image shows at least a part of the outline of each ball."""
    if not all(_in_range(ball) for ball in balls):
        return False
    _, owner = rendered(scene, balls)
    focal = scene.intrinsics[0, 0] * scene.intrinsics[1, 1]
    whole = [np.pi * focal * (ball.radius / ball.center[2]) ** 2 for ball in balls]
    return all((owner == k).sum() >= part * area for k, area in enumerate(whole))


def _in_range(ball: PlacedBall) -> bool:
    return bool(ball.center[2] > NEAREST and np.linalg.norm(ball.center) < FARTHEST + 0.3)


def _window(scene: RealScene, ball: PlacedBall) -> tuple[slice, slice]:
    """Rows and columns that hold a ball's outline."""
    height, width = scene.depth.shape
    u, v, _ = scene.intrinsics @ ball.center / ball.center[2]
    reach = 1.3 * max(scene.intrinsics[0, 0], scene.intrinsics[1, 1])
    reach = reach * ball.radius / (ball.center[2] - ball.radius) + 2.0
    rows = np.clip([v - reach, v + reach + 1], 0, height).astype(int)
    columns = np.clip([u - reach, u + reach + 1], 0, width).astype(int)
    return slice(*rows), slice(*columns)
