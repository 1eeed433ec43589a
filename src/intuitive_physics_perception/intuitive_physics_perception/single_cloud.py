"""One cloud alone: its environment and its spheres, without a track."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment
from intuitive_physics_perception.detection.detected_sphere import DetectedSphere, without_doubles
from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.settings import PerceptionSettings


def perceive_cloud(
    points: ArrayLike, settings: PerceptionSettings, rng: np.random.Generator
) -> tuple[Environment, list[DetectedSphere]]:
    """Perceive one cloud alone: its environment, and the spheres in the environment's frame.

    Parameters
    ----------
    points : (n, 3) or (height, width, 3) m in the sensor's frame, the sensor at the origin; NaN
        where nothing was read

    Raises
    ------
    InvalidInputError
        When the points have another shape.
    NoEnvironmentError
        When the cloud shows no supporting plane.
    """
    try:
        cloud = np.ascontiguousarray(points, dtype=np.float32)
    except (TypeError, ValueError):
        raise InvalidInputError(f"points are {points!r:.80}; expected numbers (n, 3)") from None
    if cloud.ndim not in (2, 3) or cloud.shape[-1] != 3:
        raise InvalidInputError(
            f"points have the shape {cloud.shape}; expected (n, 3) or (height, width, 3)"
        )
    frame = cloud if cloud.ndim == 3 else cloud[None]
    model = model_environment([frame], settings, rng)
    clusters = ForegroundFinder(model, settings).find(frame)
    found = SphereFinder(model.noise, settings, rng).find(frame, clusters)
    spheres = without_doubles([sphere for part in found for sphere in part.spheres])
    return model.environment, [s.moved(model.rotation, model.translation) for s in spheres]
