"""Compile the kernels ahead of time, so that no frame ever waits for them."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from intuitive_physics_perception.depth import (
    Field,
    Intrinsics,
    points_from_cloud_data,
    points_from_depth,
)
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

WIDTH, HEIGHT, FOCAL_LENGTH = 80, 60, 60.0


def warm_up() -> None:
    """Perceive a ball before a wall, as depth images of both kinds and as a cloud."""
    camera = Intrinsics(
        WIDTH, HEIGHT, [FOCAL_LENGTH, 0, WIDTH / 2, 0, FOCAL_LENGTH, HEIGHT / 2, 0, 0, 1]
    )
    rays = camera.rays()
    wall = np.full((HEIGHT, WIDTH), 2.0, dtype=np.float32)
    ball = wall.copy()
    # z of a sphere of radius 0.2 m about (0, 0, 1.5): |z ray - c|² = r².
    length2 = np.square(rays).sum(axis=-1)
    root = 1.5**2 - length2 * (1.5**2 - 0.2**2)
    hit = root > 0.0
    ball[hit] = (1.5 - np.sqrt(root[hit])) / length2[hit]
    settings = replace(PerceptionSettings(), environment_frames=1)
    for shown in (wall, ball):
        points_from_depth((1000.0 * shown).astype(np.uint16), rays)
    pipeline = PerceptionPipeline(settings, np.random.default_rng(0))
    pipeline.process(points_from_depth(wall, rays), 0.0)
    frame = points_from_depth(ball, rays)
    # A second ball-like half is searched for at random, which needs the remaining kernels.
    half = frame.copy()
    half[:, WIDTH // 2 :] = np.nan
    for k, points in enumerate((frame, half, frame[:, :30].copy())):
        pipeline.process(points, 0.1 * (k + 1))
    cloud = points_from_cloud_data(
        frame.tobytes(),
        width=WIDTH * HEIGHT,
        height=1,
        point_step=12,
        row_step=12 * WIDTH * HEIGHT,
        fields=[Field(name, 4 * k, 7, 1) for k, name in enumerate("xyz")],
        is_bigendian=False,
    )
    pipeline.process(cloud, 1.0)


def main() -> None:
    """Compile every kernel into Numba's cache."""
    start = time.perf_counter()
    warm_up()
    print(f"perception kernels ready after {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
