"""Finders of objects in the frames of one environment, with their memories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle, islice

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.detection.cluster_memory import FIRST_SEARCHES
from intuitive_physics_perception.detection.foreground import Clusters, ForegroundFinder
from intuitive_physics_perception.detection.solids import SolidFinder, all_objects
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.known_space import KnownSpace
from intuitive_physics_perception.environment.static_boxes import StaticBoxFilter
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.supports import surfaces_of


class Stages:
    """Finders of objects in the frames of one environment, with their memories.

    `before` (height, width) m, the nearest range that each pixel read when the environment was
    modelled, NaN for nothing; None where readings have no fixed pixels; `space`: what is known of
    the space about the sensor.

    Attributes
    ----------
    model : the environment as the sensor sees it now
    """

    def __init__(
        self,
        model: EnvironmentModel,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        before: NDArray[np.float32] | None,
        space: KnownSpace,
    ) -> None:
        self.model = self._modelled = model
        self.before = before
        self.foreground = ForegroundFinder(model, settings, before, space)
        self.static_boxes = StaticBoxFilter(model, settings)
        self.spheres = SphereFinder(model, settings, rng)
        self.solids = SolidFinder(model, settings, rng) if settings.find_solids else None

    def look_from(self, way: RigidTransform | None) -> None:
        """Look at the same environment from elsewhere.

        `way`: from the sensor's frame now to its frame when the environment was modelled; None
        there, where each pixel has its ray again.
        """
        self.model = self._modelled if way is None else self._modelled.seen_from(way)
        self.foreground.look_from(self.model, has_moved=way is not None)
        self.static_boxes.look_from(self.model)
        self.spheres.look_from(self.model)
        if self.solids is not None:
            self.solids.look_from(self.model)

    def confirm_gravity(self) -> None:
        """Let gravity be no longer in doubt, where the environment was modelled."""
        self.model = self._modelled = replace(self._modelled, gravity_doubt="")

    def clusters(self, points: NDArray[np.float32]) -> Clusters:
        """Return clusters of what is neither a plane nor a static box.

        `points` (height, width, 3) m, of a frame.
        """
        return self.static_boxes.without(points, self.foreground.find(points))

    def prepare(self, frames: Sequence[NDArray[np.float32]]) -> None:
        """Find where each pixel's ray meets a plane and the surfaces on which objects move, and
        search the first clusters: later frames need not wait for it.

        `frames` (height, width, 3) m each, from which the environment was modelled.
        """
        surfaces_of(self.model.environment)
        for points in islice(cycle(frames[::-1]), FIRST_SEARCHES):
            spheres = self.spheres.find(points, self.clusters(points))
            all_objects(points, spheres, self.solids)
