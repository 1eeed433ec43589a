"""Scenes in which a hand holds a ball, swings it and lets it go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.scenes import true_motion
from intuitive_physics.scene import Environment, Plane
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.corner_room import (
    BALL_RADII,
    ROOM_MATERIAL,
)
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise
from intuitive_physics_experiments.rendering.depth_renderer import (
    DepthImage,
    DepthRenderer,
    ImageRegion,
    cast_sphere,
)
from intuitive_physics_experiments.rendering.thrown_ball import BallMotion

RATES = (30, 60, 90)  # frames a second
CAMERA_NOISE = DepthNoise()  # faults of the camera
# Pixels; with the focal length of a 640 × 480 camera a ball has as many pixels as there
WIDTH, HEIGHT = 432, 336
THROWS_EACH = 4  # throws in a scene; every second hand is seen
FLIGHT = 0.9  # s after the release, bounces among them
SAMPLES = 480  # Hz of the motion after the release: between samples it is off by 6 µm
# s for which the hand rests at first: too short for a track at rest, and long enough
REST = (0.1, 0.8)
SWING = (0.18, 0.45)  # s from rest to the release
PALM = np.array([0.10, 0.09, 0.025])  # (3,) m, edges of the palm, the last along its normal
FOREARM = np.array([0.35, 0.07, 0.06])  # (3,) m, edges of the forearm, which ends at the palm's rim
FOLLOW_THROUGH = 0.07  # s, in which a hand loses its speed after the release
MARGIN = 12.0  # pixels between a ball and the image's edge


@dataclass(frozen=True, eq=False)
class HeldThrow:
    """A ball that a hand holds at rest, swings and releases.

    Before the release its path is a polynomial of the fifth degree from rest: position, velocity
    and acceleration are continuous but for the acceleration at the release.
    """

    radius: float  # m
    hand_is_seen: bool  # whether palm and forearm are in the image
    swing_start: float  # s after the ball appears
    release: float  # s after the ball appears
    # (6, 3) coefficients in m of powers of time over the duration of the swing
    swing: NDArray[np.float64]
    motion: BallMotion  # after the release

    @property
    def duration(self) -> float:
        """s for which the ball is there."""
        return self.release + float(self.motion.times[-1])

    def position(self, time: float) -> NDArray[np.float64]:
        """Return the centre (3,) m in the world."""
        if time < self.release:
            return self._swung(time, 0)
        return self._after(time, self.motion.positions)

    def velocity(self, time: float) -> NDArray[np.float64]:
        """Return the velocity (3,) m/s in the world."""
        if time < self.release:
            return self._swung(time, 1)
        return self._after(time, self.motion.velocities)

    def palm(self, time: float) -> NDArray[np.float64]:
        """Return the centre (3,) m of a ball that stayed in the hand, which follows through."""
        if time < self.release:
            return self._swung(time, 0)
        since = time - self.release
        gone = FOLLOW_THROUGH * (1.0 - np.exp(-since / FOLLOW_THROUGH))
        return self.motion.positions[0] + gone * self.motion.velocities[0]

    def _swung(self, time: float, derivative: int) -> NDArray[np.float64]:
        lasts = self.release - self.swing_start
        part = np.clip((time - self.swing_start) / lasts, 0.0, 1.0)
        coefficients = np.polynomial.polynomial.polyder(self.swing, derivative)
        return np.polynomial.polynomial.polyval(part, coefficients) / lasts**derivative

    def _after(self, time: float, values: NDArray[np.float64]) -> NDArray[np.float64]:
        since = time - self.release
        return np.array([np.interp(since, self.motion.times, column) for column in values.T])


@dataclass(frozen=True, eq=False)
class ReleaseScene:
    """A room, a camera, and balls thrown one after another."""

    camera: Camera
    environment: Environment
    throws: Sequence[HeldThrow]


class SceneView:
    """Ideal depth images of a release scene."""

    def __init__(self, scene: ReleaseScene) -> None:
        self._camera = scene.camera
        self._rays = scene.camera.rays().astype(np.float32)
        self.background = DepthRenderer(scene.camera, scene.environment).background

    def with_throw(self, throw: HeldThrow, time: float) -> tuple[DepthImage, ImageRegion]:
        """Return the rectangle of the image that ball and hand may cover, and where it is."""
        center = throw.position(time)
        boxes = _hand(throw, time) if throw.hand_is_seen else []
        region = self._region(center, throw.radius, boxes)
        inside = (region.rows, region.columns)
        depth = self.background.depth[inside].copy()
        cosine = self.background.incidence_cosine[inside].copy()
        rays = self._rays[inside]
        cast = [cast_sphere(rays, self._camera.to_optical(center), throw.radius)]
        for middle, axes, edges in boxes:
            turned = self._camera.rotation.T @ axes
            cast.append(_cast_box(rays, self._camera.to_optical(middle), turned, edges))
        for part_depth, part_cosine in cast:
            nearer = (part_depth > 0.0) & ((depth == 0.0) | (part_depth < depth))
            depth[nearer], cosine[nearer] = part_depth[nearer], part_cosine[nearer]
        return DepthImage(depth, cosine), region

    def _region(
        self, center: NDArray[np.float64], radius: float, boxes: Sequence[_HandBox]
    ) -> ImageRegion:
        about_ball = (center, np.eye(3), np.full(3, 3.6 * radius))
        corners = [
            middle + axes @ (edges * (np.array(signs) - 0.5))
            for middle, axes, edges in (about_ball, *boxes)
            for signs in np.ndindex(2, 2, 2)
        ]
        pixels = self._camera.project(np.array(corners))
        reach = np.array([np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0)) + 1])
        size = [self._camera.width, self._camera.height]
        (left, top), (right, bottom) = np.clip(reach, 0, size).astype(int)
        return ImageRegion(slice(int(top), int(bottom)), slice(int(left), int(right)))


# Middle (3,) m, axes (3, 3) as columns, and edges (3,) m
_HandBox = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def random_scene(rng: np.random.Generator) -> ReleaseScene:
    """Return a room with a wall ahead, and throws that stay in view."""
    height, tilt = rng.uniform(0.9, 1.3), np.radians(rng.uniform(18.0, 28.0))
    position = np.array([0.0, 0.0, height])
    ahead = np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    camera = Camera.looking_at(position, position + ahead, width=WIDTH, height=HEIGHT)
    environment = Environment(
        [
            Plane("floor", ROOM_MATERIAL, (0.0, 0.0, 1.0), 0.0),
            Plane("wall", ROOM_MATERIAL, (-1.0, 0.0, 0.0), -rng.uniform(3.0, 3.6)),
        ]
    )
    materials = list(BALL_RADII)
    throws = [
        _random_throw(materials[int(rng.integers(3))], bool(k % 2), camera, environment, rng)
        for k in range(THROWS_EACH)
    ]
    return ReleaseScene(camera, environment, throws)


def _random_throw(
    material: str,
    hand_is_seen: bool,
    camera: Camera,
    environment: Environment,
    rng: np.random.Generator,
) -> HeldThrow:
    while True:
        distance = rng.uniform(1.5, 2.4)
        start = np.array([distance, rng.uniform(-0.6, 0.6), rng.uniform(0.45, 1.0)])
        velocity = np.array([rng.uniform(-0.4, 0.4), -np.sign(start[1]), rng.uniform(-0.2, 1.8)])
        velocity[1] *= rng.uniform(0.4, 1.8)
        if np.linalg.norm(velocity) < 1.2:
            continue
        swing_start = rng.uniform(*REST)
        release = swing_start + rng.uniform(*SWING)
        swing = _swing(start, velocity, release - swing_start, rng)
        state = ObjectState(
            start, linear_velocity=velocity, angular_velocity=rng.normal(0.0, 2.0, size=3)
        )
        motion = true_motion(material, environment, state, FLIGHT, SAMPLES)
        throw = HeldThrow(BALL_RADII[material], hand_is_seen, swing_start, release, swing, motion)
        if _stays_in_view(throw, camera):
            return throw


def _swing(
    place: NDArray[np.float64],
    velocity: NDArray[np.float64],
    lasts: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Coefficients (6, 3) of a swing that ends at a place with a velocity, still accelerating."""
    way = rng.uniform(0.3, 0.6) * lasts * velocity + rng.normal(0.0, 0.04, size=3)
    acceleration = rng.uniform(0.0, 1.5) / lasts * velocity + rng.normal(0.0, 2.0, size=3)
    # Powers 3 to 5 meet position, velocity and acceleration at the end; 0 to 2 are rest.
    ends = np.array([[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]])
    wanted = np.stack([way, velocity * lasts, acceleration * lasts**2])
    coefficients = np.zeros((6, 3))
    coefficients[0] = place - way
    coefficients[3:] = np.linalg.solve(ends, wanted)
    return coefficients


def _stays_in_view(throw: HeldThrow, camera: Camera) -> bool:
    times = np.arange(0.0, throw.duration, 1.0 / 120.0)
    places = np.array([throw.position(float(time)) for time in times])
    depth = camera.to_optical(places)[:, 2]
    if depth.min() < 1.0 or depth.max() > 2.9 or places[:, 2].min() < throw.radius - 0.005:
        return False
    pixels = camera.project(places)
    reach = (camera.focal_length * throw.radius / depth + MARGIN)[:, None]
    size = np.array([camera.width, camera.height])
    return bool(((pixels > reach) & (pixels < size - reach)).all())


def _hand(throw: HeldThrow, time: float) -> list[_HandBox]:
    """Palm behind the ball as it is thrown, and a forearm that hangs from the palm's rim."""
    heading = throw.motion.velocities[0] / np.linalg.norm(throw.motion.velocities[0])
    down = np.array([0.0, 0.0, -1.0])
    along = down - (down @ heading) * heading
    length = float(np.linalg.norm(along))
    along = along / length if length > 0.1 else np.array([1.0, 0.0, 0.0])
    axes = np.column_stack([along, np.cross(heading, along), heading])
    palm = throw.palm(time) - (throw.radius + 0.5 * PALM[2]) * heading
    arm = palm + 0.5 * (PALM[0] + FOREARM[0]) * along
    return [(palm, axes, PALM), (arm, axes, FOREARM)]


def _cast_box(
    rays: NDArray[np.float32],
    center: NDArray[np.float64],
    axes: NDArray[np.float64],
    edges: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Depth (m, 0: missed) and cosine of incidence of rays (…, 3) on a box, in camera axes."""
    directions, origin = rays @ axes, -center @ axes
    with np.errstate(divide="ignore"):
        near = (-np.sign(directions) * 0.5 * edges - origin) / directions
        far = (np.sign(directions) * 0.5 * edges - origin) / directions
    enter, leave = near.max(axis=-1), far.min(axis=-1)
    face = near.argmax(axis=-1)
    along = np.take_along_axis(directions, face[..., None], axis=-1)[..., 0]
    cosine = np.abs(along) / np.linalg.norm(directions, axis=-1)
    depth = np.where((enter < leave) & (enter > 0.0), enter, 0.0)
    return depth.astype(np.float32), cosine.astype(np.float32)
