"""From poses that others measure to states and observations, as from what a camera detects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment, SceneObject
from intuitive_physics.shapes import Box, Capsule
from intuitive_physics.state import ObjectState
from intuitive_physics_perception.detection.detections import (
    DetectedSolid,
    DetectedSphere,
    Detection,
)
from intuitive_physics_perception.poses.described_objects import TaggedObject
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import EpisodeRecorder, observations_from
from intuitive_physics_perception.tracking.track import Track
from intuitive_physics_perception.tracking.tracker import Tracker

SIZE_DEVIATION = 1e-5
"""m, standard deviation of the dimensions, which are known: numerical."""


@dataclass(frozen=True, eq=False)
class MeasuredPose:
    """Pose of one object's tag, as measured.

    Parameters
    ----------
    pose : of the tag, in the environment's frame
    position_covariance : (3, 3) m²
    rotation_covariance : (3, 3) rad², of a rotation vector in the environment's axes
    """

    pose: RigidTransform
    position_covariance: NDArray[np.float64]
    rotation_covariance: NDArray[np.float64]


class PoseTracker:
    """Follows objects by their measured poses.

    Which object is which, and its shape, is known; otherwise they are followed, and their motions
    become observations, as objects are that a camera sees. A sphere's orientation is not used.
    """

    def __init__(self, environment: Environment, objects: Sequence[TaggedObject]) -> None:
        if not objects:
            raise InvalidInputError("no objects are followed by their poses; expected at least one")
        self._environment = environment
        self._tagged = {item.object.id: item for item in objects}
        if len(self._tagged) != len(objects):
            raise InvalidInputError(
                f"objects have the ids {[item.object.id for item in objects]}; expected each once"
            )
        self._settings = PerceptionSettings()
        self._time = -np.inf
        self._trackers: dict[str, Tracker] = {}
        self._episodes = EpisodeRecorder(environment, self._settings)
        self._begin()

    def update(
        self, time: float, poses: Mapping[str, MeasuredPose]
    ) -> tuple[bool, tuple[Observation, ...]]:
        """Take the poses of one time; objects without one are carried on.

        `time` in s; an earlier one than the last begins again. Returns whether time has gone
        back, so that all begins again, and the observations of motions that are over.
        """
        unknown = poses.keys() - self._tagged.keys()
        if unknown:
            raise UnknownNameError(
                f"pose of {sorted(unknown)[0]!r}, which is not followed; expected one of "
                f"{', '.join(self._tagged)}"
            )
        if not np.isfinite(time):
            raise InvalidInputError(f"time of a pose is {time}; expected a finite number")
        if time == self._time:
            return False, ()
        back = time < self._time
        before = self.finish() if back else ()
        self._time = time
        ended: list[Track] = []
        for name, tracker in self._trackers.items():
            detections = [self._detection(name, poses[name])] if name in poses else []
            ended += tracker.update(time, detections)
        episodes = self._episodes.update(time, [*self._alive().values()], ended)
        return back, (*before, *observations_from(episodes))

    def states(self) -> tuple[list[SceneObject], list[ObjectState]]:
        """Return the objects that are followed, and the state of each at the newest time."""
        alive = self._alive()
        return (
            [self._tagged[name].object for name in alive],
            [track.object_state(self._environment, self._settings) for track in alive.values()],
        )

    def finish(self) -> tuple[Observation, ...]:
        """Return the observations of what still moves, and start again."""
        episodes = self._episodes.finish([*self._alive().values()])
        self._begin()
        return observations_from(episodes)

    def _begin(self) -> None:
        self._time = -np.inf
        self._trackers = {
            name: Tracker(self._environment, self._settings, identity=item.object)
            for name, item in self._tagged.items()
        }
        self._episodes = EpisodeRecorder(self._environment, self._settings)

    def _alive(self) -> dict[str, Track]:
        """The track of each object that is followed; the newest one of an object that jumped."""
        alive = {name: tracker.tracks for name, tracker in self._trackers.items()}
        return {
            name: max(tracks, key=lambda track: track.last_seen)
            for name, tracks in alive.items()
            if tracks
        }

    def _detection(self, name: str, measured: MeasuredPose) -> Detection:
        """Detection of an object's centre, which a turn of its tag moves by the lever arm."""
        shape, offset = self._tagged[name].object.shape, self._tagged[name].centre
        pose = measured.pose.after(offset)
        lever = np.cross(np.eye(3), measured.pose.directions(offset.translation))
        position = measured.position_covariance + lever @ measured.rotation_covariance @ lever.T
        center = np.array(pose.translation)
        if isinstance(shape, Box | Capsule):
            return DetectedSolid(
                shape=shape,
                center=center,
                rotation=pose.matrix,
                position_covariance=position,
                rotation_covariance=measured.rotation_covariance,
                size_variance=SIZE_DEVIATION**2,
                points=1,
                misfit=1.0,
            )
        covariance = np.zeros((4, 4))
        covariance[:3, :3] = position
        covariance[3, 3] = SIZE_DEVIATION**2
        return DetectedSphere(center, shape.bounding_radius, covariance, points=1, range=0.0)
