"""A pinhole depth camera and where it stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array, positive_float, unit_vector

# Name of the camera's frame: x right, y down, z forward (REP 103).
OPTICAL_FRAME = "camera_depth_optical_frame"

FOCAL_LENGTH = 460.0  # pixels, of cameras that look at something
UP = np.array([0.0, 0.0, 1.0])  # Unit vector in the world


@dataclass(frozen=True, eq=False)
class Camera:
    """Pinhole camera; its optical frame is x right, y down, z forward (REP 103)."""

    # width, height: image size in pixels
    width: int
    height: int
    focal_length: float  # pixels, the same in both directions
    position: NDArray[np.float64]  # (3,) m, of the optical centre in the world
    rotation: NDArray[np.float64]  # (3, 3), optical frame to world
    frame_id: str = OPTICAL_FRAME  # name of the optical frame

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise InvalidInputError(
                f"image is {self.width} × {self.height} pixels; expected at least 1 × 1"
            )
        positive_float(self.focal_length, "focal length")
        rotation = finite_array(self.rotation, "camera rotation", (3, 3))
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6:
            raise InvalidInputError("camera rotation is not a rotation; expected R Rᵀ = 1")
        object.__setattr__(self, "position", finite_array(self.position, "camera position", (3,)))
        object.__setattr__(self, "rotation", rotation)

    @staticmethod
    def looking_at(
        position: ArrayLike,
        target: ArrayLike,
        *,
        width: int = 640,
        height: int = 480,
    ) -> Camera:
        """Return an upright camera at a position (3,) m with the target (3,) m in its centre."""
        origin = finite_array(position, "camera position", (3,))
        forward = unit_vector(finite_array(target, "target", (3,)) - origin, "viewing direction")
        if abs(forward @ UP) > 1.0 - 1e-9:
            raise InvalidInputError("camera looks along the vertical; expected another direction")
        right = unit_vector(np.cross(forward, UP), "camera's right")
        rotation = np.column_stack([right, np.cross(forward, right), forward])
        return Camera(width, height, FOCAL_LENGTH, origin, rotation)

    @property
    def principal_point(self) -> tuple[float, float]:
        """(c_x, c_y) in pixels: the middle of the image."""
        return (self.width - 1) / 2.0, (self.height - 1) / 2.0

    def matrix(self) -> NDArray[np.float64]:
        """Return K, (3, 3), in pixels."""
        cx, cy = self.principal_point
        f = self.focal_length
        return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])

    def rays(self) -> NDArray[np.float64]:
        """Return (height, width, 3) directions in the optical frame with z = 1.

        A surface point at `t` times a direction is at depth `t`.
        """
        cx, cy = self.principal_point
        x = (np.arange(self.width) - cx) / self.focal_length
        y = (np.arange(self.height) - cy) / self.focal_length
        return np.stack([*np.meshgrid(x, y), np.ones((self.height, self.width))], axis=-1)

    def to_optical(self, points: ArrayLike) -> NDArray[np.float64]:
        """Carry world points (..., 3) into the optical frame."""
        return (np.asarray(points, dtype=np.float64) - self.position) @ self.rotation

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return pixels (..., 2) of world points (..., 3); NaN for points behind the camera."""
        optical = self.to_optical(points)
        depth = np.where(optical[..., 2:] > 0.0, optical[..., 2:], np.nan)
        return self.focal_length * optical[..., :2] / depth + np.array(self.principal_point)

    def to_dict(self) -> dict[str, Any]:
        """Plain data that `from_dict` reads back."""
        return {
            "width": self.width,
            "height": self.height,
            "focal_length": self.focal_length,
            "position": self.position.tolist(),
            "rotation": self.rotation.tolist(),
            "frame_id": self.frame_id,
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Camera:
        """Read what `to_dict` wrote."""
        try:
            return Camera(**data)
        except TypeError as error:
            raise InvalidInputError(f"camera cannot be read: {error}") from None
