"""Scenes for perception: planes, crates, a tilted camera, one to three balls at once."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.corner_room import (
    BALL_RADII,
    ROOM_MATERIAL,
    true_parameters,
)
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.rendered_bag import START_TIME
from intuitive_physics_experiments.rendering.thrown_ball import BallContact, BallMotion, move_ball
from intuitive_physics_experiments.rendering.throws import Throw

NEAREST, FARTHEST = 1.0, 3.0  # m from the camera to a ball's centre
STEEPEST, FLATTEST = 40.0, 15.0  # degrees that the camera looks down
ROLL = 5.0  # degrees, standard deviation, by which the camera is not upright
# s before the first throw, of a throw at most, and between throws
LEAD_IN, DURATION, PAUSE = 0.5, 1.5, 0.4
SHORTEST = 0.7  # s that a ball must stay in view
STAGGER = 0.25  # s by which the balls of a group start one after the other, at most
GAP = 0.01  # m that a ball keeps from planes at its release, from crates and from other balls
FLOOR_LEAD = 1.05  # times the readings of any wall that the floor must have
LEAST_WALL = 0.02  # part of the readings that a wall must have to be one that can be seen


@dataclass(frozen=True)
class SceneKind:
    """What a scene has."""

    planes: int  # 1 to 3, the floor among them
    balls_at_once: int  # 1 to 3
    throws: int  # in all
    crates: int  # static boxes in view; no ball ever touches one


def random_truth(kind: SceneKind, rng: np.random.Generator) -> GroundTruth:
    """Return a scene whose floor has the most readings, as Sec. VI-B assumes, and its throws."""
    while True:
        camera, room = _random_camera(rng), _random_room(kind.planes, rng)
        crates = [_random_crate(k, rng) for k in range(kind.crates)]
        environment = Environment(room.planes, crates, room.gravity)
        if _floor_is_largest(camera, environment) and all(
            _stands_in_view(crate, camera, environment) for crate in crates
        ):
            break
    throws: list[Throw] = []
    start = LEAD_IN
    while len(throws) < kind.throws:
        count = min(kind.balls_at_once, kind.throws - len(throws))
        group = _random_group(count, len(throws), start, camera, environment, rng)
        throws += group
        start = max(throw.end_time for throw in group) + PAUSE
    return GroundTruth({}, START_TIME, camera, environment, true_parameters(), tuple(throws))


def first_bounce(throw: Throw, environment: Environment) -> float | None:
    """Return the time in s after a throw's start when it first meets a plane, None if it never
    does: the first sample whose velocity changed by more than gravity can."""
    motion = throw.motion
    steps = np.diff(motion.times)[:, None]
    surprise = np.diff(motion.velocities, axis=0) - environment.gravity * steps
    met = np.flatnonzero(np.linalg.norm(surprise, axis=1) > 0.05)
    return float(motion.times[met[0]]) if met.size else None


def true_motion(
    material: str,
    environment: Environment,
    start: ObjectState,
    duration: float,
    sample_rate: int = 120,
) -> BallMotion:
    """Return the motion (sampled in Hz) of a ball with the true parameters, for some seconds."""
    parameters = true_parameters()
    pair = parameters.pair(material, ROOM_MATERIAL)
    contact = BallContact(pair["static_friction"], pair["rolling_friction"], pair["restitution"])
    density = float(parameters.density[parameters.index(material)])
    radius = BALL_RADII[material]
    return move_ball(environment, radius, density, contact, start, duration, sample_rate)


def _random_camera(rng: np.random.Generator) -> Camera:
    tilt = np.radians(rng.uniform(FLATTEST, STEEPEST))
    position = np.array([0.0, 0.0, rng.uniform(0.7, 1.4)])
    camera = Camera.looking_at(position, position + [np.cos(tilt), 0.0, -np.sin(tilt)])
    roll = Rotation.from_euler("z", rng.normal(0.0, ROLL), degrees=True).as_matrix()
    return Camera(
        camera.width, camera.height, camera.focal_length, position, camera.rotation @ roll
    )


def _random_room(planes: int, rng: np.random.Generator) -> Environment:
    """Floor z = 0; a wall ahead, turned at random; a wall beside it at a right angle."""
    turn = rng.uniform(-0.5, 0.5)
    ahead = np.array([np.cos(turn), np.sin(turn), 0.0])
    beside = rng.choice([-1.0, 1.0]) * np.array([-np.sin(turn), np.cos(turn), 0.0])
    floor = Plane("floor", ROOM_MATERIAL, (0.0, 0.0, 1.0), 0.0)
    walls = [
        Plane("wall_ahead", ROOM_MATERIAL, -ahead, -rng.uniform(2.3, 3.3)),
        Plane("wall_beside", ROOM_MATERIAL, -beside, -rng.uniform(0.7, 1.4)),
    ]
    return Environment([floor, *walls[: planes - 1]])


def _random_crate(number: int, rng: np.random.Generator) -> StaticBox:
    edges = rng.uniform(0.1, 0.35, 3)
    place = rng.uniform([0.9, -0.9], [2.4, 0.9])
    turn = Rotation.from_euler("z", rng.uniform(0.0, np.pi)).as_quat()
    center = np.append(place, 0.5 * edges[2])
    return StaticBox(f"crate_{number}", ROOM_MATERIAL, center, turn, edges)


def _stands_in_view(crate: StaticBox, camera: Camera, environment: Environment) -> bool:
    reach = 0.5 * float(np.linalg.norm(crate.edge_lengths[:2]))
    walls = environment.planes[1:]
    pixel = camera.project(crate.center)
    return all(wall.signed_distances(crate.center) > reach for wall in walls) and bool(
        ((pixel > 0.0) & (pixel < [camera.width, camera.height])).all()
    )


def _distance_from(crate: StaticBox, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """m from places (n, 3) to the surface of a box; zero inside."""
    local = np.abs((places - crate.center) @ rotation_matrix(crate.orientation))
    return np.linalg.norm(np.maximum(local - 0.5 * crate.edge_lengths, 0.0), axis=1)


def _floor_is_largest(camera: Camera, environment: Environment) -> bool:
    depth = DepthRenderer(camera, environment).background.depth
    is_hit = depth > 0.0
    points = camera.rays()[is_hit] * depth[is_hit][:, None] @ camera.rotation.T + camera.position
    floor, *walls = [
        (np.abs(plane.signed_distances(points)) < 1e-3).mean() for plane in environment.planes
    ]
    return all(floor > FLOOR_LEAD * wall and wall > LEAST_WALL for wall in walls)


def _random_group(
    count: int,
    first: int,
    start: float,
    camera: Camera,
    environment: Environment,
    rng: np.random.Generator,
) -> list[Throw]:
    """Throws that begin about the same time and whose balls never touch one another."""
    while True:
        materials = [list(BALL_RADII)[(first + k) % len(BALL_RADII)] for k in range(count)]
        group = [
            Throw(
                material,
                BALL_RADII[material],
                start + rng.uniform(0.0, STAGGER),
                _random_motion(material, camera, environment, rng),
            )
            for material in materials
        ]
        if all(_apart(a, b) for a, b in combinations(group, 2)):
            return group


def _apart(a: Throw, b: Throw) -> bool:
    times = np.arange(max(a.start_time, b.start_time), min(a.end_time, b.end_time), 1.0 / 120.0)
    distances = np.linalg.norm(a.positions_at(times) - b.positions_at(times), axis=1)
    return bool((distances > a.radius + b.radius + GAP).all())


def _random_motion(
    material: str,
    camera: Camera,
    environment: Environment,
    rng: np.random.Generator,
) -> BallMotion:
    """Motion until the ball leaves the distances or the view; it may be half out of the view."""
    radius = BALL_RADII[material]
    room = Environment(environment.planes, gravity=environment.gravity)
    while True:
        start = _random_release(camera, rng)
        if any(p.signed_distances(start.position) < radius + GAP for p in environment.planes):
            continue
        motion = true_motion(material, room, start, DURATION)
        kept = _length_in_view(camera, motion.positions)
        if any(
            (_distance_from(c, motion.positions) < radius + GAP).any() for c in environment.boxes
        ):
            continue
        if motion.times[max(kept - 1, 0)] >= SHORTEST:
            return BallMotion(
                motion.times[:kept],
                motion.positions[:kept],
                motion.velocities[:kept],
                motion.angular_velocities[:kept],
            )


def _random_release(camera: Camera, rng: np.random.Generator) -> ObjectState:
    """A place in view and a velocity that mostly goes across it or away from the camera."""
    pixel = rng.uniform([80.0, 40.0], [camera.width - 80.0, camera.height - 120.0])
    ray = np.append((pixel - camera.principal_point) / camera.focal_length, 1.0)
    distance = rng.uniform(NEAREST + 0.1, FARTHEST - 0.3)
    position = camera.position + camera.rotation @ ray * (distance / np.linalg.norm(ray))
    velocity = rng.normal([0.3, 0.0, 0.5], [0.7, 0.7, 0.9])
    return ObjectState(
        position, linear_velocity=velocity, angular_velocity=rng.normal(0.0, 2.0, size=3)
    )


def _length_in_view(camera: Camera, positions: NDArray[np.float64]) -> int:
    """How many samples from the first on are at a distance asked for, the centre in the image."""
    distance = np.linalg.norm(positions - camera.position, axis=1)
    pixels = camera.project(positions)
    size = np.array([camera.width, camera.height])
    good = (distance >= NEAREST) & (distance <= FARTHEST)
    good &= ((pixels > 0.0) & (pixels < size - 1.0)).all(axis=1)
    return int(np.argmin(good)) if not good.all() else len(good)
