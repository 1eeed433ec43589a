"""Analytic depth images with a depth camera's faults, made by intersecting rays with shapes."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.environment.environment_model import (
    EnvironmentModel,
    model_environment,
)
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import points_from_depth
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.free_motion import Record

WIDTH, HEIGHT, FOCAL = 640, 480, 525.0

Ball = tuple[Sequence[float], float]


@dataclass
class Room:
    """A floor z = 0 and walls, seen by a camera; world z up, camera's frame x right, y down.

    The camera stands at (0, 0, height), looks along +x and is tilted down by `tilt` degrees, so
    the world is the environment's frame that perception must find.
    """

    tilt: float = 20.0
    height: float = 0.8
    walls: Sequence[tuple[Sequence[float], float]] = (
        ((-1.0, 0.0, 0.0), -3.2),
        ((0.0, -1.0, 0.0), -1.5),
    )
    noise_constant: float = 0.001
    noise_quadratic: float = 0.0014
    faults: bool = True
    width: int = WIDTH
    height_pixels: int = HEIGHT
    focal: float = FOCAL
    seed: int = 0
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        v, u = np.mgrid[: self.height_pixels, : self.width]
        self.matrix = np.array(
            [
                [self.focal, 0.0, (self.width - 1) / 2],
                [0.0, self.focal, (self.height_pixels - 1) / 2],
                [0.0, 0.0, 1.0],
            ]
        )
        rays = np.stack(
            [
                (u - self.matrix[0, 2]) / self.focal,
                (v - self.matrix[1, 2]) / self.focal,
                np.ones(u.shape),
            ],
            axis=-1,
        )
        c, s = np.cos(np.radians(self.tilt)), np.sin(np.radians(self.tilt))
        # Columns: the camera's x, y, z axes in the world.
        self.rotation = np.array([[0.0, -s, c], [-1.0, 0.0, 0.0], [0.0, -c, -s]])
        self.rays = rays @ self.rotation.T
        self.origin = np.array([0.0, 0.0, self.height])

    @property
    def pose(self) -> RigidTransform:
        """Of the camera in the world."""
        return RigidTransform(self.origin, Rotation.from_matrix(self.rotation).as_quat())

    def look_along_minus_y(self, origin: Sequence[float]) -> None:
        """Put the camera, which looks along x, where it sees the room from its side."""
        turn = Rotation.from_euler("z", -90.0, degrees=True).as_matrix()
        self.rotation, self.rays = turn @ self.rotation, self.rays @ turn.T
        self.origin = np.array(origin)

    @cached_property
    def _pixel_rays(self) -> NDArray[np.float32]:
        return Intrinsics(self.width, self.height_pixels, self.matrix).rays()

    def points(
        self, balls: Sequence[Ball] = (), extra: Sequence[object] = ()
    ) -> NDArray[np.float32]:
        """A frame of points (height, width, 3) m in the camera's frame."""
        return points_from_depth(self.depth(balls, extra), self._pixel_rays)

    def to_camera(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return (np.asarray(points) - self.origin) @ self.rotation

    def true_depth(self, balls: Sequence[Ball] = (), extra: Sequence[object] = ()) -> NDArray:
        """Depth along the optical axis, m, and the cosine of incidence, of the nearest surface."""
        depth, cosine = np.full(self.rays.shape[:2], np.inf), np.zeros(self.rays.shape[:2])
        lengths = np.linalg.norm(self.rays, axis=-1)
        for normal, offset in [((0.0, 0.0, 1.0), 0.0), *self.walls]:
            n = np.asarray(normal)
            along = self.rays @ n
            with np.errstate(divide="ignore"):
                t = np.where(along < 0.0, (offset - n @ self.origin) / along, np.inf)
            nearer = (t > 0.0) & (t < depth)
            depth[nearer], cosine[nearer] = t[nearer], (-along / lengths)[nearer]
        for shape in [*(BallShape(*ball) for ball in balls), *extra]:
            t, c = shape.hit(self.origin, self.rays)
            nearer = t < depth
            depth[nearer], cosine[nearer] = t[nearer], c[nearer]
        return depth, cosine

    def depth(self, balls: Sequence[Ball] = (), extra: Sequence[object] = ()) -> NDArray[np.uint16]:
        """A frame in millimetres: noise that grows with range squared, missing readings at edges
        and grazing angles, whole millimetres."""
        depth, cosine = self.true_depth(balls, extra)
        nothing = np.isinf(depth)
        depth[nothing] = 0.0
        if self.faults:
            lengths = np.linalg.norm(self.rays, axis=-1)
            deviation = np.hypot(self.noise_constant, self.noise_quadratic * (depth * lengths) ** 2)
            noisy = depth + self.rng.normal(size=depth.shape) * deviation / lengths
            grazing = np.clip((0.35 - cosine) / 0.35, 0.0, 1.0)
            step = np.zeros(depth.shape)
            for axis in (0, 1):
                difference = np.abs(np.diff(depth, axis=axis))
                pad = [(0, 0), (0, 0)]
                pad[axis] = (0, 1)
                step = np.maximum(step, np.pad(difference, pad))
                pad[axis] = (1, 0)
                step = np.maximum(step, np.pad(difference, pad))
            missing = np.maximum(0.7 * grazing**2, np.where(step > 0.05 * depth, 0.4, 0.002))
            noisy[self.rng.random(depth.shape) < missing] = 0.0
            depth = noisy
        millimetres = np.round(np.where(nothing, 0.0, depth) * 1000.0)
        return np.clip(millimetres, 0, 65535).astype(np.uint16)


def crossings(
    rays: NDArray, relative: NDArray, radius: float
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """|t ray - relative|² = radius²: a, b, discriminant and its root in t = (b ± root) / a."""
    a, b = (rays**2).sum(axis=-1), rays @ relative
    discriminant = b * b - a * (relative @ relative - radius**2)
    return a, b, discriminant, np.sqrt(np.maximum(discriminant, 0.0))


@dataclass
class BallShape:
    center: Sequence[float]
    radius: float

    def hit(self, origin: NDArray, rays: NDArray) -> tuple[NDArray, NDArray]:
        a, b, square, root = crossings(rays, np.asarray(self.center) - origin, self.radius)
        t = np.where((square > 0.0) & (b > root), (b - root) / a, np.inf)
        return t, root / (np.sqrt(a) * self.radius)


@dataclass
class SweptBallShape:
    """A ball that goes straight from `center - sweep / 2` to `center + sweep / 2` in the exposure.

    A pixel reads the mean depth over the time in which it sees the ball, where that is a share of
    the exposure above `least`.
    """

    center: Sequence[float]
    radius: float
    sweep: Sequence[float]
    least: float = 0.0
    instants: int = 33

    def hit(self, origin: NDArray, rays: NDArray) -> tuple[NDArray, NDArray]:
        times = (np.arange(self.instants) + 0.5) / self.instants - 0.5
        total, cosines = np.zeros(rays.shape[:2]), np.zeros(rays.shape[:2])
        count = np.zeros(rays.shape[:2])
        for time in times:
            ball = BallShape(np.asarray(self.center) + time * np.asarray(self.sweep), self.radius)
            t, cosine = ball.hit(origin, rays)
            hit = np.isfinite(t)
            total[hit] += t[hit]
            cosines[hit] += cosine[hit]
            count += hit
        seen = np.maximum(count, 1)
        kept = count > self.least * self.instants
        return np.where(kept, total / seen, np.inf), cosines / seen


@dataclass
class BowlShape:
    """The half of a sphere's inside that opens towards the camera."""

    center: Sequence[float]
    radius: float

    def hit(self, origin: NDArray, rays: NDArray) -> tuple[NDArray, NDArray]:
        a, b, square, root = crossings(rays, np.asarray(self.center) - origin, self.radius)
        return np.where(square > 0.0, (b + root) / a, np.inf), root / (np.sqrt(a) * self.radius)


@dataclass
class CylinderShape:
    """An upright cylinder that stands on the floor."""

    x: float
    y: float
    radius: float
    top: float

    def hit(self, origin: NDArray, rays: NDArray) -> tuple[NDArray, NDArray]:
        axis = np.array([self.x, self.y]) - origin[:2]
        a, b, square, root = crossings(rays[..., :2], axis, self.radius)
        t = (b - root) / np.maximum(a, 1e-12)
        z = origin[2] + t * rays[..., 2]
        good = (square > 0.0) & (t > 0.0) & (z >= 0.0) & (z <= self.top)
        return np.where(good, t, np.inf), root / (np.sqrt(a) * self.radius + 1e-12)


@dataclass
class BoxShape:
    """A box turned about the vertical by an angle, or by any rotation (3, 3) to the world."""

    center: Sequence[float]
    edges: Sequence[float]
    turn: float | NDArray

    def hit(self, origin: NDArray, rays: NDArray) -> tuple[NDArray, NDArray]:
        if isinstance(self.turn, np.ndarray):
            to_box = self.turn.T
        else:
            c, s = np.cos(self.turn), np.sin(self.turn)
            to_box = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        o, d = to_box @ (origin - np.asarray(self.center)), rays @ to_box.T
        half = 0.5 * np.asarray(self.edges)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (-half - o) / d, (half - o) / d
        near, far = np.minimum(first, second), np.maximum(first, second)
        enter, leave = near.max(axis=-1), far.min(axis=-1)
        face = near.argmax(axis=-1)
        cosine = np.abs(np.take_along_axis(d, face[..., None], axis=-1)[..., 0])
        cosine /= np.linalg.norm(d, axis=-1)
        return np.where((enter < leave) & (enter > 0.0), enter, np.inf), cosine


@dataclass
class CapsuleShape:
    """All points nearer than `radius` to the axis from center - half to center + half."""

    center: Sequence[float]
    half: Sequence[float]
    radius: float

    def hit(self, origin: NDArray, rays: NDArray) -> tuple[NDArray, NDArray]:
        center, half = np.asarray(self.center, float), np.asarray(self.half, float)
        ends = [BallShape(center + side * half, self.radius) for side in (-1.0, 1.0)]
        (t, cosine), (other, other_cosine) = (end.hit(origin, rays) for end in ends)
        nearer = other < t
        t, cosine = np.where(nearer, other, t), np.where(nearer, other_cosine, cosine)
        axis = half / np.linalg.norm(half)
        relative = center - origin
        flat = rays - (rays @ axis)[..., None] * axis
        across = relative - (relative @ axis) * axis
        a, b, square, root = crossings(flat, across, self.radius)
        side = (b - root) / np.maximum(a, 1e-12)
        along = (side[..., None] * rays - relative) @ axis
        good = (square > 0.0) & (side > 0.0) & (np.abs(along) <= np.linalg.norm(half)) & (side < t)
        lengths = np.linalg.norm(rays, axis=-1)
        side_cosine = root / (np.sqrt(np.maximum(a, 1e-12)) * self.radius)
        side_cosine *= np.sqrt(a) / lengths
        return np.where(good, side, t), np.where(good, side_cosine, cosine)


WORLD_IN_FIXED = RigidTransform(
    (3.0, -2.0, 0.4), Rotation.from_euler("z", 50, degrees=True).as_quat()
)
"""The frame that stands still is neither the world of the room nor where the sensor starts."""


class Head:
    """A camera in a room that a robot's head carries.

    Parameters
    ----------
    room : as the fixture makes it, whose camera is moved
    """

    def __init__(self, room) -> None:
        self.room = room
        self._first = room.pose
        self._camera_rays = room.rays @ room.rotation

    def go(self, shift, angles) -> RigidTransform:
        """Move the camera from where it began; return its pose in the fixed frame.

        Parameters
        ----------
        shift : (3,) m in the world
        angles : (3,) degrees, about the camera's own axes
        """
        turn = Rotation.from_euler("xyz", angles, degrees=True)
        own = self._first.after(RigidTransform(np.zeros(3), turn.as_quat()))
        pose = RigidTransform(own.translation + shift, own.orientation)
        self.room.rotation, self.room.origin = pose.matrix, pose.translation
        self.room.rays = self._camera_rays @ pose.matrix.T
        return WORLD_IN_FIXED.after(pose)

    def look(self, balls=(), extra=()):
        return self.room.points(balls, extra)


FLOOR = Environment([Plane("floor", "wood", (0.0, 0.0, 1.0), 0.0)])


def seen_sphere(
    rng: np.random.Generator, place: ArrayLike, radius: float, noise: float = 0.001, **more
) -> DetectedSphere:
    """A sphere with the errors of one frame, of one deviation in m in place and radius."""
    error, covariance = noise * rng.normal(size=4), noise**2 * np.eye(4)
    return DetectedSphere(place + error[:3], radius + error[3], covariance, 200, 2.0, **more)


def seen_record(
    rng: np.random.Generator,
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    covariances: NDArray[np.float64],
    name: str = "ball",
) -> Record:
    """Detections (n,) of a ball of 5 cm radius at places (n, 3) m, with errors of their covariances
    (n, 3, 3) m²."""
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=places.shape))
    seen, ball = places + errors, SceneObject(name, "m", Sphere(0.05))
    return Record(ball, times, seen, covariances, np.zeros((3, 3)), None, times, seen)


def waves(seed: int, number: float = 7.0) -> Callable[[NDArray], NDArray]:
    """A smooth random function of unit vectors (..., 3): what is painted on a ball."""
    rng = np.random.default_rng(seed)
    vectors = rng.normal(size=(12, 3))
    vectors *= number / np.linalg.norm(vectors, axis=1, keepdims=True)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(vectors))
    return lambda n: np.cos(n @ vectors.T + phases).sum(axis=-1) / np.sqrt(len(vectors))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def make_room() -> type[Room]:
    return Room


@pytest.fixture(scope="session")
def make_small_room() -> Callable[..., Room]:
    """Rooms whose camera has a quarter of the pixels."""
    return partial(Room, width=320, height_pixels=240, focal=262.0)


@pytest.fixture
def pipeline() -> PerceptionPipeline:
    """A pipeline that models the environment from four frames."""
    return PerceptionPipeline(PerceptionSettings(environment_frames=4), np.random.default_rng(0))


@pytest.fixture
def shapes() -> dict[str, type]:
    return {
        "ball": BallShape,
        "swept": SweptBallShape,
        "bowl": BowlShape,
        "cylinder": CylinderShape,
        "box": BoxShape,
        "capsule": CapsuleShape,
    }


def bouncing_ball(
    times: NDArray[np.float64],
    start: Sequence[float],
    velocity: Sequence[float],
    radius: float,
    restitution: float = 0.7,
) -> NDArray[np.float64]:
    """Positions (n, 3) of a ball over a frictionless floor z = 0: parabolas joined by
    v_z' = -e v_z at z = radius."""
    p, v, now = np.array(start, dtype=float), np.array(velocity, dtype=float), 0.0
    places = []
    for time in times:
        while True:
            fall = (v[2] + np.sqrt(v[2] ** 2 + 2 * 9.81 * max(p[2] - radius, 0.0))) / 9.81
            step = time - now
            if step < fall or fall < 1e-4:
                break
            p = p + v * fall
            p[2], v[2], now = radius, restitution * (9.81 * fall - v[2]), now + fall
        place = p + v * step - np.array([0, 0, 0.5 * 9.81 * step**2])
        place[2] = max(place[2], radius)
        places.append(place)
    return np.array(places)


@pytest.fixture
def bounce() -> Callable[..., NDArray[np.float64]]:
    return bouncing_ball


@pytest.fixture(scope="module")
def corner_model(modelled_corner) -> tuple[Room, EnvironmentModel]:
    """A room and the environment modelled from eight noisy frames of it.

    Each module has noise of its own, whatever ran before it in the same process.
    """
    room, model = modelled_corner
    own = copy.copy(room)
    own.rng = np.random.default_rng(8)
    return own, model


@pytest.fixture(scope="session")
def modelled_corner() -> tuple[Room, EnvironmentModel]:
    room = Room(tilt=25.0, seed=3)
    frames = [room.points() for _ in range(8)]
    return room, model_environment(frames, PerceptionSettings(), np.random.default_rng(1))
