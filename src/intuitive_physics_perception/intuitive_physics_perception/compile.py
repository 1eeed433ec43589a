"""Compile the kernels ahead of time, so that no frame ever waits for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.kernels.warm_up import WarmUp
from intuitive_physics.scene import StaticBox
from intuitive_physics_perception.appearance.sphere_image import sphere_image
from intuitive_physics_perception.appearance.surface_spin import SurfaceSpin
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.detection.sphere_inspection import SECTORS, outside_in_sectors
from intuitive_physics_perception.detection.swept_sphere import fit_sweep, unswept
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.static_boxes import StaticBoxFilter
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.compressed import unpack_rvl
from intuitive_physics_perception.input.depth import points_from_depth
from intuitive_physics_perception.input.point_cloud import points_of_cloud
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

WIDTH, HEIGHT, FOCAL_LENGTH = 80, 60, 60.0
"""Camera of the frames, in pixels: small, so that only compiling takes time."""

FLOAT32 = 7
"""Datatype of sensor_msgs/PointField."""


def warm_up() -> None:
    """Perceive a ball, followed over two frames, and a box before a wall, as depth images of all
    kinds and as a cloud."""
    rays = Intrinsics(
        WIDTH, HEIGHT, [FOCAL_LENGTH, 0, WIDTH / 2, 0, FOCAL_LENGTH, HEIGHT / 2, 0, 0, 1]
    ).rays()
    wall = np.full((HEIGHT, WIDTH), 2.0, dtype=np.float32)
    # A box is fitted as a solid, which a ball is not.
    box = wall.copy()
    box[20:40, 20:40] = 1.2
    frames = [points_from_depth(depth, rays) for depth in (wall, _with_ball(wall, rays), box)]
    for kind, scale in ((np.uint16, 1000.0), (np.float32, 1.0)):
        points_from_depth((scale * wall).astype(kind), rays)
    pipeline = PerceptionPipeline(
        PerceptionSettings(environment_frames=1), np.random.default_rng(0)
    )
    for k, points in enumerate([*frames[:2], *frames[1:], _as_cloud(frames[1])]):
        pipeline.process(points, 0.1 * k)
    if pipeline.model is not None:
        _leave_out_box(pipeline.model, frames[1])
    _look_from_elsewhere([*frames[:2], *frames[1:]])
    _look_from_elsewhere([_as_cloud(points) for points in (frames[0], *frames)])
    _look_at_ball(frames[1])
    _fit_swept_ball(frames[1])
    # Only what touches a ball calls it.
    outside_in_sectors(_corner(), np.array([0.0, 0.0, 1.5, 0.2]), np.ones(SECTORS, dtype=bool))
    unpack_rvl(np.zeros(1, dtype="<u4"), 1)


def _leave_out_box(model: EnvironmentModel, points: NDArray[np.float32]) -> None:
    """Perceive a frame of an environment with a static box."""
    box = StaticBox("box", "box", np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.ones(3))
    with_box = replace(model, environment=replace(model.environment, boxes=(box,)))
    settings = PerceptionSettings()
    clusters = ForegroundFinder(model, settings).find(points)
    StaticBoxFilter(with_box, settings).without(points, clusters)


def _look_from_elsewhere(frames: Sequence[NDArray[np.float32]]) -> None:
    """Perceive frames of a sensor that has moved after the first one, and that turns back at last,
    where nobody has looked."""
    pipeline = PerceptionPipeline(
        PerceptionSettings(environment_frames=1), np.random.default_rng(0)
    )
    for k, points in enumerate(frames):
        pipeline.process(points, 0.1 * k, pose=RigidTransform((0.1 * k, 0.0, 0.0)))
    back = RigidTransform((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
    pipeline.process(frames[-1], 0.1 * len(frames), pose=back)


def _corner() -> NDArray[np.float64]:
    """Points (300, 3) on three faces of a box."""
    points = np.random.default_rng(0).uniform(0.0, 0.2, (300, 3))
    points[np.arange(300), np.arange(300) % 3] = 0.0
    return np.asarray(points + 1.0)


def _with_ball(depth: NDArray[np.float32], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """Put a ball of 0.2 m radius 1.5 m before the camera: |z ray - c|² = r²."""
    length2 = np.square(rays).sum(axis=-1)
    root = 1.5**2 - length2 * (1.5**2 - 0.2**2)
    ball = (1.5 - np.sqrt(np.maximum(root, 0.0))) / length2
    return np.where(root > 0.0, ball, depth).astype(np.float32)


def _fit_swept_ball(points: NDArray[np.float32]) -> None:
    """Fit the ball of `_with_ball` as one that moves during the exposure."""
    readings = points[points[..., 2] < 1.6]
    sphere, sweep = np.array([0.0, 0.0, 1.5, 0.2]), np.array([0.05, 0.0, 0.0])
    times = np.full(len(readings), np.nan)
    fit_sweep(readings.astype(np.float64), times, sphere, sweep, 0.1, np.full(4, 1e-6), 0.0)
    for kind in (np.float32, np.float64):
        unswept(readings.astype(kind), times, sphere, sweep)


def _look_at_ball(points: NDArray[np.float32]) -> None:
    """Look for the spin of the ball of `_with_ball` in frames that show it chequered."""
    rows, columns = np.indices((HEIGHT, WIDTH))
    chequered = (rows // 4 + columns // 4) % 2 * 150 + 50
    colors = np.repeat(chequered[:, :, None], 3, axis=2).astype(np.uint8)
    sphere = DetectedSphere(np.array([0.0, 0.0, 1.5]), 0.2, 1e-6 * np.eye(4), 200, 1.5)
    pixels = np.flatnonzero(points[..., 2].ravel() < 1.6)
    image = sphere_image(sphere, pixels, points, colors)
    spin = SurfaceSpin()
    for k in range(3):
        if image is not None:
            spin.take(0.03 * k, image)


def _as_cloud(points: NDArray[np.float32]) -> NDArray[np.float32]:
    size = points.itemsize
    fields = [
        SimpleNamespace(name=name, offset=k * size, datatype=FLOAT32, count=1)
        for k, name in enumerate("xyz")
    ]
    return points_of_cloud(
        SimpleNamespace(
            data=points.tobytes(),
            width=WIDTH * HEIGHT,
            height=1,
            point_step=3 * size,
            row_step=3 * size * WIDTH * HEIGHT,
            fields=fields,
            is_bigendian=False,
        )
    )


WARM_UPS: tuple[WarmUp, ...] = (warm_up,)
"""Functions that `intuitive_physics.kernels.warm_up` calls."""
