"""A depth and a colour camera in one place, each with its noise, that see the same balls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_experiments.rendering.color_camera import (
    ColorCamera,
    ColoredBall,
    ColorNoise,
    RoomLight,
)
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise, NoisyDepthCamera
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import points_from_depth


class DepthColorCamera:
    """Registered depth and colour images, each with its noise."""

    def __init__(
        self, renderer: DepthRenderer, rng: np.random.Generator, light: RoomLight | None = None
    ) -> None:
        camera, self._renderer = renderer.camera, renderer
        self._depth = NoisyDepthCamera(renderer.background, camera.focal_length, DepthNoise(), rng)
        self._color = ColorCamera(renderer, light or RoomLight(), ColorNoise(), rng)
        self._rays = Intrinsics(camera.width, camera.height, camera.matrix()).rays()

    def points(self, balls: Sequence[ColoredBall] = ()) -> NDArray[np.float32]:
        """Return the points (height, width, 3) m of an image, NaN where nothing was measured."""
        rendered = self._renderer.render_balls(
            [ball.center for ball in balls], [ball.radius for ball in balls]
        )
        depth = self._depth.read(rendered.image, rendered.region)
        return points_from_depth(depth, self._rays)

    def colors(self, balls: Sequence[ColoredBall] = ()) -> NDArray[np.uint8]:
        """Return red, green and blue (height, width, 3) of an image."""
        return self._color.read(balls)
