"""What is followed in one environment, whichever camera sees it: tracks, episodes and spins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import entry
from intuitive_physics.scene import Environment
from intuitive_physics_perception.appearance.sphere_image import sphere_image
from intuitive_physics_perception.appearance.surface_spin import SurfaceSpin
from intuitive_physics_perception.detection.detections import DetectedSphere, Detection
from intuitive_physics_perception.detection.solids import ObjectInFrame
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame import Frame
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import Episode, EpisodeRecorder
from intuitive_physics_perception.tracking.motion import PLACED, POSITION, RADIUS
from intuitive_physics_perception.tracking.track import FilterStep, Track
from intuitive_physics_perception.tracking.tracker import Tracker

MARGIN = 0.05
"""Distance from what is followed within which a reading shows no environment, m: the noise and the
flying pixels at its edge."""


class FollowedObjects:
    """Tracks of one environment and the episodes of their motion.

    `first_track`: number of the first track.
    """

    def __init__(
        self, environment: Environment, settings: PerceptionSettings, first_track: int
    ) -> None:
        self._settings = settings
        self.tracker = Tracker(environment, settings, first_track)
        self.episodes = EpisodeRecorder(environment, settings)

    def take_environment(self, environment: Environment) -> None:
        """Go on in the environment as it is known now."""
        self.tracker.take_environment(environment)
        self.episodes.take_environment(environment)

    def finish(self) -> tuple[Episode, ...]:
        """End the episode that is under way and return it, where there is one."""
        return self.episodes.finish(self.tracker.tracks)

    def removed_from(
        self, points: NDArray[np.float32], model: EnvironmentModel
    ) -> NDArray[np.float32]:
        """Return a frame with NaN about what is followed: it shows no part of the environment.

        `points` (height, width, 3) m, of the frame; `model` as the sensor sees it. Returns the same
        (height, width, 3).
        """
        cleared, tracks = points.copy(), self.tracker.tracks
        centres = np.array([model.to_sensor(track.mean[POSITION]) for track in tracks])
        radii = [track.scene_object(self._settings).shape.bounding_radius for track in tracks]
        _clear_about(cleared.reshape(-1, 3), centres.reshape(-1, 3), np.array(radii) + MARGIN)
        return cleared

    def look_at_surfaces(
        self,
        objects: Sequence[tuple[ObjectInFrame, Detection]],
        frame: Frame,
        model: EnvironmentModel,
    ) -> None:
        """Measure in a frame how balls in free flight turn.

        `objects`: of the frame, and the detections that the tracker took for them; `model` as the
        sensor sees it.
        """
        points, colors = frame.points, frame.colors
        if colors is None or points.shape[0] == 1 or not self._settings.spin_from_surface:
            return
        by_detection = {id(detection): item for item, detection in objects}
        for track in self.tracker.followed:
            # Another sensor may have seen it later than this frame.
            steps = [step for step in track.since(frame.time) if id(step.detection) in by_detection]
            if not steps:
                continue
            step, item = steps[-1], by_detection[id(steps[-1].detection)]
            if not isinstance(item.detection, DetectedSphere):
                continue
            if not self.tracker.flies(track, step):
                track.surface = None
                continue
            sphere = _averaged_sphere(track, step, item.detection)
            seen = sphere.moved(model.rotation.T, model.to_sensor(np.zeros(3)))
            image = sphere_image(seen, item.pixels(points), points, colors)
            if image is not None:
                track.surface = track.surface or SurfaceSpin()
                track.surface.take(step.time, image.moved(model.rotation))


def _averaged_sphere(track: Track, step: FilterStep, detected: DetectedSphere) -> DetectedSphere:
    """A sphere as detected at a step, averaged over all frames up to it."""
    return replace(
        detected,
        center=step.mean[POSITION],
        radius=float(step.mean[RADIUS]),
        covariance=step.covariance[np.ix_(PLACED, PLACED)] + track.systematic,
    )


@entry
def _clear_about(points: Any, centres: Any, reaches: Any) -> None:
    """Let those of points (n, 3) m be NaN that are nearer to one of some centres (k, 3) m than its
    reach (k,) m."""
    for k in range(reaches.size):
        a, b, c = centres[k]
        for i in range(points.shape[0]):
            x, y, z = points[i, 0] - a, points[i, 1] - b, points[i, 2] - c
            if x * x + y * y + z * z < reaches[k] ** 2:
                points[i] = np.nan
