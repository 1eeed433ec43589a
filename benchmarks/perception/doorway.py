"""Balls beyond a doorway under a lintel: the wall's convex hull would hide them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import PerceptionRun, detected_balls
from benchmarks.results.result import Column, Table
from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.corner_room import BALL_RADII, ROOM_MATERIAL
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise, NoisyDepthCamera
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import points_from_depth

SEED = 47  # of the rooms, each of which has a generator of its own
ROOMS, QUICK_ROOMS = 20, 2
FRAMES, LOOKED_AT = 4, 2  # with a ball that rests, and how many of the last ones have to show it
THICKNESS = 0.12  # of the wall, m
FRAME_TIME = 1.0 / 30.0  # s


def measure_doorway(quick: bool) -> Outcome:
    """Measure one ball in each of some rooms, beyond a doorway whose lintel is in view."""
    rooms = QUICK_ROOMS if quick else ROOMS
    found, parts = [], []
    for k in range(rooms):
        report_progress(f"doorway {k + 1} of {rooms}")
        seen, count = _perceive(np.random.default_rng([SEED, k]))
        found.append(seen)
        parts.append(count)
    table = Table(
        title="Balls beyond a doorway",
        note="A wall at 2 to 2.8 m with a doorway, its lintel in view; one ball of 5 or 7 cm "
        "radius at rest in the room beyond it, 1 m farther at most.",
        columns=[Column("rooms"), Column("found"), Column("parts of the wall, median")],
        rows=[[rooms, sum(found), float(np.median(parts))]],
        remarks=[f"Found: in each of the last {LOOKED_AT} of {FRAMES} frames with the ball."],
    )
    return Outcome([table], {"doorway_found": f"{sum(found)} of {rooms}"})


def _perceive(rng: np.random.Generator) -> tuple[bool, int]:
    """Whether the ball of one room is found, and the parts of the wall."""
    distance, left = rng.uniform(2.0, 2.8), rng.uniform(-0.7, -0.2)
    jambs = (left, left + rng.uniform(0.7, 1.0))
    camera, wall = _camera(rng), _wall(distance, jambs, rng.uniform(1.2, 1.5))
    floor = Plane("floor", ROOM_MATERIAL, (0.0, 0.0, 1.0), 0.0)
    back = Plane("back", ROOM_MATERIAL, (-1.0, 0.0, 0.0), -distance - rng.uniform(1.2, 2.0))
    renderer = DepthRenderer(camera, Environment([floor, back], wall))
    radius = float(rng.choice(sorted(BALL_RADII.values())[1:]))
    # On the line of sight through the doorway, so that no jamb hides it.
    beyond = distance + THICKNESS + rng.uniform(0.3, 1.0)
    across = rng.uniform(jambs[0] + 0.15, jambs[1] - 0.15) * beyond / distance
    center = np.array([beyond, across, radius + rng.uniform(0.0, 0.4)])
    run, rays = PerceptionRun(), Intrinsics(camera.width, camera.height, camera.matrix()).rays()
    source = NoisyDepthCamera(renderer.background, camera.focal_length, DepthNoise(), rng)
    ball = renderer.render_balls([center], [radius])
    hits = []
    for k in range(run.settings.environment_frames + FRAMES):
        shown = (ball.image, ball.region) if k >= run.settings.environment_frames else ()
        result = run.process(points_from_depth(source.read(*shown), rays), k * FRAME_TIME)
        hits.append(_shows(detected_balls(result), camera.to_optical(center), radius))
    walls = [p for p in run.model.environment.planes if abs(p.offset + distance) < 0.05]
    return all(hits[-LOOKED_AT:]), len(walls)


def _camera(rng: np.random.Generator) -> Camera:
    """A camera that looks ahead along x and a little down."""
    position = np.array([0.0, 0.0, rng.uniform(0.8, 1.1)])
    tilt = np.radians(rng.uniform(4.0, 10.0))
    ahead = np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    return Camera.looking_at(position, position + ahead)


def _wall(distance: float, jambs: tuple[float, float], lintel: float) -> list[StaticBox]:
    """The parts of a wall around a doorway from the floor to a lintel, its front at a distance."""
    (left, right), end, top = jambs, 4.0, 3.0
    rectangles = {
        "left": (left - end, left, 0.0, top),
        "right": (right, right + end, 0.0, top),
        "lintel": (left, right, lintel, top),
    }
    return [
        StaticBox(
            f"wall/{name}",
            ROOM_MATERIAL,
            (distance + 0.5 * THICKNESS, 0.5 * (a + b), 0.5 * (low + high)),
            (0.0, 0.0, 0.0, 1.0),
            (THICKNESS, b - a, high - low),
        )
        for name, (a, b, low, high) in rectangles.items()
    ]


def _shows(
    balls: list[tuple[NDArray[np.float64], float]], center: NDArray[np.float64], radius: float
) -> bool:
    """Whether one of some spheres, centre (3,) m and radius, is the ball."""
    return any(np.linalg.norm(place - center) < radius for place, _ in balls)
