"""Clusters that are nothing but static boxes of the environment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics_perception.detection.foreground import Clusters
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.settings import PerceptionSettings

LEAST_EXTENT = 0.4
"""Of a box's diagonal: what is smaller may be an object in front of or within a rough box."""


STRAY = 0.005
"""Part of the readings on a box that noise puts out of it."""

ASKED_POINTS = 1500


class Furniture:
    """Knows the static boxes of one environment again."""

    def __init__(self, model: EnvironmentModel, settings: PerceptionSettings) -> None:
        self._model = model
        self._settings = settings
        self._boxes = [
            (box.center, rotation_matrix(box.orientation), 0.5 * box.edge_lengths)
            for box in model.environment.boxes
        ]

    def without(self, points: NDArray[np.float32], clusters: Clusters) -> Clusters:
        """Return clusters of a frame of points (height, width, 3) less those that are a box."""
        if not self._boxes:
            return clusters
        flat = points.reshape(-1, 3)
        kept = [c for c in clusters.indices if not self._is_box(flat, c)]
        return replace(clusters, indices=kept)

    def _is_box(self, points: NDArray[np.float32], cluster: NDArray[np.int64]) -> bool:
        """Whether too few of a cluster's points for an object lie out of boxes of which it fills
        one: those of things that touch make one cluster."""
        every = len(cluster) // ASKED_POINTS + 1
        own = points[cluster[::every]].astype(np.float64)
        deviations = self._model.noise.deviation(np.linalg.norm(own, axis=1))
        margin = self._settings.plane_tolerance + self._settings.plane_sigmas * deviations
        places = self._model.to_environment(own)
        out, fills = np.ones(len(own), dtype=bool), False
        for center, rotation, half in self._boxes:
            local = (places - center) @ rotation
            inside = (np.abs(local) <= half + margin[:, None]).all(axis=1)
            out &= ~inside
            if inside.any():
                extent = float(np.linalg.norm(np.ptp(local[inside], axis=0)))
                fills |= extent > LEAST_EXTENT * 2.0 * float(np.linalg.norm(half))
        allowed = self._settings.min_points + STRAY * len(cluster)
        return fills and every * int(out.sum()) < allowed
