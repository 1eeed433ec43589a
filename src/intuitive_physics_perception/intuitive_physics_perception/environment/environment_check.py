"""Whether later frames still show the environment that was modelled: has the sensor been moved?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.environment.environment_model import (
    EnvironmentModel,
    explained_points,
)
from intuitive_physics_perception.environment.range_cloud import RangeCloud
from intuitive_physics_perception.settings import PerceptionSettings

MAX_POINTS = 1200
MIN_POINTS = 50


class EnvironmentCheck:
    """Compares how much of each frame lies on the modelled planes with how much did at first.

    What moves through the view covers a part of it for a while; a sensor that was moved, if only by
    half a degree, sees most planes elsewhere, and goes on to. A sensor that slides along its only
    plane, or turns about that plane's normal, sees nothing change and is not noticed.

    Parameters
    ----------
    model : the environment
    settings : `moved_fraction` and `moved_time` decide
    """

    def __init__(self, model: EnvironmentModel, settings: PerceptionSettings) -> None:
        self._model = model
        self._settings = settings
        self._since: float | None = None

    def moved(self, points: NDArray[np.float32], time: float) -> str:
        """Say in a sentence that the sensor was moved; empty while it was not.

        Parameters
        ----------
        points : (height, width, 3) m in the sensor's frame, NaN where nothing was read
        time : s
        """
        fraction = self._explained(points) / max(self._model.explained, 1e-9)
        if fraction >= self._settings.moved_fraction:
            self._since = None
            return ""
        if self._since is None or time < self._since:
            self._since = time
        lasting = time - self._since
        if lasting < self._settings.moved_time:
            return ""
        return (
            f"for {lasting:.1f} s {fraction:.0%} of the readings that should lie on the planes do; "
            "the sensor was moved: they are modelled anew"
        )

    def _explained(self, points: NDArray[np.float32]) -> float:
        """Part of some readings of a frame, evenly over it, that lies on a plane."""
        height, width = points.shape[:2]
        stride = max(1, int(np.sqrt(height * width / MAX_POINTS)))
        some = points[::stride, ::stride] if height > 1 else points[:, :: stride * stride]
        some = some.reshape(-1, 3)
        ranges = np.linalg.norm(some, axis=1)
        # NaN compares false.
        some = some[(ranges >= self._settings.min_range) & (ranges <= self._settings.max_range)]
        if len(some) < MIN_POINTS:
            return self._model.explained
        cloud = RangeCloud(some.astype(np.float64), self._model.noise, self._settings)
        return float(explained_points(cloud, self._model.detected).mean())
