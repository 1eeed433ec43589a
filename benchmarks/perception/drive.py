"""A camera that drives slowly past a ball that lies there from the start, with exact poses, and
without any."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import PerceptionRun, tracked_spheres
from benchmarks.results.result import Column, Table
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise, NoisyDepthCamera
from intuitive_physics_experiments.rendering.depth_renderer import DepthImage, DepthRenderer
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 39  # of the noise
DURATION = 2.0  # s of driving
SPEEDS = (
    (0.05, 30.0),
    (0.15, 30.0),
    (0.3, 30.0),
    (0.15, 90.0),
    (0.5, 90.0),
)  # m/s, frames a second
SPEEDS_WITHOUT_POSE = ((0.05, 30.0), (0.15, 30.0), (0.3, 30.0), (0.5, 30.0))
BALL, RADIUS = np.array([1.8, 0.2, 0.05]), 0.05  # m, where it rests, and its size
ROOM = Environment(
    planes=(
        Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0),
        Plane("wall", "wall", (-1.0, 0.0, 0.0), -3.5),
    ),
    boxes=(
        StaticBox("low", "box", (2.35, -0.45, 0.15), (0.0, 0.0, 0.0, 1.0), (0.3, 0.3, 0.3)),
        StaticBox("high", "box", (2.9, 0.65, 0.25), (0.0, 0.0, 0.0, 1.0), (0.2, 0.5, 0.5)),
    ),
)
SHOWN = 5  # frames between those that the environment is modelled from and the drive
CAMERA = Camera.looking_at((0.0, 0.0, 1.2), (2.0, 0.0, 0.27))


@dataclass(frozen=True)
class Drive:
    """What perception made of one drive."""

    speed: float  # m/s
    rate: float  # frames a second
    frames: int
    found: int  # frames in which the ball was published near where it rests
    tracks: int  # names under which balls were published
    models: int  # environments that were modelled anew while driving
    worst: float  # s of the thread for a frame


def measure_drive(quick: bool) -> Outcome:
    """Measure all speeds; the worst of them is the key figure."""
    kinds = {"slow_drive": SPEEDS, "slow_drive_without_pose": SPEEDS_WITHOUT_POSE}
    tables, figures = [], {}
    for kind, speeds in kinds.items():
        drives = []
        is_posed = kind == "slow_drive"
        for speed, rate in speeds[:2] if quick else speeds:
            posed = "" if is_posed else " without poses"
            report_progress(f"slow drive at {speed} m/s, {rate:g} frames a second{posed}")
            drives.append(_drive(speed, rate, is_posed))
        tables.append(_table(drives, is_posed))
        figures[kind] = _figures(drives)
    return Outcome(tables, figures)


def _figures(drives: list[Drive]) -> dict[str, Any]:
    found = min(drive.found / drive.frames for drive in drives)
    return {
        "found": f"{round(60.0 * found)} of 60",
        "models": max(drive.models for drive in drives),
        "worst_ms": float(f"{1e3 * max(drive.worst for drive in drives):.4g}"),
    }


def _drive(speed: float, rate: float, is_posed: bool) -> Drive:
    with ThreadPoolExecutor(1) as background:
        run = PerceptionRun(background=background)
        still = PerceptionSettings().environment_frames + SHOWN
        found, models, names, shown = 0, 0, set(), 0
        for k, (camera, points) in enumerate(_frames(speed, rate, still)):
            pose = RigidTransform(camera.position, Rotation.from_matrix(camera.rotation).as_quat())
            result = run.process(points, k / rate, pose=pose if is_posed else None)
            if k < still:
                before = len(run.seconds)
                # From the environment's frame, which stays where it was modelled.
                if result.is_new_model and result.model is not None:
                    to_world = pose.after(result.model.sensor_pose.inverse)
                continue
            shown += 1
            models += result.is_new_model
            for item in tracked_spheres(result):
                names.add(item.object.id)
                place = to_world.points(item.state.position)
                found += bool(np.linalg.norm(place - BALL) < RADIUS)
    return Drive(speed, rate, shown, found, len(names), models, max(run.seconds[before:]))


def _frames(speed: float, rate: float, still: int) -> Iterator[tuple[Camera, NDArray[np.float32]]]:
    """Cameras, which stand for some frames and then drive to their left, with what they read."""
    rng = np.random.default_rng(SEED)
    for k in range(still + round(DURATION * rate)):
        way = max(k + 1 - still, 0) * speed / rate
        camera = replace(CAMERA, position=CAMERA.position + np.array([0.0, way, 0.0]))
        renderer = DepthRenderer(camera, ROOM)
        noisy = NoisyDepthCamera(_with_ball(renderer), camera.focal_length, DepthNoise(), rng)
        depth = 0.001 * noisy.read().astype(np.float32)
        depth[depth == 0.0] = np.nan
        yield camera, camera.rays().astype(np.float32) * depth[:, :, None]


def _with_ball(renderer: DepthRenderer) -> DepthImage:
    """What an ideal camera sees of the room with the ball."""
    ball = renderer.render_balls([BALL], [RADIUS])
    background = renderer.background
    depth, cosine = background.depth.copy(), background.incidence_cosine.copy()
    inside = (ball.region.rows, ball.region.columns)
    depth[inside], cosine[inside] = ball.image.depth, ball.image.incidence_cosine
    return DepthImage(depth, cosine)


def _table(drives: list[Drive], is_posed: bool) -> Table:
    return Table(
        title=f"Slow drive past a ball at rest{'' if is_posed else ', without poses'}",
        note=f"{'Exact' if is_posed else 'No'} poses; a live pipeline; time of its thread, kernels "
        "loaded before.",
        columns=[
            Column("speed", "m/s", ".2f"),
            Column("frames a second", "", ".0f"),
            Column("frames"),
            Column("ball published"),
            Column("names"),
            Column("new models"),
            Column("worst frame", "ms", ".1f"),
        ],
        rows=[
            [d.speed, d.rate, d.frames, d.found, d.tracks, d.models, 1e3 * d.worst] for d in drives
        ],
    )
