"""Frames of a depth camera that moves by hand, as 7-Scenes has them, and balls that are thrown
through them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from benchmarks.perception.real_scenes import (
    FRAME_TIME,
    FREE_GAP,
    GRAVITY,
    PlacedBall,
    RealScene,
    is_in_view,
    place_ball,
)
from intuitive_physics.frames.change_of_frame import RigidTransform

BETWEEN_THROWS, FLIGHT_FRAMES = 30, 15  # frames from throw to throw, and of each at most
SPEED, SPREAD = (0.0, -1.2, 0.0), (0.9, 0.4, 0.5)  # m/s of throws in the camera's frame
NO_READING = 65535  # besides zero


@dataclass(frozen=True)
class Recording:
    """Frames of one depth camera, 30 in a second, and its pose in each.

    Parameters
    ----------
    folder : of frame-NUMBER.depth.png in mm, frame-NUMBER.pose.txt (4, 4) from the camera to a
        frame that stands still, and camera-intrinsics.txt (3, 3)
    """

    folder: Path

    @cached_property
    def frames(self) -> list[str]:
        """Names of the frames in their order; none where there is no recording."""
        return [path.name[: -len(".depth.png")] for path in sorted(self.folder.glob("*.depth.png"))]

    def scene(self, k: int) -> RealScene:
        """Return what a frame shows."""
        with Image.open(self.folder / f"{self.frames[k]}.depth.png") as image:
            millimetres = np.asarray(image).astype(np.uint16)
        depth = np.where(millimetres == NO_READING, 0, millimetres) * np.float32(0.001)
        return RealScene(self.frames[k], depth, self._intrinsics)

    def pose(self, k: int) -> RigidTransform:
        """Return the pose of the camera in a frame."""
        matrix = np.loadtxt(self.folder / f"{self.frames[k]}.pose.txt")
        return RigidTransform(matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]).as_quat())

    @cached_property
    def _intrinsics(self) -> NDArray[np.float64]:
        return np.loadtxt(self.folder / "camera-intrinsics.txt")


class Throws:
    """Balls that fly through the frames of a recording: each until it is near something, leaves the
    view or is hidden.

    `up` (3,) in the frame that stands still.

    Attributes
    ----------
    number : of the last ball, from 0
    """

    def __init__(self, up: NDArray[np.float64], rng: np.random.Generator) -> None:
        self._up = up
        self._rng = rng
        self._begun, self._has_ended = 0, True
        self.number = -1

    def ball(self, k: int, scene: RealScene, pose: RigidTransform) -> PlacedBall | None:
        """Return the ball in a frame, where one flies."""
        if k % BETWEEN_THROWS == 0:
            self._throw(k, scene, pose)
        time = (k - self._begun) * FRAME_TIME
        if self._has_ended or time >= FLIGHT_FRAMES * FRAME_TIME:
            return None
        fall = 0.5 * GRAVITY * time**2 * self._up
        place = pose.inverse.points(self._place + time * self._velocity - fall)
        ball = PlacedBall(place, self._radius)
        self._has_ended = scene.gap(ball) < 1.0 or not is_in_view(scene, [ball], 0.95)
        return None if self._has_ended else ball

    def _throw(self, k: int, scene: RealScene, pose: RigidTransform) -> None:
        start = place_ball(scene, FREE_GAP, self._rng)
        self._begun, self._has_ended = k, start is None
        if start is not None:
            self.number += 1
            self._place, self._radius = pose.points(start.center), start.radius
            self._velocity = pose.directions(self._rng.normal(SPEED, SPREAD))
