"""The stages of perception that need the environment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.cluster_memory import SEARCHES
from intuitive_physics_perception.detection.foreground import Clusters, ForegroundFinder
from intuitive_physics_perception.detection.objects import all_objects
from intuitive_physics_perception.detection.solids import SolidFinder
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.environment.environment_check import EnvironmentCheck
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.furniture import Furniture
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import EpisodeRecorder
from intuitive_physics_perception.tracking.tracker import Tracker


class ModelledScene:
    """Stages made for one environment, and what they remember of it."""

    def __init__(
        self,
        model: EnvironmentModel,
        settings: PerceptionSettings,
        rng: np.random.Generator,
        first_track: int,
    ) -> None:
        self.model = model
        self.check = EnvironmentCheck(model, settings)
        self.foreground = ForegroundFinder(model, settings)
        self.furniture = Furniture(model, settings)
        self.spheres = SphereFinder(model.noise, settings, rng)
        self.solids = SolidFinder(model, settings, rng) if settings.find_solids else None
        self.follow_anew(settings, first_track)

    def clusters(self, points: NDArray[np.float32]) -> Clusters:
        """What is neither a plane nor a static box, in clusters."""
        return self.furniture.without(points, self.foreground.find(points))

    def get_used_to(self, points: NDArray[np.float32]) -> None:
        """Find out what each pixel sees of the planes and what stands about, so that no later
        frame waits for it."""
        for _ in range(SEARCHES):
            spheres = self.spheres.find(points, self.clusters(points))
            all_objects(points, spheres, self.solids)

    def follow_anew(self, settings: PerceptionSettings, first_track: int) -> None:
        """Forget what was followed; the environment stays."""
        self.tracker = Tracker(self.model.environment, settings, first_track)
        self.episodes = EpisodeRecorder(self.model.environment, settings)
