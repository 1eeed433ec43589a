"""A LiDAR whose pattern does not repeat: two prisms that turn at different rates bend its beam.

R. G. Brazeal, B. E. Wilkinson, H. H. Hochmair, "A rigorous observation model for the Risley
prism-based Livox Mid-40 lidar sensor", Sensors 21(14), 4722 (2021). Here each prism bends the beam
by the same angle, whatever its direction; their rates are set by hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.scene import Environment
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.depth_renderer import cast_sphere, cast_static


@dataclass(frozen=True)
class RosettePattern:
    """Directions of the beam over time, about the z axis of the sensor's frame."""

    half_angle: float = np.radians(19.2)  # rad, of the cone that is seen
    turns: tuple[float, float] = (121.567, -77.733)  # of the two prisms, 1/s
    points_per_second: float = 100_000.0

    def times(self, begin: float, duration: float) -> NDArray[np.float64]:
        """Return the times (n,) s of the readings from a time on."""
        first, last = np.array([begin, begin + duration]) * self.points_per_second
        return np.arange(round(first), round(last)) / self.points_per_second

    def directions(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n, 3) directions with z = 1 at times (n,) s.

        Each prism bends the beam by half of `half_angle`, towards where it has turned.
        """
        angles = 2.0 * np.pi * np.outer(times, self.turns)
        bent = 0.5 * self.half_angle
        off = bent * np.stack([np.cos(angles).sum(axis=1), np.sin(angles).sum(axis=1)], axis=1)
        away = np.linalg.norm(off, axis=1, keepdims=True)
        # tan(a) / a is 1 where a is 0.
        lateral = off * np.tan(away) / np.maximum(away, 1e-12)
        return np.concatenate([lateral, np.ones((len(times), 1))], axis=1)


class RosetteLidar:
    """Reads balls in an environment.

    The sensor's frame is that of a camera: x right, y down, z forward.
    """

    def __init__(
        self,
        camera: Camera,
        environment: Environment,
        pattern: RosettePattern,
        noise: float,
        rng: np.random.Generator,
    ) -> None:
        """`camera`: whose place and orientation it has; `noise` of a range, m."""
        self._camera, self._environment = camera, environment
        self.pattern, self._noise, self._rng = pattern, noise, rng

    def read(
        self,
        begin: float,
        duration: float,
        centers: Sequence[ArrayLike] = (),
        radii: Sequence[float] = (),
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.int16]]:
        """Return points (1, n, 3) m in the sensor's frame, their times (n,) s, and the number (n,)
        of the ball that each is on, -1 for none.

        Each of the `centers` is a place (3,) m in the world, or the places (n, 3) at the n times of
        the pattern; `radii` in m.
        """
        times = self.pattern.times(begin, duration)
        rays = self.pattern.directions(times)
        depth = cast_static(self._camera, self._environment, rays.astype(np.float32)).depth.copy()
        owner = np.full(len(times), -1, dtype=np.int16)
        for k, (center, radius) in enumerate(zip(centers, radii, strict=True)):
            places = np.broadcast_to(np.asarray(center, dtype=np.float64), rays.shape)
            ball = cast_sphere(rays, self._camera.to_optical(places), radius)[0]
            nearer = (ball > 0.0) & ((depth == 0.0) | (ball < depth))
            depth[nearer], owner[nearer] = ball[nearer], k
        lengths = np.linalg.norm(rays, axis=1)
        noisy = depth + self._rng.normal(0.0, self._noise, len(times)) / lengths
        read = depth > 0.0
        points = (rays[read] * noisy[read, None]).astype(np.float32)
        return points[None], times[read], owner[read]
